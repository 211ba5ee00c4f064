"""Sections `mission` and `motion`: what all vehicles of a mission share."""

from __future__ import annotations

from dataclasses import dataclass

from auv_lse_common.mission_file.parameters import parameter
from auv_lse_common.vocabulary.plan import MAX_ACTION_SET


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionConfig:
    """What all vehicles of a mission share."""

    steps: int = parameter(100, low=1, high=65535, help="actions each vehicle takes (paper: l)")
    seed: int = parameter(1, low=0, help="seed of every random stream of the mission")
    vehicles: int = parameter(3, low=1, high=20, help="number of vehicles (paper: K); they are numbered from 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionConfig:
    """The paper's section 4: an arc at the turning radius, then a straight."""

    turn_radius_m: float = parameter(15.0, unit="m", above=0.0, help="turning radius (paper: r)")
    theta_max_deg: float = parameter(90.0, unit="deg", above=0.0, high=180.0, help="largest heading change (theta_max)")
    actions_deg: tuple[float, ...] = parameter(
        (-90.0, -30.0, -20.0, -10.0, -5.0, 0.0, 5.0, 10.0, 20.0, 30.0, 90.0),
        unit="deg",
        low=-180.0,
        high=180.0,
        help="heading changes that can be chosen (paper: A), positive clockwise",
    )
    straight: str = parameter(
        "constant",
        choices=("constant", "growing"),
        help="the straight after a turn: 'constant' r (theta_max - |a|), every leg is as long; "
        "'growing' r (theta_max + |a|), as the paper prints it",
    )
    track_spacing_m: float = parameter(1.0, unit="m", above=0.0, help="spacing at which tracks are checked")

    def __post_init__(self) -> None:
        """Checks what holds between the fields.

        Raises:
            ValueError: naming the actions that cannot be used.
        """
        if not self.actions_deg:
            raise ValueError("motion.actions_deg: is empty; expected at least one heading change (deg)")
        if len(self.actions_deg) > MAX_ACTION_SET:
            raise ValueError(
                f"motion.actions_deg: has {len(self.actions_deg)} values; expected at most {MAX_ACTION_SET}, which a "
                "packet's byte tells from what ends the actions"
            )
        if len(set(self.actions_deg)) != len(self.actions_deg):
            raise ValueError(f"motion.actions_deg: {list(self.actions_deg)} names a heading change twice")
        largest = max(abs(a) for a in self.actions_deg)
        if largest > self.theta_max_deg:
            raise ValueError(
                f"motion.actions_deg: {largest:g} deg exceeds motion.theta_max_deg = {self.theta_max_deg:g} deg"
            )
        if min(self.actions_deg) >= 0.0 and max(self.actions_deg) <= 0.0:
            raise ValueError(f"motion.actions_deg: {list(self.actions_deg)} has no turn, so no way to stay")
