"""The posterior of a large map, tile by tile: a tile is conditioned on the centers near it only.

The cost of a new center is that of the tiles near it, however large the map is. Distances are in the kernel's axes and
lengths, so that they hold for every length scale and anisotropy.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_gp.inference.centers import NO_CENTERS, Centers
from auv_lse_gp.inference.posterior import Posterior, checked_locations
from auv_lse_gp.inference.posterior_in_parts import extend_in_parts
from auv_lse_gp.inference.roughness import Roughness, scale_of, steepness
from auv_lse_gp.inference.work import FUNCTION, Work, finish, rows_per_part

Corner = tuple[int, int]

#: Distance from a tile up to which centers count, in kernel lengths (of a Wendland kernel: supports).
MARGIN = {"matern52": 3.75, "squared_exponential": 10.0, "wendland_c2": 1.25}
#: Shift of centers (kernel lengths) relative to their neighbors' mean up to which slopes at centers are kept.
SLOPES_MOVED = 0.05
#: Locations (kernel lengths) that differ by less are the same.
_ROUNDING = 1e-9
#: Share of the margin for slopes at centers and for gates, which need no more accuracy.
ROUGH_SHARE = 0.5
#: Number of the last tiles whose rough posteriors are kept: those near the vehicle and near its mates' last samples.
KEPT_TILES = 40
#: Slopes of a tile are recomputed when it has new centers, or when this many centers within this share of the margin
#: are new or have changed.
SLOPES_CHANGED, SLOPES_SHARE = 4, 1.0 / 3.0
#: Centers within this share of the margin count as close to a tile.
CLOSE_SHARE = 0.25
#: Tiles on each side of the squares in which many planned locations are taken together.
PLANNED_TILES = 2
#: Operations (`inference/work.py`) charged for finding a tile's data, however few the data.
DATA = 8000.0
#: A tile is recomputed if the position effect of a center near it has changed by this share of the largest.
EFFECT_SHARE = 0.02


@dataclass(frozen=True, slots=True)
class _Data:
    """The data that a tile's results depend on.

    Attributes:
        centers: Hash of the centers.
        count: Number of them.
        close: Number of those within `CLOSE_SHARE` of the margin.
        effect_m: Size of their position effects (n,); None if positions are assumed exact.
    """

    centers: int
    count: int
    close: int
    effect_m: Array | None

    def same(self, other: _Data) -> bool:
        """Whether the other data give the same results, within `EFFECT_SHARE`."""
        a, b = self.effect_m, other.effect_m
        if self.centers != other.centers or (a is None) != (b is None):
            return False
        if a is None or b is None:
            return True
        largest = max(float(b.max(initial=0.0)), 1e-6)
        return a.shape == b.shape and bool(np.abs(a - b).max(initial=0.0) <= EFFECT_SHARE * largest)


@dataclass(frozen=True, slots=True)
class _Near:
    """The centers in a tile, and those near it: numbers; locations before any shift, depths and noise; shifts."""

    members: Ints
    numbers: Ints
    data: Array
    drift: Array

    def same_slopes(self, other: _Near) -> bool:
        """Whether slopes from the other data hold for these: same members, few changes, small relative shifts.

        The limits are `SLOPES_CHANGED` and `SLOPES_MOVED`.
        """
        if not np.array_equal(self.members, other.members):
            return False
        both, mine, theirs = np.intersect1d(self.numbers, other.numbers, assume_unique=True, return_indices=True)
        changed = np.abs(self.data[mine] - other.data[theirs]).max(axis=1, initial=0.0) > _ROUNDING
        if len(self.numbers) + len(other.numbers) - 2 * len(both) + int(changed.sum()) >= SLOPES_CHANGED:
            return False
        moved = self.drift[mine] - other.drift[theirs]
        return not moved.any() or bool(np.abs(moved - moved.mean(axis=0)).max() <= SLOPES_MOVED)


class _Locations:
    """Locations in the kernel's axes and lengths (n, 2), sorted by the first axis for fast search.

    Attributes:
        scaled: The locations in their order.
    """

    def __init__(self, scaled: Array) -> None:
        self.scaled = scaled
        self._sorted: tuple[Ints, Array] | None = None

    def near(self, low: Array, high: Array, reach: float) -> Ints:
        """Numbers of the locations within `reach` of the rectangle between two corners (2,), ascending."""
        if self._sorted is None:
            order = np.argsort(self.scaled[:, 0], kind="stable")
            self._sorted = order, self.scaled[order]
        order, locations = self._sorted
        strip = slice(*np.searchsorted(locations[:, 0], (low[0] - 1.01 * reach, high[0] + 1.01 * reach)))
        gap = np.maximum(np.maximum(low - locations[strip], locations[strip] - high), 0.0)
        return np.sort(order[strip][np.einsum("nd,nd->n", gap, gap) <= reach**2])


class TiledPosterior:
    """The posterior of the depth given many centers, each location given those near its tile."""

    def __init__(self, prior: Posterior) -> None:
        """Starts with no data.

        Args:
            prior: A posterior with the same prior.
        """
        self._prior = prior.blank()
        self._margin = MARGIN[prior.kernel.name]
        self._side = 0.5 * self._margin
        self._centers = NO_CENTERS
        self._locations = _Locations(np.zeros((0, 2)))
        self._effect_std_m: Array | None = None
        self._kept: dict[Corner, Posterior] = {}  # the last used comes last
        self._slopes: dict[Corner, tuple[_Near, Array]] = {}
        self._slope_rows: Array | None = None  # the centers of the last slopes: home, drift, depth, noise, slope (n, 8)
        self._drift = np.zeros((0, 2))  # how far the first centers were shifted since `forget`

    @property
    def centers(self) -> Centers:
        """The data."""
        return self._centers

    def follow(self, centers: Centers) -> None:
        """Replaces the data; fast if the old centers come first."""
        self._centers, effect = centers, centers.position_effect_m
        self._locations = _Locations(self._prior.kernel.scale(centers.locations_m))
        self._effect_std_m = None if effect is None else np.sqrt(np.einsum("nr,nr->n", effect, effect))

    def forget(self) -> None:
        """Forgets slopes, shifts and posteriors, so that the next results depend on the data alone."""
        self._kept.clear()
        self._slopes.clear()
        self._slope_rows = None
        self._drift = np.zeros((0, 2))

    def shift(self, by_m: Array) -> None:
        """Announces that the next data are the same centers, moved by (n, 2): `slopes` keeps their tiles."""
        drift = self._prior.kernel.scale(by_m)
        drift[: len(self._drift)] += self._drift
        self._drift = drift

    def near(self, locations_m: Array) -> Iterator[tuple[Ints, Posterior]]:
        """For each tile of locations (P, 2): the numbers of the locations in it, and a rough posterior (`ROUGH_SHARE`).

        Raises:
            IllConditionedError: if the covariance of the centers near a tile cannot be factorized.
        """
        for tile, members in self.tiles(locations_m):
            yield members, self._rough(tile)

    def _rough(self, tile: Corner) -> Posterior:
        """The rough posterior of a tile, updated if it is kept; the next call may change it."""
        posterior = self.of_tile(tile, ROUGH_SHARE, self._kept.pop(tile, None))
        self._kept[tile] = posterior
        if len(self._kept) > KEPT_TILES:
            del self._kept[next(iter(self._kept))]
        return posterior

    def of_tile(self, tile: Corner, share: float = 1.0, start: Posterior | None = None) -> Posterior:
        """The posterior for a tile, given the centers within a share of the margin.

        Args:
            start: An earlier posterior of the tile, which is updated: fast if few centers are new.

        Raises:
            IllConditionedError: if their covariance cannot be factorized.
        """
        posterior = self.blank() if start is None else start
        posterior.follow(self.near_tile(tile, share))
        return posterior

    def blank(self) -> Posterior:
        """A posterior without data."""
        return self._prior.blank()

    def near_tile(self, tile: Corner, share: float = 1.0) -> Centers:
        """The centers within a share of the margin of a tile."""
        return self._centers.take(self._numbers_near(tile, tile, share))

    def _numbers_near(
        self, first: Corner, last: Corner, share: float = 1.0, locations: _Locations | None = None
    ) -> Ints:
        """Numbers of the centers that count in a rectangle of tiles, or those of other locations."""
        low, high = self._side * np.array(first), self._side * (np.array(last) + 1.0)
        return (self._locations if locations is None else locations).near(low, high, share * self._margin)

    def data_of(self, tile: Corner) -> _Data:
        """The data that a tile's results depend on."""
        near, close = self._numbers_near(tile, tile), self._numbers_near(tile, tile, CLOSE_SHARE)
        effect = None if self._effect_std_m is None else self._effect_std_m[near]
        return _Data(self._hash(near), len(near), len(close), effect)

    def _hash(self, numbers: Ints) -> int:
        """Hash of the locations, depths and noise of some centers."""
        c = self._centers
        return hash((c.locations_m[numbers].tobytes(), c.depths_m[numbers].tobytes(), c.noise_std_m[numbers].tobytes()))

    def tiles(self, locations_m: Array, together: int = 1) -> Iterator[tuple[Corner, Ints]]:
        """The tiles of locations (P, 2), and the numbers of the locations in each; `together`: in squares of n x n
        tiles."""
        yield from self._tiles_of(self._prior.kernel.scale(locations_m), together)

    def _tiles_of(self, scaled: Array, together: int = 1) -> Iterator[tuple[Corner, Ints]]:
        """As `tiles`, of locations (P, 2) in the kernel's axes and lengths."""
        if not len(scaled):
            return
        corners = np.floor(scaled / (together * self._side)).astype(np.int64)
        apart = corners - corners.min(axis=0)
        number = apart[:, 0] * (apart[:, 1].max() + 1) + apart[:, 1]  # in the order of the corners
        order = np.argsort(number, kind="stable")
        bounds = [0, *(np.flatnonzero(np.diff(number[order])) + 1).tolist(), len(order)]
        for begin, end in pairwise(bounds):
            north, east = corners[order[begin]].tolist()
            yield (north, east), order[begin:end]

    def moments(self, locations_m: ArrayLike) -> tuple[Array, Array]:
        """Mean and variance, (P,) each, at locations (P, 2)."""
        locations = checked_locations(locations_m)
        mean, variance = np.empty(len(locations)), np.empty(len(locations))
        for tile, members in self.tiles(locations):
            mean[members], variance[members] = self.of_tile(tile).moments(locations[members])
        return mean, variance

    def planned_moments(self, locations_m: ArrayLike, planned_m: Array) -> tuple[Array, Array, Array]:
        """Mean, variance, and variance once `planned_m` (O, 2) are measured too, (P,) each, at locations (P, 2)."""
        locations, planned = checked_locations(locations_m), _Locations(self._prior.kernel.scale(planned_m))
        mean, variance, planned_variance = np.empty((3, len(locations)))
        for (north, east), members in self.tiles(locations, PLANNED_TILES):
            first = north * PLANNED_TILES, east * PLANNED_TILES
            last = first[0] + PLANNED_TILES - 1, first[1] + PLANNED_TILES - 1
            local = self._prior.blank()
            local.follow(self._centers.take(self._numbers_near(first, last)))
            local = local.with_planned(planned_m[self._numbers_near(first, last, locations=planned)])
            found = local.at(locations[members])
            mean[members], variance[members] = found.mean_m, found.data_var_m2
            planned_variance[members] = found.planned_var_m2
        return mean, variance, planned_variance

    def slopes(self) -> Array:
        """Slope (n, 2) of the mean depth at the centers; only tiles near centers that have changed are recomputed.

        Centers that have been shifted count where they were. Slopes stay after few changes (`SLOPES_CHANGED`) and small
        relative shifts (`SLOPES_MOVED`).
        """
        c, drift = self._centers, np.zeros((len(self._centers), 2))
        drift[: len(self._drift)] = self._drift
        home = self._locations.scaled - drift
        rows = np.column_stack([home, drift, c.depths_m, c.noise_std_m, np.zeros_like(home)])
        in_tile, locations = dict(self._tiles_of(home)), _Locations(home)
        for tile in self._tiles_to_check(rows):
            members = in_tile.get(tile)
            if members is None:
                self._slopes.pop(tile, None)
                continue
            near = self._numbers_near(tile, tile, ROUGH_SHARE, locations)
            data = _Near(members, near, rows[near[:, None], (0, 1, 4, 5)], drift[near])
            known = self._slopes.get(tile)
            if known is None or not data.same_slopes(known[0]):
                known = self._slopes[tile] = data, self._rough(tile).slopes(c.locations_m[members])
            rows[members, 6:] = known[1]
        self._slope_rows = rows
        return rows[:, 6:].copy()

    def _tiles_to_check(self, rows: Array) -> list[Corner]:
        """The tiles near which centers differ from those of the last slopes, which are written into `rows` (n, 8)."""
        old = self._slope_rows if self._slope_rows is not None else rows[:0]
        common = min(len(old), len(rows))
        rows[:common, 6:] = old[:common, 6:]
        apart = np.abs(rows[:common, :6] - old[:common, :6]).max(axis=1, initial=0.0) > _ROUNDING
        changed = np.concatenate([rows[:common][apart], old[:common][apart], rows[common:], old[common:]])[:, :2]
        reach = SLOPES_SHARE * self._margin * (1.0 + _ROUNDING)
        corners = np.floor(np.hstack([changed - reach, changed + reach]) / self._side).astype(np.int64)
        found = {
            (north, east)
            for a, c, b, d in np.unique(corners, axis=0).tolist()
            for north in range(a, b + 1)
            for east in range(c, d + 1)
        }
        return sorted(found)


@dataclass(slots=True)
class _Tile:
    """Results of a tile: mean, variance and position variance at its locations.

    Attributes:
        turn: Number of the update that computed them.
        steep: Steepness at its locations (`roughness.py`).
        roughness: That of its own centers.
        sums: `Roughness.sums` at its locations.
        summed: Hash of the squares that are in them.
    """

    locations: Ints
    data: _Data | None = None
    turn: int = 0
    mean_m: Array | None = None
    variance_m2: Array | None = None
    position_variance_m2: Array | None = None
    steep: Array | None = None
    roughness: Roughness | None = None
    sums: Array | None = None
    summed: int = 0


@dataclass(frozen=True, slots=True)
class _Stale:
    """A tile whose results are not those of its data."""

    corner: Corner
    tile: _Tile
    data: _Data

    @property
    def work(self) -> float:
        """About the number of multiplications that computing it takes."""
        n = self.data.count
        return n * n * (len(self.tile.locations) + n / 3.0)

    @property
    def gained(self) -> int:
        """Number of centers close to it that were added or removed."""
        return 0 if self.tile.data is None else abs(self.data.close - self.tile.data.close)


class TiledMoments:
    """Mean and variance at fixed locations; as `CachedMoments`, of a tiled posterior.

    Only tiles whose data have changed are recomputed.
    """

    def __init__(self, posterior: TiledPosterior, locations_m: Array, length_m: float) -> None:
        """Starts without data.

        Args:
            length_m: Length scale of `Roughness`.
        """
        self._posterior, self._locations_m, self._length_m = posterior, checked_locations(locations_m), length_m
        self._tiles = {tile: _Tile(members) for tile, members in posterior.tiles(self._locations_m)}
        self._turn = 0

    def update(self, most_work: float = math.inf) -> tuple[Array, Array, Array]:
        """Current mean, variance with exact positions, and variance that uncertain positions add; (P,) each.

        Args:
            most_work: Tiles are recomputed until they take more multiplications than this; others keep their old
                results. Half of it goes to the tiles that most centers have come close to, half to those computed
                longest ago. Tiles without results are always computed.
        """
        return finish(self.update_in_parts(most_work))

    def follow(self, centers: Centers) -> Work[tuple[Array, Array, Array]]:
        """Replaces the data and updates all tiles, in parts."""
        self._posterior.follow(centers)
        return self.update_in_parts()

    def update_in_parts(self, most_work: float = math.inf) -> Work[tuple[Array, Array, Array]]:
        """As `update`; the posterior's data must not change in between."""
        homes = dict(self._posterior.tiles(self._posterior.centers.locations_m))
        for corner in homes.keys() - self._tiles.keys():
            self._tiles[corner] = _Tile(np.zeros(0, dtype=np.int64))
        self._turn += 1
        for each in _chosen((yield from self._stale_in_parts()), most_work):
            yield from self._compute(each)
        mean, variance, position_variance = np.empty((3, len(self._locations_m)))
        for tile in self._tiles.values():
            mean[tile.locations], variance[tile.locations] = tile.mean_m, tile.variance_m2
            position_variance[tile.locations] = tile.position_variance_m2
        return mean, variance, position_variance

    def scales(self, worth: float) -> Array:
        """Factor on the prior's variance (P,) of the last update, as `variance_scales`."""
        return finish(self.scales_in_parts(worth))

    def scales_in_parts(self, worth: float) -> Work[Array]:
        """As `scales`."""
        parts = [tile.roughness for tile in self._tiles.values() if tile.roughness is not None]
        everywhere, sums = Roughness.joined(parts, self._length_m), np.zeros((len(self._locations_m), 2))
        steep = np.empty(len(self._locations_m))
        for tile in self._tiles.values():
            if len(tile.locations):
                steep[tile.locations] = tile.steep
                own = self._locations_m[tile.locations]
                near = everywhere.near(own)
                summed = hash((near.locations_m.tobytes(), near.squares.tobytes()))
                if tile.sums is None or tile.summed != summed:
                    tile.sums, tile.summed = near.sums(own), summed
                sums[tile.locations] = tile.sums
                yield FUNCTION * (len(own) + 60.0 * len(near.squares)) + 100.0 * len(everywhere.squares)
        return scale_of(sums, steep, float(everywhere.squares.sum()), len(everywhere.squares), worth)

    def _stale_in_parts(self) -> Work[list[_Stale]]:
        """The tiles whose results are not those of their data."""
        stale = []
        for corner, tile in self._tiles.items():
            data = self._posterior.data_of(corner)
            if tile.data is None or not data.same(tile.data):
                stale.append(_Stale(corner, tile, data))
            yield FUNCTION * (DATA + 4.0 * data.count)
        return stale

    def _compute(self, stale: _Stale) -> Work[None]:
        tile, local = stale.tile, self._posterior.blank()
        yield from extend_in_parts(local, self._posterior.near_tile(stale.corner))
        own, is_new = self._locations_m[tile.locations], tile.data is None or tile.data.centers != stale.data.centers
        mean, variance, position_variance, steep = np.empty((4, len(own)))
        each = 0.5 * local.data_rows**2 + 3.0 * FUNCTION * local.data_rows
        rows = rows_per_part(each)
        for first in range(0, len(own), rows):
            part = slice(first, min(first + rows, len(own)))
            position_variance[part] = local.position_variance(local.kernel.scale(own[part]))
            if is_new:  # else only position effects have changed
                mean[part], total = local.moments(own[part])
                variance[part] = np.maximum(total - position_variance[part], 0.0)
                steep[part] = steepness(local, own[part], variance[part])
            yield each * (part.stop - first)
        tile.position_variance_m2 = position_variance
        if is_new:
            tile.mean_m, tile.variance_m2, tile.steep = mean, variance, steep
        locations = local.centers.locations_m
        home = np.zeros(len(locations), dtype=bool)
        for corner, members in self._posterior.tiles(locations):
            home[members] = corner == stale.corner
        tile.roughness = yield from Roughness.in_parts(local, self._length_m, home)
        tile.data, tile.turn = stale.data, self._turn


def _chosen(stale: list[_Stale], most_work: float) -> list[_Stale]:
    """The tiles to recompute, of those that are not up to date."""
    chosen = {each.corner: each for each in stale if each.tile.data is None}
    changed = [each for each in stale if each.tile.data is not None]
    spent = 0.0
    for share, order in (
        (0.5, sorted(changed, key=lambda each: -each.gained)),
        (1.0, sorted(changed, key=lambda each: each.tile.turn)),
    ):
        for each in order:
            if spent >= share * most_work:
                break
            if each.corner not in chosen:
                chosen[each.corner] = each
                spent += each.work
    return list(chosen.values())
