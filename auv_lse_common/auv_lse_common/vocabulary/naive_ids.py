"""Ids of the naive paths in plans and packets; `naive.py` describes the paths. 0xFF is `plan.NONE`."""

#: Lawnmowers with lanes at the configured spacing, and at the spacing that just covers the area.
LAWNMOWERS = (0xF0, 0xF1, 0xF2, 0xF3)
COVERING = (0xF4, 0xF5, 0xF6, 0xF7)
#: Straight on, and the tightest loop.
STRAIGHT_ON = 0xF8
HOLD = 0xF9
#: Covering lawnmowers over one strip of the area each.
STRIPS = (0xFA, 0xFB, 0xFC, 0xFD, 0xFE)
#: Straight lanes fitted to one strip of the area each, and to the path's length.
FITTED = (0xE0, 0xE1, 0xE2, 0xE3, 0xE4)
#: All paths that follow lanes; all paths.
MOWING = (*LAWNMOWERS, *COVERING, *STRIPS, *FITTED)
IDS = (*LAWNMOWERS, *COVERING, STRAIGHT_ON, HOLD, *STRIPS, *FITTED)
