"""Made-up tracks of a team, their raw dead reckoning, fixes, ranges and soundings, for the tests of positions."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.positions import PositionsConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix, MateNavigation
from auv_lse_gp.covariance.kernels import Kernel
from auv_lse_gp.covariance.prior_mean import prior_mean
from auv_lse_gp.intake import MapIntake
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.positions.position_corrector import PositionCorrector
from auv_lse_gp.positions.smoother import PositionSmoother
from auv_lse_gp.positions.terrain_matching import Terrain
from auv_lse_gp.positions.track_segments import segment_track

LEG_M = 24.0
#: Area and parameters of the map that `played` returns.
AREA = OperatingArea(AreaConfig(polygon_m=(-300.0, -300.0, 300.0, -300.0, 300.0, 300.0, -300.0, 300.0)))
GP = GpConfig()
#: Parameters of `sail` and of the estimator for what shows how well it solves: a compass with errors that no filter has
#: estimated, and a log that wanders little, so that most of the error can be found.
STEADY: dict[str, Any] = {"harmonic_std_deg": 1.0, "position_walk_m_rts": 0.02}
#: What a packet tells: of its sender's navigation, and the dead-reckoned positions of its samples (n, 2).
Heard = tuple[MateNavigation, Array]


@dataclass
class Sailed:
    """What one vehicle did, second by second: times (n,), true and dead-reckoned positions (n, 2), headings by its
    compass (n,)."""

    times: Array
    true: Array
    raw: Array
    headings: Array
    clock_s: float
    fixes: list[Fix] = field(default_factory=list)


def sail(
    rng: np.random.Generator, config: PositionsConfig, legs: int = 100, box_m: float = 500.0, walks: bool = True
) -> Sailed:
    """A vehicle that turns about a box for `legs` legs of 24 s, with errors drawn from what `config` supposes."""
    n = legs * int(LEG_M)
    heading = np.empty(n)
    position, way = np.zeros(2), np.empty((n, 2))
    now, turn = rng.uniform(0.0, 2.0 * math.pi), 0.0
    for i in range(n):
        if i % int(LEG_M) == 0:
            turn = math.radians(rng.choice([-45.0, 0.0, 0.0, 45.0])) / 12.0
            out = np.maximum(np.abs(position) - box_m / 2.0, 0.0)
            if out.any():
                home = math.atan2(-position[1], -position[0])
                turn = math.copysign(math.radians(4.0), math.remainder(home - now, 2.0 * math.pi))
        now += turn if i % int(LEG_M) < 12 else 0.0
        heading[i] = now
        way[i] = math.cos(now), math.sin(now)
        position = position + way[i]
    true = np.concatenate([np.zeros((1, 2)), np.cumsum(way, axis=0)])
    deg = math.pi / 180.0
    offset = config.start_std_m * rng.standard_normal(2)
    bias = config.heading_std_deg * deg * rng.standard_normal()
    harmonics = config.harmonic_std_deg * deg * rng.standard_normal(2)
    scale = config.scale_std * rng.standard_normal()
    walk = np.zeros(n)
    wander = np.zeros((n, 2))
    if walks:
        walk = np.cumsum(rng.standard_normal(n)) * config.heading_walk_deg_rth * deg / 60.0
        wander = config.position_walk_m_rts * rng.standard_normal((n, 2))
    # The compass shows more than is true by its error, which goes with what it shows.
    shown = heading.copy()
    for _ in range(3):
        shown = heading + bias + harmonics[0] * np.sin(shown) + harmonics[1] * np.cos(shown) + walk
    raw_way = (1.0 + scale) * np.column_stack([np.cos(shown), np.sin(shown)]) + wander
    raw = offset + np.concatenate([np.zeros((1, 2)), np.cumsum(raw_way, axis=0)])
    headings = np.concatenate([shown[:1], shown])
    return Sailed(np.arange(n + 1.0), true, raw, headings, config.clock_std_s * rng.standard_normal())


def surface(rng: np.random.Generator, sailed: Sailed, at_s: int, std_m: float = 1.0) -> None:
    """Gives a vehicle a fix at a time."""
    position = sailed.true[at_s] + std_m * rng.standard_normal(2)
    raw = sailed.raw[at_s]
    sailed.fixes.append(
        Fix(
            stamp_s=float(at_s),
            north_m=float(position[0]),
            east_m=float(position[1]),
            raw_north_m=float(raw[0]),
            raw_east_m=float(raw[1]),
            std_m=std_m,
        )
    )


def messages(
    rng: np.random.Generator,
    team: list[Sailed],
    receiver: int,
    *,
    slot_s: int = 10,
    noise_m: float = 1.0,
    sound: float = 0.0,
    outliers: float = 0.0,
    lost: float = 0.0,
) -> list[Heard]:
    """What vehicle `receiver` (from 0) hears of the others, one packet in each slot: navigation, positions of
    samples."""
    heard: list[Heard] = []
    unsent: dict[int, list[int]] = {k: [] for k in range(len(team))}
    told_until = dict.fromkeys(unsent, 0)
    end = len(team[0].times) - 1
    for slot, at in enumerate(range(slot_s, end, slot_s)):
        sender = slot % len(team)
        if sender == receiver or rng.random() < lost:
            continue
        mate, own = team[sender], team[receiver]
        apart = float(np.linalg.norm(mate.true[at] - own.true[at]))
        measured = (1.0 + sound) * apart + noise_m * rng.standard_normal()
        measured += 1500.0 * (own.clock_s - mate.clock_s)
        if rng.random() < outliers:
            measured += rng.exponential(30.0)
        fixes = [fix for fix in mate.fixes if fix.stamp_s <= at]
        told = {}
        if fixes:
            last = fixes[-1]
            told = {
                "fix_north_m": last.north_m,
                "fix_east_m": last.east_m,
                "fix_raw_north_m": last.raw_north_m,
                "fix_raw_east_m": last.raw_east_m,
            }
        unsent[sender].extend(range(told_until[sender], at))
        told_until[sender] = at
        chosen = np.rint(np.linspace(0.0, len(unsent[sender]) - 1.0, min(14, len(unsent[sender])))).astype(int)
        mates_samples = mate.raw[[unsent[sender][i] for i in chosen]]
        unsent[sender] = [i for n, i in enumerate(unsent[sender]) if n not in set(chosen.tolist())]
        navigation = MateNavigation(
            stamp_s=at + measured / 1500.0,
            source=sender + 1,
            sent_s=float(at),
            raw_north_m=float(mate.raw[at, 0]),
            raw_east_m=float(mate.raw[at, 1]),
            travel_s=measured / 1500.0,
            **told,
        )
        heard.append((navigation, mates_samples))
    return heard


def smoother_of(config: PositionsConfig, team: list[Sailed], own: int, heard: list[Heard]) -> PositionSmoother:
    """A smoother of vehicle `own` (from 0) that has been told everything."""
    smoother = PositionSmoother(own + 1, config)
    mine = team[own]
    for t, (north, east), heading in zip(mine.times, mine.raw, mine.headings, strict=True):
        smoother.add_dead_reckoning(
            DeadReckoning(stamp_s=t, heading_rad=heading, north_m=north, east_m=east, depth_m=3.0)
        )
    for fix in mine.fixes:
        smoother.add_fix(fix)
    for mate, samples in heard:
        smoother.add_navigation(mate)
        smoother.add_sample_positions(mate.source, samples)
    return smoother


class Ground:
    """A made-up ground, drawn from the prior of the map by random Fourier features."""

    def __init__(self, rng: np.random.Generator, gp: GpConfig, features: int = 400) -> None:
        """Draws a ground with the spectrum of a Matern 5/2 kernel."""
        chi = rng.chisquare(5.0, size=(features, 1)) / 5.0
        self._waves = rng.standard_normal((features, 2)) / gp.length_scale_m / np.sqrt(chi)
        self._phases = rng.uniform(0.0, 2.0 * math.pi, features)
        self._size = gp.signal_std_m * math.sqrt(2.0 / features)
        self._mean = gp.mean_depth_m

    def depth_m(self, positions: Array) -> Array:
        """Depth (n,) at positions (n, 2)."""
        return self._mean + self._size * np.cos(positions @ self._waves.T + self._phases).sum(axis=1)


def terrain_of(rng: np.random.Generator, team: list[Sailed], own: int, ground: Ground, gp: GpConfig) -> Terrain:
    """Soundings of all: every second of the own vehicle, every second one of a mate, each at its dead-reckoned
    position."""
    rows = []
    for number, sailed in enumerate(team):
        every = slice(None, None, 1 if number == own else 2)
        depths = ground.depth_m(sailed.true) + 0.05 * rng.standard_normal(len(sailed.true))
        vehicle = np.full(len(depths), number + 1)
        rows.append(np.column_stack([vehicle, sailed.times, sailed.raw, depths])[every])
    all_rows = np.concatenate(rows)
    pieces = segment_track(all_rows[:, 0].astype(np.int64), all_rows[:, 1], all_rows[:, 2:4], all_rows[:, 4])
    return Terrain(pieces, Kernel(gp), prior_mean(gp), gp.noise_std_m)


def played(team: list[Sailed], ground: Ground, config: PositionsConfig, gp: GpConfig = GP) -> MapIntake:
    """The first vehicle's map after it has received all its inputs, tick by tick."""
    rng = np.random.default_rng(5)
    depth_map = DepthMap(gp, LevelSet(), AREA)
    intake = MapIntake(depth_map, PositionCorrector(1, config, depth_map))
    heard = messages(rng, team, 0)
    own, depths = team[0], [ground.depth_m(sailed.true) for sailed in team]
    for i, t in enumerate(own.times.tolist()):
        north, east = own.raw[i]
        intake.add_dead_reckoning(
            DeadReckoning(stamp_s=t, heading_rad=own.headings[i], north_m=north, east_m=east, depth_m=3.0)
        )
        intake.add_soundings([(t, north, east, depths[0][i], north, east)])
        for fix in own.fixes:
            if fix.stamp_s == t:
                intake.add_fix(fix)
        for mate, samples in [entry for entry in heard if t - 1.0 < entry[0].sent_s <= t]:
            at = [int(np.argmin(((team[mate.source - 1].raw - s) ** 2).sum(axis=1))) for s in samples]
            intake.add_navigation(mate)
            intake.add_samples(t, mate.source, np.column_stack([samples, depths[mate.source - 1][at]]))
        intake.step(t)
    return intake
