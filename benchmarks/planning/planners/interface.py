"""The interface of a planner: implement `Planner` in one file, and the benchmark flies it.

A file with a function `planner()`, or an entry point of the group `auv_lse.planners` that names one, adds a planner:

    class Ahead:
        replan_legs = None

        def path(self, view):
            return view.position_m + [[0.0, 100.0]]

    def planner():
        return Ahead()
"""

import dataclasses
import importlib.metadata
import importlib.util
import sys
import traceback
from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from numbers import Integral
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.plan import NONE
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_planner.methods.method import Choice, PlanningContext, Situation
from auv_lse_planner.methods.path_method import PathMethod
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_planner.paths.steering import Steering
from auv_lse_planner.reward.anytime import Value
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.path_search import Proposal
from auv_lse_planner.search.routing import Ground
from auv_lse_planner.search.uct import SearchResult
from benchmarks.planning.planners.options import HINDSIGHT, OURS, RIVAL_NAMES

T = TypeVar("T")

#: Legs without coming closer to a waypoint after which it is left out: it cannot be reached.
GIVE_UP_LEGS = 6
#: Entry-point group of planners from other packages.
GROUP = "auv_lse.planners"


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """The knowledge of a planner. Arrays are copies.

    Attributes:
        locations_m: Soundings: north, east (n, 2), those of mates that were received among them.
        depths_m: Their depths (n,).
        noise_std_m: Their standard deviations (n,).
        prior: The prior of the depth.
        posterior: The vehicle's posterior, which a planner must not write to; `with_planned` makes another one.
        level_m: Depth of the isobath.
        area: Operating area with no-go areas; vehicles keep `area.margin_m` from its border.
        cells_m: Centers (P, 2) of cells of the area, 20 m apart, without those too close to its border for a vehicle.
        position_m: The vehicle's position (2,).
        heading_rad: Its heading.
        legs_left: Legs that it may still travel, of `leg_m` each.
        motion: The legs that the vehicle can travel.
        vehicle: Its number in the team, from 1.
        mates_m: For each mate, the locations (p, 2) that it is about to measure; none without a known plan.
        rng: Source of every random number.
    """

    locations_m: Array
    depths_m: Array
    noise_std_m: Array
    prior: GpConfig
    posterior: Posterior
    level_m: float
    area: OperatingArea
    cells_m: Array
    position_m: Array
    heading_rad: float
    legs_left: int
    leg_m: float
    motion: MotionTable
    vehicle: int
    mates_m: list[Array]
    rng: np.random.Generator


class Planner(Protocol):
    """A planner of one vehicle.

    Attributes:
        replan_legs: Legs after which it is asked again; None: when its path has been travelled.
    """

    replan_legs: int | None

    def path(self, view: View) -> Array:
        """The next waypoints (n, 2), north and east (m): one, some, or a path for the rest of the mission."""
        ...


class Steered(PathMethod):
    """Flies a planner as a method of ours: our steering follows its waypoints, around known land."""

    def __init__(self, planner: Planner, context: PlanningContext) -> None:
        super().__init__(context)
        self._planner, self._steering, self._ground = planner, Steering(context.space), Ground(context.space)
        self._line_m = np.empty((0, 2))  # the rest of its path
        self._asked_at = -1
        self._nearest = (np.inf, 0)  # least distance (m) to its first location, and the step

    def keeps(self, incumbent: Value, new: Value) -> bool:
        """Never: the planner decides."""
        return False

    def propose(self, situation: Situation, reward: PathReward) -> Proposal:
        """The legs along the planner's path."""
        s, context = situation, self.context
        here, leg_m = np.asarray(s.state[1:], dtype=float), context.space.motion.leg_length_m
        if len(self._line_m):  # drop what has been passed
            far = np.hypot(*(self._line_m - here).T) >= 0.75 * leg_m
            if far.all():
                passed = int(self._is_out_of_reach(here, s.step))
            else:  # the first ones near, and what comes before them
                first = int(np.argmin(far))
                passed = first + (int(np.argmax(far[first:])) or len(far) - first)
            if passed:
                self._line_m, self._nearest = self._line_m[passed:], (np.inf, s.step)
        every = self._planner.replan_legs
        if not len(self._line_m) or (every is not None and s.step - self._asked_at >= every):
            self._line_m = self._around_land(here, waypoints_of(self._answer(s), s.step))
            self._asked_at, self._nearest = s.step, (np.inf, s.step)
        line = np.concatenate([here[None], self._line_m, self._line_m[-1:] + 1.0])
        length_m = float(np.hypot(*np.diff(line, axis=0).T).sum())
        legs = int(np.clip(np.ceil(length_m / leg_m), 1, min(200, context.rollout.steps - s.step)))
        actions = self._steering.along(s.state, line, leg_m, legs, around_shallows=True)
        return Proposal(SearchResult(tuple(int(a) for a in actions), 0.0), NONE)

    def _answer(self, s: Situation) -> Any:
        """What the planner returns; its errors as ValueError with the last line of its file that ran."""
        view = self._view(s)
        return _call(lambda: self._planner.path(view), f"step {s.step}")

    def _around_land(self, here_m: Array, asked_m: Array) -> Array:
        """The waypoints (n, 2) with those on the way between them, where the straight way leads over land."""
        south, north, west, east = OperatingArea(self.context.settings.area).extent_m
        within_m = np.clip(np.concatenate([here_m[None], asked_m]), [south, west], [north, east])
        _, bends = self._ground.distances_cm(np.rint(100.0 * within_m).astype(np.int64))
        none = np.empty((0, 2))
        parts = [part for i, to in enumerate(asked_m) for part in (0.01 * bends.get((i, i + 1), none), to[None])]
        return np.concatenate(parts) if parts else none

    def _is_out_of_reach(self, here_m: Array, step: int) -> bool:
        """Whether the vehicle has stopped coming closer to its first waypoint."""
        off_m = float(np.hypot(*(self._line_m[0] - here_m)))
        if off_m < self._nearest[0]:
            self._nearest = off_m, step
        return step - self._nearest[1] >= GIVE_UP_LEGS

    def remember(self, situation: Situation, proposal: Proposal, choice: Choice) -> None:
        """Nothing to prepare."""

    def _view(self, s: Situation) -> View:
        context, settings = self.context, self.context.settings
        known, area = context.posterior.centers, OperatingArea(settings.area)
        cells_m = context.map_grid.locations_m
        return View(
            locations_m=known.locations_m.copy(),
            depths_m=known.depths_m.copy(),
            noise_std_m=known.noise_std_m.copy(),
            prior=settings.gp,
            posterior=context.posterior,
            level_m=settings.level_set.level_m,
            area=area,
            cells_m=cells_m[area.clearance_m(cells_m) >= area.margin_m],
            position_m=np.array(s.state[1:], dtype=float),
            heading_rad=float(s.state[0]),
            legs_left=context.rollout.steps - s.step,
            leg_m=context.space.motion.leg_length_m,
            motion=context.space.motion,
            vehicle=len(context.team.before) + 1,
            mates_m=[context.team.locations_ahead(s.now_s, mate) for mate in context.team.others],
            rng=context.rng,
        )


def waypoints_of(answer: Any, step: int) -> Array:
    """What a planner's `path` returned at a step, as waypoints (n, 2); one (2,) is a row.

    Raises:
        ValueError: if these are not waypoints: another shape, none at all, or values that are not finite.
    """
    try:
        waypoints_m = np.atleast_2d(np.asarray(answer, dtype=float))
    except (TypeError, ValueError) as error:
        raise ValueError(f"step {step}: path() must return waypoints (n, 2) in metres, not {answer!r:.60}.") from error
    if waypoints_m.ndim != 2 or waypoints_m.shape[1] != 2 or not len(waypoints_m):
        shape = np.shape(answer)
        raise ValueError(f"step {step}: path() must return waypoints (n, 2), n at least 1, not the shape {shape}.")
    if not np.isfinite(waypoints_m).all():
        bad = waypoints_m[~np.isfinite(waypoints_m).all(axis=1)][0].tolist()
        raise ValueError(f"step {step}: path() returned the waypoint {bad}; return finite metres.")
    return waypoints_m


def _call(call: Callable[[], T], where: str) -> T:
    """What code of others returns; its errors as ValueError with the last line of its file that ran."""
    try:
        return call()
    except (Exception, SystemExit) as error:
        frames = [frame for frame in traceback.extract_tb(error.__traceback__) if not _is_machinery(frame.filename)]
        lines = [frame for frame in frames if frame.filename == frames[0].filename]
        at = f"{lines[-1].filename}, line {lines[-1].lineno}, in {lines[-1].name}: " if lines else ""
        raise ValueError(f"{where}: {at}{type(error).__name__}: {error}") from error


def _is_machinery(file: str) -> bool:
    """Whether a frame is that of this module or of an import."""
    return file in (__file__, importlib.metadata.__file__, importlib.__file__) or file.startswith("<frozen")


def loaded(name: str) -> Callable[[], Planner]:
    """The function that makes a planner, from a Python file or by the name of an entry point.

    Raises:
        ValueError: if there is no such planner (the text names the known ones), or it cannot be loaded.
    """
    if not name.endswith(".py"):
        point = entry_point(name)
        if point is None:
            known = ", ".join([*OURS, *RIVAL_NAMES, HINDSIGHT, *sorted(entry_points(group=GROUP).names)])
            raise ValueError(f"There is no planner {name}. Use one of {known}, or a Python file.")
        load: Callable[[], Callable[[], Planner]] = point.load
        return _call(load, name)
    found = importlib.util.spec_from_file_location(f"planner in {name}", name)
    if found is None or found.loader is None or not Path(name).is_file():
        raise ValueError(f"There is no planner file {name}.")
    module = importlib.util.module_from_spec(found)
    sys.modules[module.__name__] = module  # dataclasses and pickle look for it there
    loader = found.loader
    _call(lambda: loader.exec_module(module), name)
    make: Callable[[], Planner] | None = getattr(module, "planner", None)
    if not callable(make):
        raise ValueError(f"{name} has no function planner(); see benchmarks/planning/planners/interface.py.")
    return make


def made(make: Callable[[], Planner]) -> Planner:
    """The planner of one vehicle.

    Raises:
        ValueError: if `make` fails, or returns no planner.
    """
    planner = _call(make, "planner()")
    every = getattr(planner, "replan_legs", "missing")
    is_whole = isinstance(every, Integral) and not isinstance(every, bool) and int(every) > 0
    if not callable(getattr(planner, "path", None)) or not (every is None or is_whole):
        raise ValueError(
            "planner() must return an object with path(view) and replan_legs, which is None or a whole number of legs "
            f"from 1, not {type(planner).__name__} with replan_legs {every!r}."
        )
    return planner


def source_of(name: str) -> bytes:
    """Source of a planner: its file, or the Python files of its entry point's package; none for a name of ours."""
    if name.endswith(".py"):
        return Path(name).read_bytes()
    point = entry_point(name)
    package = importlib.util.find_spec(point.module.split(".")[0]) if point else None
    if package is None:
        return b""
    files = [path for folder in package.submodule_search_locations or () for path in Path(folder).rglob("*.py")]
    return b"".join(path.read_bytes() for path in sorted(files) or [Path(str(package.origin))])


def entry_point(name: str) -> EntryPoint | None:
    """The entry point of that name in an installed package; None without one."""
    return next(iter(entry_points(group=GROUP, name=name)), None)
