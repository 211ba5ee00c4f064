"""What a correction computes in a large map does not grow with the map, and is close to what all centers give."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from positions_helpers import STEADY, Ground, played, sail, surface

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.positions import PositionsConfig
from auv_lse_gp.covariance.kernels import Kernel
from auv_lse_gp.covariance.prior_mean import prior_mean
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.inference.tiled_posterior import TiledPosterior
from auv_lse_gp.intake import MapIntake
from auv_lse_gp.map import online
from auv_lse_gp.positions import (
    depth_sensitivity,
    gauss_newton,
    measurements,
    position_corrector,
    smoother,
    terrain_matching,
)
from auv_lse_gp.positions import track as track_module
from auv_lse_gp.positions.correction import Correction
from auv_lse_gp.positions.depth_sensitivity import DepthSensitivity
from auv_lse_gp.positions.error_model import TeamErrorModel, VehicleErrorModel
from auv_lse_gp.positions.measurements import Fixes, RangeMeasurement, Ranges
from auv_lse_gp.positions.position_corrector import PositionCorrector
from auv_lse_gp.positions.track import MateTrack, OwnTrack

CONFIG = PositionsConfig(**STEADY, correct=True, heading_std_deg=1.0)


def _mission(seed: int, gp: GpConfig, legs: int = 60, vehicles: int = 2, box_m: float = 400.0) -> MapIntake:
    rng = np.random.default_rng(seed)
    ground = Ground(rng, gp)
    team = [sail(rng, CONFIG, legs, box_m=box_m) for _ in range(vehicles)]
    surface(rng, team[0], 400)
    surface(rng, team[0], 12 * legs)
    return played(team, ground, CONFIG, gp)


@pytest.mark.parametrize(
    ("seed", "prior"),
    [
        (0, {}),
        (0, {"length_scale_2_m": 50.0, "rotation_deg": 30.0}),
        (1, {"length_scale_2_m": 50.0, "rotation_deg": 30.0}),
        (2, {"kernel": "wendland_c2"}),
    ],
    ids=["matern52", "anisotropic0", "anisotropic1", "wendland"],
)
def test_position_effects_are_close_to_those_of_dense_slopes(
    monkeypatch: pytest.MonkeyPatch, seed: int, prior: dict[str, float]
) -> None:
    """Tolerances: the position variance summed over the map within 6 %, a standard deviation within 4 % (rms)."""
    monkeypatch.setattr(online, "MAX_DENSE", 60)
    corrector = _mission(seed, GpConfig(**prior)).corrector
    assert corrector is not None
    found, correction = corrector.corrected_map, corrector.correction
    assert correction is not None
    gp = found.map.gp
    assert gp.is_tiled
    found.set_uncertainty(correction, 1)
    effect = gp.centers.position_effect_m
    assert effect is not None
    dense, seeds = Posterior(gp.config), found.seeds
    dense.follow(gp.centers)
    exact = DepthSensitivity(found.log)
    exact.update(correction, dense.slopes(gp.centers.locations_m), seeds)
    std, expected = (np.sqrt((each**2).sum(axis=1)) for each in (effect, exact.effect(1)))
    assert (std**2).sum() == pytest.approx((expected**2).sum(), rel=0.06)
    assert np.sqrt(((std - expected) ** 2).mean()) < 0.04 * np.sqrt((expected**2).mean())


@pytest.mark.parametrize(("most_dense", "between"), [(1000, 1.0), (60, 1.2)], ids=["dense", "tiled"])
@pytest.mark.parametrize("seed", [2, 3])
def test_centers_stay_close_to_their_corrected_positions(
    monkeypatch: pytest.MonkeyPatch, seed: int, most_dense: int, between: float
) -> None:
    """Tolerance: `positions.moved_m`; in tiles a fifth more between the centers at which positions are checked."""
    monkeypatch.setattr(online, "MAX_DENSE", most_dense)
    corrector = _mission(seed, GpConfig()).corrector
    assert corrector is not None
    assert corrector.correction is not None
    log, seeds = corrector.log, corrector.corrected_map.seeds
    off_m = np.linalg.norm(log.corrected_m(corrector.correction, seeds) - log.mapped_m[seeds], axis=1)
    assert np.quantile(off_m, 0.98) <= CONFIG.moved_m
    assert off_m.max() <= between * CONFIG.moved_m
    assert off_m.max() > 0.0, "not all centers move at each correction"


def test_sensitivities_of_a_correction_do_not_grow_with_the_map(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(online, "MAX_DENSE", 60)
    computed: list[tuple[int, int]] = []
    update, jacobian = DepthSensitivity.update, Correction.own_jacobian

    def counted(self: DepthSensitivity, correction: Correction, slopes: np.ndarray, seeds: np.ndarray) -> None:
        computed.append((len(seeds), 0))
        update(self, correction, slopes, seeds)

    def derived(self: Correction, vehicle: int, stamps_s: np.ndarray, raw_positions_m: np.ndarray) -> np.ndarray | None:
        if computed:
            computed[-1] = computed[-1][0], computed[-1][1] + len(stamps_s)
        return jacobian(self, vehicle, stamps_s, raw_positions_m)

    monkeypatch.setattr(DepthSensitivity, "update", counted)
    monkeypatch.setattr(Correction, "own_jacobian", derived)
    _mission(4, GpConfig(length_scale_m=25.0), legs=90, vehicles=1, box_m=900.0)
    sizes, rows = np.array([c for c in computed if c[0] > 60]).T
    assert sizes[-1] > 3 * 60
    early, late = np.median(rows[: len(rows) // 3]), np.median(rows[-len(rows) // 3 :])
    assert late <= 1.5 * early
    assert late < 0.25 * sizes[-1]


@pytest.mark.parametrize("of_mate", [False, True])
def test_sums_along_a_track_continue_those_of_an_older_model(of_mate: bool) -> None:
    """Bit by bit, also when knots are added or spaced wider, and when samples refine a mate's track."""
    sailed = sail(np.random.default_rng(5), CONFIG, 80)
    track: OwnTrack | MateTrack = MateTrack() if of_mate else OwnTrack()
    older, spans = None, set()
    config = PositionsConfig(correct=True, knot_s=40.0)
    for i in range(0, len(sailed.times), 7):
        track.add(float(sailed.times[i]), *sailed.raw[i].tolist())
        if isinstance(track, MateTrack) and i > 21:
            samples = np.array([i - 5.0, i - 12.0])[::-1]
            track.refine(samples, sailed.raw[samples.astype(int)])
        if i % 35:
            continue
        model = VehicleErrorModel(track, 0, config, older=older)
        anew = VehicleErrorModel(track, 0, config)
        assert np.array_equal(model._walk_m, anew._walk_m)
        older = model
        spans.add(model._span_s)
    assert len(spans) == 2


def test_model_of_a_long_track_positions_later_points_as_a_later_model_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tolerance: .1 m after 40 s, with unknowns as large as their prior standard deviations."""
    rng = np.random.default_rng(6)
    config = dataclasses.replace(CONFIG, knot_s=15.0, heading_walk_deg_rth=5.0)
    sailed, track = sail(rng, config, 60), OwnTrack()
    for i in range(1091):
        track.add(float(sailed.times[i]), *sailed.raw[i].tolist(), heading_rad=float(sailed.headings[i]))
    older = VehicleErrorModel(track, 0, config)
    assert older.is_long
    for i in range(1091, 1131):
        track.add(float(sailed.times[i]), *sailed.raw[i].tolist(), heading_rad=float(sailed.headings[i]))
    newer = VehicleErrorModel(track, 0, config)
    assert np.array_equal(newer.knots_s, older.knots_s)
    theta, points = older.prior_std(), track.at(sailed.times[1080:1131], sailed.raw[1080:1131])
    there = newer.positions(points).positions(theta)
    assert older.positions(points).positions(theta) == pytest.approx(there, abs=0.1)
    monkeypatch.setattr(VehicleErrorModel, "is_long", False)
    assert np.abs(older.positions(points).positions(theta) - there).max() > 0.3, "the heading's walk counts"


@pytest.mark.parametrize("seed", [0])
def test_position_in_a_long_mission_is_as_accurate_with_half_the_corrections(
    monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    """Tolerance: the error of the vehicle's position (root mean square) grows by at most a tenth."""
    config = dataclasses.replace(CONFIG, knot_s=20.0)
    rng = np.random.default_rng(seed)
    ground = Ground(rng, GpConfig())
    team = [sail(rng, config, 50, box_m=400.0) for _ in range(2)]
    for at_s in (300, 1100):
        surface(rng, team[0], at_s)
    step = PositionCorrector.step

    def flown(intervals: int) -> tuple[int, float]:
        corrected, off_m = [], []

        def noted(self: PositionCorrector, now_s: float) -> bool:
            corrected.append(step(self, now_s))
            if self.smoother.is_long and self.position is not None:
                off_m.append(np.array([self.position.north_m, self.position.east_m]) - team[0].true[round(now_s)])
            return corrected[-1]

        monkeypatch.setattr(PositionCorrector, "step", noted)
        monkeypatch.setattr(position_corrector, "LONG_INTERVALS", intervals)
        played(team, ground, config)
        return sum(corrected), float(np.sqrt((np.array(off_m) ** 2).sum(axis=1).mean()))

    (every, usual_m), (second, error_m) = flown(1), flown(2)
    assert second < 0.75 * every
    assert error_m < 1.1 * usual_m


@pytest.mark.parametrize("off_m", [0.5, 30.0, 400.0])
def test_samples_are_compared_with_segments_near_them_only_and_get_the_times_of_a_search_of_all(
    monkeypatch: pytest.MonkeyPatch, off_m: float
) -> None:
    rng = np.random.default_rng(8)
    sailed, track = sail(rng, CONFIG, 200, box_m=1000.0), MateTrack()
    for at in range(0, len(sailed.times), 5):
        track.add(float(at), *sailed.raw[at])
    compared: list[int] = []
    search = track_module._in_order

    def counted(nodes: np.ndarray, segments: np.ndarray, raw_m: np.ndarray) -> tuple[float, np.ndarray]:
        compared.append(len(segments))
        return search(nodes, segments, raw_m)

    monkeypatch.setattr(track_module, "_in_order", counted)
    segments = len(track) - 1
    for _ in range(20):
        chosen = np.sort(rng.integers(0, len(sailed.times), 14))
        samples = sailed.raw[chosen] + off_m * rng.uniform(-1.0, 1.0, (14, 2))
        found = track.times_of(samples)
        assert np.array_equal(found, search(track.nodes, np.arange(segments), samples)[1])
    assert off_m > 1.0 or max(compared) < 0.5 * segments


def test_estimate_and_effects_of_many_unknowns_are_those_of_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tolerances: rounding of the estimate, which is large in directions that the depths hardly determine."""
    rng, gp = np.random.default_rng(3), GpConfig()
    ground = Ground(rng, gp)
    team = [sail(rng, CONFIG, 40) for _ in range(3)]
    corrector = played(team, ground, CONFIG, gp).corrector
    assert corrector is not None
    segments, precision = corrector.log.segments(), corrector.smoother._model().prior_std() ** -2.0
    theta = np.array(corrector.smoother.theta)
    found = []
    for limit in (10_000, 0):
        monkeypatch.setattr(terrain_matching, "MANY_UNKNOWNS", limit)
        monkeypatch.setattr(depth_sensitivity, "MANY_UNKNOWNS", limit)
        terrain = terrain_matching.Terrain(segments, Kernel(gp), prior_mean(gp), gp.noise_std_m)
        likelihood = terrain_matching.TerrainLikelihood(corrector.smoother._model(), terrain)
        corrector.corrected_map.set_uncertainty(corrector.correction, 1)
        effect = corrector.corrected_map.map.gp.centers.position_effect_m
        found.append([*likelihood.gradient(theta, precision), effect @ effect.T])
    for few, many in zip(*found, strict=True):
        assert np.abs(many - few).max() <= 1e-6 * np.abs(few).max()


def test_ranges_of_a_large_team_are_computed_together_as_pair_by_pair(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    tracks: dict[int, track_module.Track] = {}
    for number, lasted_s in ((1, 900), (2, 400), (3, 700)):  # with different numbers of knots
        track, at = OwnTrack(), rng.normal(0.0, 20.0, 2)
        for t in range(lasted_s):
            at += np.array([np.cos(0.01 * t), np.sin(0.01 * t)])
            track.add(float(t), *at.tolist())
        tracks[number] = track
    model = TeamErrorModel(PositionsConfig(), tracks, {1})
    assert len({vehicle.knots for vehicle in model.vehicles.values()}) == 3
    pairs = [(2, 1, False), (3, 1, False), (3, 1, True), (2, 3, False)]
    rows = [
        RangeMeasurement(
            sender=sender, receiver=receiver, sent_s=50.0 * i, arrived_s=50.0 * i + 0.2, range_m=300.0, by_ping=by_ping
        )
        for i, (sender, receiver, by_ping) in enumerate(pairs * 2)
    ]
    theta = 0.3 * model.prior_std() * rng.normal(size=model.size)
    found = []
    for limit in (model.size, model.size - 1):
        monkeypatch.setattr(measurements, "MANY_UNKNOWNS", limit)
        ranges = Ranges(model, rows)
        found.append((ranges.residuals(theta), ranges.derivatives(theta)))
        search = gauss_newton._Search(model.prior_std() ** -2.0, Fixes(model, []), ranges)
        monkeypatch.setattr(gauss_newton, "MANY_UNKNOWNS", limit)
        found[-1] += search.normal(theta, gauss_newton.Huber())
        found[-1] += (gauss_newton._inverse(found[-1][-1]),)
    for few, many in zip(*found, strict=True):
        assert np.abs(many - few).max() <= 1e-10 * np.abs(few).max()


def test_each_further_range_leaves_out_one_more_and_every_sender_keeps_its_share() -> None:
    rows = [
        RangeMeasurement(sender=2 + i % 3, receiver=1, sent_s=float(i), arrived_s=float(i), range_m=100.0)
        for i in range(1000)
    ]
    before: set[float] = set()
    for count in range(len(rows)):
        kept = smoother.thinned(rows[:count], 60)
        stamps = [row.sent_s for row in kept]
        assert len(kept) == min(count, 60)
        assert stamps == sorted(stamps)
        assert len(before - set(stamps)) <= 1
        before = set(stamps)
    assert {sum(row.sender == sender for row in kept) for sender in (2, 3, 4)} == {20}
    gaps = np.diff([row.sent_s for row in kept if row.sender == 2])
    assert gaps.max() <= 4.0 * gaps.min(), "at most every second of every second one is left out more often"


@pytest.mark.parametrize("packets", [1, 3])
def test_each_tile_is_solved_once_for_the_samples_in_it(monkeypatch: pytest.MonkeyPatch, packets: int) -> None:
    monkeypatch.setattr(online, "MAX_DENSE", 5)
    gp = online.OnlineGp(GpConfig(min_spacing_m=5.0))
    rng = np.random.default_rng(1)
    positions = rng.uniform(0.0, 600.0, (200, 2))
    gp.add_all(np.column_stack([positions, 15.0 + 0.01 * positions[:, 0]]))
    samples = np.column_stack([rng.uniform(0.0, 600.0, (60, 2)), rng.normal(15.0, 2.0, 60)])
    solved: list[tuple[int, int]] = []
    rough = TiledPosterior._rough

    def counted(self: TiledPosterior, tile: tuple[int, int]) -> Posterior:
        solved.append(tile)
        return rough(self, tile)

    monkeypatch.setattr(TiledPosterior, "_rough", counted)
    gp.add_if_fitting(samples, 4.0, 60, np.arange(60) * packets // 60)
    assert len(solved) == len(set(solved)) > 4
