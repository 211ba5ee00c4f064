"""Does one thing with each vehicle at the same time."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from auv_lse_shore.remote.fleet_file import RemoteVehicle

Result = TypeVar("Result")


def with_each(vehicles: Sequence[RemoteVehicle], do: Callable[[RemoteVehicle], Result]) -> dict[str, Result]:
    """What `do` returns for each vehicle, by name."""
    with ThreadPoolExecutor(max_workers=max(len(vehicles), 1)) as pool:
        futures = {vehicle.name: pool.submit(do, vehicle) for vehicle in vehicles}
        return {name: future.result() for name, future in futures.items()}
