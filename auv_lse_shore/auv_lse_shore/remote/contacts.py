"""Does one thing with each vehicle at the same time."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from auv_lse_shore.remote.fleet_file import FleetFile, RemoteVehicle
from auv_lse_shore.remote.ssh import LinkError, RemoteSession, VehicleError, session

Result = TypeVar("Result")
_RETRY_S = 1.0


def with_each(vehicles: Sequence[RemoteVehicle], do: Callable[[RemoteVehicle], Result]) -> dict[str, Result]:
    """What `do` returns for each vehicle, by name."""
    with ThreadPoolExecutor(max_workers=max(len(vehicles), 1)) as pool:
        futures = {vehicle.name: pool.submit(do, vehicle) for vehicle in vehicles}
        return {name: future.result() for name, future in futures.items()}


def repeated(fleet: FleetFile, vehicle: RemoteVehicle, wait_s: float, do: Callable[[RemoteSession], str]) -> str:
    """Calls `do` in a session, repeatedly for `wait_s` while the link is lost or `do` does not succeed.

    Returns:
        Why it did not succeed, as `do` returns it; "" if it did.
    """
    end_s = time.monotonic() + wait_s
    while True:
        try:
            with session(vehicle, fleet.ssh_config) as found:
                trouble = do(found)
        except LinkError as error:
            trouble = str(error)
        except VehicleError as error:
            return str(error)
        if not trouble or time.monotonic() + _RETRY_S >= end_s:
            return trouble
        time.sleep(_RETRY_S)
