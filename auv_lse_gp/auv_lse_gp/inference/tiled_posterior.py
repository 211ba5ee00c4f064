"""The posterior of a large map, tile by tile: a tile is conditioned on the centers near it only.

The cost of a new center is that of the tiles near it, however large the map is. Distances are in the kernel's axes and
lengths, so that they hold for every length scale and anisotropy.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auv_lse_gp.inference.cached_points import CachedMoments
from auv_lse_gp.inference.centers import NO_CENTERS, Centers
from auv_lse_gp.inference.posterior import Posterior, checked_places
from auv_lse_gp.inference.roughness import Roughness, scale_of

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
Corner = tuple[int, int]

#: Distance from a tile up to which centers count, in kernel lengths (of a Wendland kernel: supports).
MARGIN = {"matern32": 3.75, "matern52": 3.75, "squared_exponential": 6.0, "wendland_c2": 1.25, "wendland_c4": 1.25}
#: The same for slopes at centers, which depend less on distant ones.
SLOPE_MARGIN_SHARE = 0.5
#: Number of tiles whose factors are kept. They take most of the map's memory.
KEPT = 12
#: Tiles on each side of the squares in which many planned places are taken together.
PLANNED_TILES = 2
#: A tile is recomputed if the place effect of a center near it has changed by this share of the largest.
EFFECT_SHARE = 0.02


@dataclass(frozen=True, slots=True)
class _Data:
    """The data that a tile's results depend on."""

    centers: int
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


class TiledPosterior:
    """The posterior of the depth given many centers, each place given those near its tile."""

    def __init__(self, prior: Posterior) -> None:
        """Starts with no data.

        Args:
            prior: A posterior with the same prior.
        """
        self._prior = prior.blank()
        self._margin = MARGIN[prior.kernel.name]
        self._side = 0.5 * self._margin
        self._centers = NO_CENTERS
        self._scaled = np.zeros((0, 2))
        self._effect_std_m: Array | None = None
        self._kept: dict[tuple[Corner, Corner], Posterior] = {}
        self._slopes: dict[Corner, tuple[int, Array]] = {}

    @property
    def centers(self) -> Centers:
        """The data."""
        return self._centers

    def follow(self, centers: Centers) -> None:
        """Replaces the data; fast if the old centers come first."""
        self._centers, effect = centers, centers.place_effect_m
        self._scaled = self._prior.kernel.scale(centers.places_m)
        self._effect_std_m = None if effect is None else np.sqrt(np.einsum("nr,nr->n", effect, effect))

    def near(self, places_m: Array) -> Posterior:
        """The posterior given the centers near places (P, 2); the next call may change it.

        Raises:
            IllConditionedError: if their covariance cannot be factorized.
        """
        corners = np.floor(self._prior.kernel.scale(places_m) / self._side).astype(np.int64)
        first, last = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
        return self.of_tiles((first[0], first[1]), (last[0], last[1]))

    def of_tiles(self, first: Corner, last: Corner) -> Posterior:
        """The posterior for a rectangle of tiles.

        Raises:
            IllConditionedError: if the covariance of the centers near it cannot be factorized.
        """
        posterior = self._kept.pop((first, last), None) or self._prior.blank()
        posterior.follow(self._centers.take(self._numbers_near(first, last)))
        self._kept[first, last] = posterior
        while len(self._kept) > KEPT:
            del self._kept[next(iter(self._kept))]
        return posterior

    def _numbers_near(self, first: Corner, last: Corner, share: float = 1.0, scaled: Array | None = None) -> Numbers:
        """Numbers of the centers that count in a rectangle of tiles, or those of `scaled` places (P, 2)."""
        scaled = self._scaled if scaled is None else scaled
        low, high = self._side * np.array(first), self._side * (np.array(last) + 1.0)
        gap = np.maximum(np.maximum(low - scaled, scaled - high), 0.0)
        return np.flatnonzero(np.einsum("nd,nd->n", gap, gap) <= (share * self._margin) ** 2)

    def data_of(self, tile: Corner) -> _Data:
        """The data that a tile's results depend on."""
        near = self._numbers_near(tile, tile)
        return _Data(self._hash(near), None if self._effect_std_m is None else self._effect_std_m[near])

    def _hash(self, numbers: Numbers) -> int:
        """Hash of the places, depths and noise of some centers."""
        c = self._centers
        return hash((c.places_m[numbers].tobytes(), c.depths_m[numbers].tobytes(), c.noise_std_m[numbers].tobytes()))

    def tiles(self, places_m: Array, together: int = 1) -> Iterator[tuple[Corner, Numbers]]:
        """The tiles of places (P, 2), and the numbers of the places in each; `together`: in squares of n x n tiles."""
        corners = np.floor(self._prior.kernel.scale(places_m) / (together * self._side)).astype(np.int64)
        found, group = np.unique(corners, axis=0, return_inverse=True)
        order = np.argsort(group.ravel(), kind="stable")
        bounds = np.searchsorted(group.ravel()[order], np.arange(len(found) + 1))
        for number, (north, east) in enumerate(found.tolist()):
            yield (north, east), order[bounds[number] : bounds[number + 1]]

    def moments(self, places_m: ArrayLike) -> tuple[Array, Array]:
        """Mean and variance, (P,) each, at places (P, 2)."""
        places = checked_places(places_m)
        mean, variance = np.empty(len(places)), np.empty(len(places))
        for tile, members in self.tiles(places):
            mean[members], variance[members] = self.of_tiles(tile, tile).moments(places[members])
        return mean, variance

    def planned_moments(self, places_m: ArrayLike, planned_m: Array) -> tuple[Array, Array, Array]:
        """Mean, variance, and variance once `planned_m` (O, 2) are measured too, (P,) each, at places (P, 2)."""
        places, planned = checked_places(places_m), self._prior.kernel.scale(planned_m)
        mean, variance, planned_variance = np.empty((3, len(places)))
        for (north, east), members in self.tiles(places, PLANNED_TILES):
            first = north * PLANNED_TILES, east * PLANNED_TILES
            last = first[0] + PLANNED_TILES - 1, first[1] + PLANNED_TILES - 1
            local = self._prior.blank()
            local.follow(self._centers.take(self._numbers_near(first, last)))
            local = local.with_planned(planned_m[self._numbers_near(first, last, scaled=planned)])
            found = local.at(places[members])
            mean[members], variance[members] = found.mean_m, found.data_var_m2
            planned_variance[members] = found.planned_var_m2
        return mean, variance, planned_variance

    def slopes(self) -> Array:
        """Slope (n, 2) of the mean depth at the centers; only tiles whose data have changed are recomputed."""
        slopes, found = np.zeros((len(self._centers), 2)), {}
        for tile, members in self.tiles(self._centers.places_m):
            near = self._numbers_near(tile, tile, SLOPE_MARGIN_SHARE)
            data, known = self._hash(near), self._slopes.get(tile)
            if known is None or known[0] != data:
                local = self._prior.blank()
                local.follow(self._centers.take(near))
                known = data, local.slopes(self._centers.places_m[members])
            slopes[members] = known[1]
            found[tile] = known
        self._slopes = found
        return slopes


@dataclass(slots=True)
class _Tile:
    """Results of a tile: mean, variance, place variance and `Roughness.sums` at its places.

    `squares` and `centers` are the sum of the squares of `Roughness` over its own centers, and their number.
    """

    places: Numbers
    data: _Data | None = None
    mean_m: Array | None = None
    variance_m2: Array | None = None
    place_variance_m2: Array | None = None
    sums: Array | None = None
    squares: float = 0.0
    centers: int = 0


class TiledMoments:
    """Mean and variance at fixed places; as `CachedMoments`, of a tiled posterior.

    Only tiles whose data have changed are recomputed.
    """

    def __init__(self, posterior: TiledPosterior, places_m: Array, length_m: float, provisional: int = 0) -> None:
        """Starts without data.

        Args:
            length_m: Length scale of `Roughness`.
            provisional: Number of the last measurements that are expected to change.
        """
        self._posterior, self._places_m, self._provisional = posterior, checked_places(places_m), provisional
        self._length_m = length_m
        self._tiles = {tile: _Tile(members) for tile, members in posterior.tiles(self._places_m)}
        self._cached: dict[Corner, CachedMoments] = {}

    def update(self) -> tuple[Array, Array, Array]:
        """Current mean, variance with exact positions, and variance that uncertain positions add; (P,) each."""
        homes = dict(self._posterior.tiles(self._posterior.centers.places_m))
        for corner in homes.keys() - self._tiles.keys():
            self._tiles[corner] = _Tile(np.zeros(0, dtype=np.int64))
        mean, variance, place_variance = np.empty((3, len(self._places_m)))
        for corner, tile in self._tiles.items():
            data = self._posterior.data_of(corner)
            if tile.data is None or not data.same(tile.data):
                self._compute(corner, tile, data)
            mean[tile.places], variance[tile.places] = tile.mean_m, tile.variance_m2
            place_variance[tile.places] = tile.place_variance_m2
        return mean, variance, place_variance

    def scales(self, worth: float) -> Array:
        """Factor on the prior's variance (P,) of the last update, as `Roughness.scale`."""
        tiles = self._tiles.values()
        sums = np.zeros((len(self._places_m), 2))
        for tile in tiles:
            sums[tile.places] = tile.sums
        return scale_of(sums, sum(tile.squares for tile in tiles), sum(tile.centers for tile in tiles), worth)

    def _compute(self, corner: Corner, tile: _Tile, data: _Data) -> None:
        local = self._posterior.of_tiles(corner, corner)
        if tile.data is not None and tile.data.centers == data.centers:  # only place effects have changed
            tile.place_variance_m2 = local.place_variance(local.kernel.scale(self._places_m[tile.places]))
        else:
            cached = self._cached.pop(corner, None)
            if cached is None or cached.posterior is not local:
                cached = CachedMoments(local, self._places_m[tile.places], self._provisional)
            self._cached[corner] = cached
            while len(self._cached) > KEPT:
                del self._cached[next(iter(self._cached))]
            tile.mean_m, tile.variance_m2, tile.place_variance_m2 = cached.update()
        places = local.centers.places_m
        home = np.zeros(len(places), dtype=bool)
        for own, members in self._posterior.tiles(places):
            home[members] = own == corner
        rough = Roughness.of(local, self._length_m)
        tile.sums = rough.sums(self._places_m[tile.places])
        tile.squares, tile.centers = float(rough.squares[home].sum()), int(home.sum())
        tile.data = data
