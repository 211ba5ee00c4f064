"""The simulated autopilots of a mission; needs the package auv_lse_mavlink."""

import math
from collections.abc import Sequence

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.missing_packages import missing
from auv_lse_comms.transport import AddressError, read_address

try:
    from auv_lse_mavlink.messages.datum import Origin
except ImportError as error:
    raise missing(error, "simulated autopilots") from error
from auv_lse_sim.emulated.ardupilot.autopilot import ArduPilot
from auv_lse_sim.emulated.ardupilot.personality import ROVER, SUB
from auv_lse_sim.emulated.ardupilot.setup import Setup, recommended_parameters
from auv_lse_sim.emulated.autopilot_report import autopilot_of
from auv_lse_sim.emulated.host_ports import LOCAL_HOSTS
from auv_lse_sim.emulated.mavlink_dock import Autopilot, MavlinkDock
from auv_lse_sim.emulated.mavlink_vehicle import SURFACE_M, AutopilotSetup, MavlinkVehicle
from auv_lse_sim.vehicle.vehicle import tightest_radius_m
from auv_lse_sim.world import World


def dock_of(settings: Settings, numbers: Sequence[int], world: World) -> MavlinkDock:
    """Opens the ports of the autopilots of the vehicles `numbers`, which move the vehicles of `world`.

    Raises:
        OSError: if a port cannot be opened.
        AddressError: if `link.endpoint` is no UDP port of this machine.
    """
    origin = Origin.of(settings.area)
    autopilots = {k: autopilot_for(settings, k, origin, world) for k in numbers}
    return MavlinkDock(autopilots, {k: _endpoint(settings.vehicle(k).link.endpoint) for k in numbers})


def autopilot_for(settings: Settings, k: int, origin: Origin | None, world: World) -> Autopilot:
    """The autopilot of vehicle `k`, as `sim.autopilot.firmware` selects it; it uses the mission's `origin`."""
    if settings.sim.autopilot.firmware == "generic":
        return _generic(settings, k, origin, world)
    return _ardupilot(settings, k, origin, world)


def _height_m(settings: Settings, k: int) -> float:
    return autopilot_of(settings.sim).origin_height_m if settings.vehicle(k).link.pressure != "none" else 0.0


def _start(settings: Settings, k: int) -> tuple[float, float, float]:
    vehicle = settings.vehicle(k).vehicle
    return vehicle.start_heading_rad, vehicle.start_north_m, vehicle.start_east_m


def _generic(settings: Settings, k: int, origin: Origin | None, world: World) -> MavlinkVehicle:
    vehicle, link = settings.vehicle(k).vehicle, settings.vehicle(k).link
    return MavlinkVehicle(
        link.autopilot_system_id or k,
        _start(settings, k),
        settings.motion.turn_radius_m,
        origin,
        lambda leg: world.command(k, leg),
        obey=lambda stop: world.obey(k, stop),
        tightest_m=tightest_radius_m(vehicle, settings.sim),
        setup=AutopilotSetup(
            origin_height_m=_height_m(settings, k),
            pressure=link.pressure,
            dive=lambda depth_m: world.dive(k, depth_m),
            is_boat=vehicle.depth_m <= SURFACE_M,
            component_id=link.autopilot_component_id,
        ),
    )


def _ardupilot(settings: Settings, k: int, origin: Origin | None, world: World) -> ArduPilot:
    link, vehicle = settings.vehicle(k).link, settings.vehicle(k).vehicle
    personality = ROVER if vehicle.depth_m <= SURFACE_M else SUB
    setup = Setup(
        personality=personality,
        parameters=recommended_parameters(personality, link.system_id, vehicle.speed_mps),
        origin_height_m=_height_m(settings, k),
        operator_mode=personality.auto if link.mode == "mission" else personality.guided,
        patience=1.0 if settings.sim.lockstep else max(settings.sim.real_time_factor, 1.0),
        lasts_m=math.inf if vehicle.battery_km is None else 1000.0 * vehicle.battery_km,
        component_id=link.autopilot_component_id,
    )
    system = link.autopilot_system_id or k
    return ArduPilot(system, _start(settings, k), origin, lambda pilot: world.pilot(k, pilot), setup)


def _endpoint(endpoint: str) -> str:
    address = read_address(endpoint)
    if address.kind != "udpin" or address.position not in LOCAL_HOSTS or address.number == 0:
        raise AddressError(f"link.endpoint {endpoint!r} cannot be a simulated autopilot's; use udpin://127.0.0.1:PORT")
    return f"udpout://{address.position}:{address.number}"
