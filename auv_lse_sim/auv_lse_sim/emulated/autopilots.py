"""The simulated autopilots of a mission; needs the package auv_lse_mavlink."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.missing_packages import missing
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.mission_run import Stop
from auv_lse_comms.transport import AddressError, read_address

try:
    from auv_lse_mavlink.messages.datum import Origin
except ImportError as error:
    raise missing(error, "simulated autopilots") from error
from auv_lse_sim.emulated.autopilot_report import autopilot_of
from auv_lse_sim.emulated.host_ports import LOCAL_HOSTS
from auv_lse_sim.emulated.mavlink_dock import MavlinkDock
from auv_lse_sim.emulated.mavlink_vehicle import SURFACE_M, AutopilotSetup, MavlinkVehicle
from auv_lse_sim.vehicle.vehicle import tightest_radius_m


def dock_of(
    settings: Settings,
    numbers: Sequence[int],
    follow: Callable[[int, Leg], None],
    obey: Callable[[int, Stop | None], None],
    dive: Callable[[int, float], None],
) -> MavlinkDock:
    """Opens the ports of the autopilots of the vehicles `numbers`; see `EmulatedLinks` for the rest.

    Raises:
        OSError: if a port cannot be opened.
        AddressError: if `link.endpoint` is no UDP port of this machine.
    """
    autopilots = {k: _autopilot(settings, k, follow, obey, dive) for k in numbers}
    return MavlinkDock(autopilots, {k: _endpoint(settings.vehicle(k).link.endpoint) for k in numbers})


def _autopilot(
    settings: Settings,
    k: int,
    follow: Callable[[int, Leg], None],
    obey: Callable[[int, Stop | None], None],
    dive: Callable[[int, float], None],
) -> MavlinkVehicle:
    vehicle = settings.vehicle(k).vehicle
    link = settings.vehicle(k).link
    height_m = autopilot_of(settings.sim).origin_height_m if link.pressure != "none" else 0.0
    return MavlinkVehicle(
        link.autopilot_system_id or k,
        (vehicle.start_heading_rad, vehicle.start_north_m, vehicle.start_east_m),
        settings.motion.turn_radius_m,
        Origin.of(settings.area),
        lambda leg: follow(k, leg),
        obey=lambda stop: obey(k, stop),
        tightest_m=tightest_radius_m(vehicle, settings.sim),
        setup=AutopilotSetup(
            origin_height_m=height_m,
            pressure=link.pressure,
            dive=lambda depth_m: dive(k, depth_m),
            is_boat=vehicle.depth_m <= SURFACE_M,
        ),
    )


def _endpoint(endpoint: str) -> str:
    address = read_address(endpoint)
    if address.kind != "udpin" or address.position not in LOCAL_HOSTS or address.number == 0:
        raise AddressError(
            f"link.endpoint got {endpoint!r}; expected udpin://127.0.0.1:PORT for a simulated autopilot. Change it"
        )
    return f"udpout://{address.position}:{address.number}"
