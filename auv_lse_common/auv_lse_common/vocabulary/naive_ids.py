"""Ids of the naive paths in plans and packets; `naive.py` describes the paths. 0xFF is `plan.NONE`.

Packets and parameters have five ids of fitted lanes. There, strip i is that of the vehicle's group of five: strip i of
all for vehicles 1 to 5, strip 5 + i for vehicles 6 to 10, and so on.
"""

#: Lawnmowers with lanes at the configured spacing, and at the spacing that just covers the area.
LAWNMOWERS = (0xF0, 0xF1, 0xF2, 0xF3)
COVERING = (0xF4, 0xF5, 0xF6, 0xF7)
#: Straight on, and the tightest loop.
STRAIGHT_ON = 0xF8
HOLD = 0xF9
#: Covering lawnmowers over one strip of the area each.
STRIPS = (0xFA, 0xFB, 0xFC, 0xFD, 0xFE)
#: Straight lanes fitted to one strip of the area each, and to the path's length, in packets and parameters.
FITTED_OF_GROUP = (0xE0, 0xE1, 0xE2, 0xE3, 0xE4)
#: The same in plans: one for each vehicle.
FITTED: tuple[int, ...] = (*FITTED_OF_GROUP, *range(0xD0, 0xDF))
#: All paths that follow lanes; all paths.
MOWING = (*LAWNMOWERS, *COVERING, *STRIPS, *FITTED)
IDS = (*LAWNMOWERS, *COVERING, STRAIGHT_ON, HOLD, *STRIPS, *FITTED)


def id_in_plan(naive_path: int, vehicle: int) -> int:
    """The id in a plan, from one in a packet or parameter of a vehicle (from 1)."""
    if naive_path not in FITTED_OF_GROUP:
        return naive_path
    group = (vehicle - 1) // len(FITTED_OF_GROUP)
    return FITTED[group * len(FITTED_OF_GROUP) + FITTED_OF_GROUP.index(naive_path)]


def id_in_packet(naive_path: int) -> int:
    """The id in a packet, from one in a plan."""
    return FITTED_OF_GROUP[FITTED.index(naive_path) % len(FITTED_OF_GROUP)] if naive_path in FITTED else naive_path
