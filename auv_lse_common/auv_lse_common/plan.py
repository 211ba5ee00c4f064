"""A plan: what a vehicle tells its team mates of the path that it means to travel (paper, section 5)."""

from __future__ import annotations

import operator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: `Plan.naive_path` of a plan that ends with its actions: no naive path continues it.
NONE = 0xFF


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """A vehicle's path to the end of its mission, as a packet carries it.

    The state is rounded to float32 (what the packet holds), so that sender and receivers build the path from the
    same numbers. A plan does not say whose it is: the packet's header does, and functions take the vehicle beside it.

    Attributes:
        step: Mission step of the state; step i is reached after i actions.
        heading_rad: Heading of the state (rad, clockwise from north).
        north_m: North of the state.
        east_m: East of the state.
        actions: Indices into the action set.
        naive_path: Id of the naive path that continues after the actions, or `NONE`.
    """

    step: int
    heading_rad: float
    north_m: float
    east_m: float
    actions: tuple[int, ...]
    naive_path: int

    def __post_init__(self) -> None:
        """Rounds the state to float32; a number beyond its range becomes infinite, which no packet holds.

        Raises:
            TypeError: if an action is not an integer.
        """
        with np.errstate(over="ignore"):
            for name in ("heading_rad", "north_m", "east_m"):
                object.__setattr__(self, name, float(np.float32(getattr(self, name))))
        object.__setattr__(self, "actions", tuple(operator.index(action) for action in self.actions))

    @classmethod
    def at(cls, step: int, state: Array, actions: tuple[int, ...], naive_path: int) -> Plan:
        """The plan from a state (3,): heading (rad), north, east (m)."""
        heading, north, east = (float(v) for v in state)
        return cls(step=step, heading_rad=heading, north_m=north, east_m=east, actions=actions, naive_path=naive_path)

    @property
    def state(self) -> Array:
        """Heading (rad), north, east (m), shape (3,)."""
        return np.array([self.heading_rad, self.north_m, self.east_m])
