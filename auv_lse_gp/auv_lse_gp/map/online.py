"""The online Gaussian process of the depth (paper, section "Online GP").

Soundings become kernel centers, or are merged into centers (`store.py`). The posterior is updated only when it is read:
one refactorization, from the first moved center on, for any number of soundings.
"""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.support.arrays import Array, Ints, Mask
from auv_lse_gp.covariance.prior_mean import prior_mean
from auv_lse_gp.inference.banks import Banks, depths
from auv_lse_gp.inference.centers import NO_CENTERS, Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.inference.tiled_posterior import TiledPosterior
from auv_lse_gp.map.consistency import blocks_of, noise_of_samples
from auv_lse_gp.map.gate import SoundingError, check_sounding, plausible, within_gate
from auv_lse_gp.map.store import CenterStore, Outcome

#: A map of more centers is computed tile by tile.
MAX_DENSE = 1000


@dataclasses.dataclass(slots=True)
class Counts:
    """Number of soundings by outcome; `refused` ones are implausible."""

    kept: int = 0
    too_close: int = 0
    merged: int = 0
    outliers: int = 0
    full: int = 0
    refused: int = 0


class OnlineGp:
    """Posterior of the depth given the soundings so far.

    Attributes:
        banks: The banks of the area; None: all ground is open.
        prior_mean: Prior mean of open ground, locations (P, 2) -> depths (P,).
        revision: Changes whenever the posterior does.
        last_problem: Reason of the last rejected sounding; "" without one.
    """

    def __init__(self, config: GpConfig, banks: Banks | None = None) -> None:
        """Starts with no data.

        Args:
            banks: The banks of the area; None: all ground is open.
        """
        self.config = config
        self.counts = Counts()
        self.revision = 0
        self.last_problem = ""
        self.banks, self.prior_mean = banks, prior_mean(config)
        self._posterior = Posterior(config, self.prior_mean, banks)
        self.kernel = self._posterior.kernel
        self._tiled = TiledPosterior(self._posterior)
        self._posterior_revision = self._tiled_revision = -1
        self._store = CenterStore(config, self.kernel)

    def __len__(self) -> int:
        """Number of centers."""
        return len(self._store)

    # ---------------------------------------------------------------- data in

    def add(
        self, north_m: float, east_m: float, depth_m: float, grow: bool = True, noise_std_m: float | None = None
    ) -> Outcome:
        """Adds one sounding.

        Args:
            depth_m: Water depth (m, positive down).
            grow: Whether it may become a new center; if not, it can still be merged into an existing one.
            noise_std_m: Standard deviation of its noise (m); None: `gp.noise_std_m`.

        Returns:
            Its outcome.

        Raises:
            SoundingError: if it is implausible (counted as refused).
        """
        try:
            check_sounding(self.config, north_m, east_m, depth_m)
        except SoundingError:
            self.counts.refused += 1
            raise
        row = np.array([[north_m, east_m, depth_m]], dtype=float)
        noise = self.config.noise_std_m if noise_std_m is None else noise_std_m
        return self._insert(row, int(grow), np.array([noise]))[0]

    def add_all(
        self, soundings: Array, max_new: int | None = None, noise_std_m: Array | None = None
    ) -> list[Outcome | None]:
        """Adds soundings one after another, as `add`, and continues after a rejected one.

        Args:
            soundings: North, east, depth (m), shape (n, 3).
            max_new: Largest number of new centers; None: no limit.
            noise_std_m: Standard deviations of their noise (m), shape (n,); None: `gp.noise_std_m`.

        Returns:
            The outcome of each; None if it was rejected, see `last_problem`.
        """
        room = len(soundings) if max_new is None else max_new
        noise = np.full(len(soundings), self.config.noise_std_m) if noise_std_m is None else noise_std_m
        outcomes: list[Outcome | None] = [None] * len(soundings)
        together = plausible(self.config, soundings)
        inserted = self._insert(soundings[together], room, noise[together]) if together.any() else []
        for i, outcome in zip(np.flatnonzero(together).tolist(), inserted, strict=True):
            outcomes[i] = outcome
        for sounding in soundings[~together].tolist():
            try:
                check_sounding(self.config, *sounding)
            except SoundingError as error:
                self.counts.refused += 1
                self.last_problem = str(error)
        return outcomes

    def add_if_fitting(
        self, soundings: Array, sigmas: float, max_new: int, packets: Ints | None = None
    ) -> tuple[list[Outcome | None], Mask]:
        """Adds the soundings that fit the current map, as `add_all`; the others are outliers.

        Those that fit the map but contradict each other are down-weighted (`consistency.py`).

        Args:
            soundings: North, east, depth (m), shape (n, 3).
            sigmas: Largest deviation of a sounding, in standard deviations; 0: no limit. Without centers, all fit.
            max_new: Largest number of new centers.
            packets: Number of each sounding's packet (n,), in order; None: they are of one packet.

        Returns:
            The outcome of each, None if it was rejected; and a mask (n,) of those that fit and were not down-weighted.
        """
        fit = np.ones(len(soundings), dtype=bool)
        noise = np.full(len(soundings), self.config.noise_std_m)
        finite = np.flatnonzero(np.isfinite(soundings).all(axis=1))
        if sigmas > 0.0 and len(self) and len(finite):
            numbers = np.zeros(len(finite), dtype=np.int64) if packets is None else packets[finite]
            check = self._checked_in_tiles if self.is_tiled else self._checked
            fit[finite], noise[finite] = check(soundings[finite], sigmas, numbers)
        self.counts.outliers += int((~fit).sum())
        outcomes: list[Outcome | None] = [Outcome.OUTLIER] * len(soundings)
        added = self.add_all(soundings[fit], max_new, noise[fit])
        for i, outcome in zip(np.flatnonzero(fit).tolist(), added, strict=True):
            outcomes[i] = outcome
        return outcomes, fit & (noise <= self.config.noise_std_m)

    def _checked(self, soundings: Array, sigmas: float, packets: Ints) -> tuple[Mask, Array]:
        """Which of the soundings (n, 3) are within `sigmas` of the map; and their noise.

        Returns:
            A mask (n,), and the standard deviations (n,) with which those that fit are consistent with each other.
        """
        fit, noise = np.empty(len(soundings), dtype=bool), np.full(len(soundings), self.config.noise_std_m)
        for block in blocks_of(packets):
            covariance, residuals = _compared(self.posterior, soundings[block])
            fits = within_gate(self.config, residuals, np.diag(covariance), sigmas)
            fit[block], own = fits, block[fits]
            covariance, residuals = covariance[np.ix_(fits, fits)], residuals[fits]
            noise[own] = noise_of_samples(covariance, residuals, self.config.noise_std_m, sigmas, packets[own])
        return fit, noise

    def _checked_in_tiles(self, soundings: Array, sigmas: float, packets: Ints) -> tuple[Mask, Array]:
        """As `_checked`, of a map in tiles; each tile is solved once."""
        fit, noise = np.empty(len(soundings), dtype=bool), np.full(len(soundings), self.config.noise_std_m)
        predicted = []  # numbers, covariance and residuals of the soundings of each tile that fit
        for members, posterior in self.tiled.near(soundings[:, :2]):
            covariance, residuals = _compared(posterior, soundings[members])
            fit[members] = within_gate(self.config, residuals, np.diag(covariance), sigmas)
            rows = np.flatnonzero(fit[members])
            predicted.append((members[rows], covariance[np.ix_(rows, rows)], residuals[rows]))
        used = np.flatnonzero(fit)
        for block in blocks_of(packets[used]):
            own = used[block]
            covariance, residuals = np.zeros((len(own), len(own))), np.empty(len(own))
            for members, of_tile, off in predicted:  # between tiles there is no covariance
                part = slice(*np.searchsorted(members, (own[0], own[-1] + 1)))
                rows = np.searchsorted(own, members[part])
                covariance[np.ix_(rows, rows)], residuals[rows] = of_tile[part, part], off[part]
            noise[own] = noise_of_samples(covariance, residuals, self.config.noise_std_m, sigmas, packets[own])
        return fit, noise

    def _insert(self, rows: Array, max_new: int, noise_std_m: Array) -> list[Outcome]:
        """Inserts plausible soundings (n, 3), with their noise (n,)."""
        outcomes, counts = self._store.take(rows, noise_std_m, max_new), self.counts
        kept, merged = outcomes.count(Outcome.KEPT), outcomes.count(Outcome.MERGED)
        counts.kept, counts.merged = counts.kept + kept, counts.merged + merged
        counts.too_close += outcomes.count(Outcome.TOO_CLOSE)
        counts.full += outcomes.count(Outcome.FULL)
        self.revision += kept + merged
        return outcomes

    def shift(self, by_m: Array) -> None:
        """Moves each center and its merged soundings by (n, 2); the soundings are not compared with the map again.

        Raises:
            ValueError: for another number of centers.
        """
        if by_m.shape != (len(self), 2):
            raise ValueError(f"shift: {by_m.shape} is not the shape of the centers, ({len(self)}, 2)")
        self._store.shift(by_m)
        if self.is_tiled:
            self._tiled.shift(by_m)
        self.revision += 1

    def clear(self) -> None:
        """Drops all soundings."""
        self.counts = Counts()
        self._store = CenterStore(self.config, self.kernel)
        self._tiled.forget()
        self.revision += 1

    def set_position_effect(self, effect_m: Array | None) -> None:
        """Sets the effect of uncertain positions on the centers' depths (`CenterStore.set_position_effect`)."""
        self._store.set_position_effect(effect_m)
        self.revision += 1

    # ---------------------------------------------------------------- posterior out

    @property
    def centers(self) -> Centers:
        """A copy of the kernel centers."""
        return self._store.centers.copy()

    @property
    def posterior(self) -> Posterior:
        """The posterior given all centers; it follows later soundings. To plan locations, use `Posterior.with_planned`.

        Of n centers it takes O(n^2) memory and time. Where that matters, use `tiled` if `is_tiled`.
        """
        if self._posterior_revision != self.revision:
            self._posterior.follow(self._store.centers)
            self._posterior_revision = self.revision
        return self._posterior

    @property
    def is_tiled(self) -> bool:
        """Whether the map has more centers than `MAX_DENSE`."""
        return len(self) > MAX_DENSE

    @property
    def tiled(self) -> TiledPosterior:
        """The posterior tile by tile; the next sounding changes it."""
        if self._tiled_revision != self.revision:
            self._tiled.follow(self._store.centers)
            self._tiled_revision = self.revision
            self._posterior.follow(NO_CENTERS)  # releases its memory
            self._posterior_revision = -1
        return self._tiled

    def slopes(self) -> Array:
        """Slope (n, 2) of the mean depth at the centers, metres per metre north and east."""
        return self.tiled.slopes() if self.is_tiled else self.posterior.slopes(self.centers.locations_m)

    def predict(self, locations_m: ArrayLike) -> tuple[Array, Array]:
        """Mean and standard deviation (P,), (P,) of the depth (without noise) at locations (P, 2)."""
        return self.depths(locations_m, *self.moments(locations_m))

    def moments(self, locations_m: ArrayLike) -> tuple[Array, Array]:
        """Mean and variance (P,), (P,) of the posterior at locations (P, 2): of relative depths, if there are banks."""
        return (self.tiled if self.is_tiled else self.posterior).moments(locations_m)

    def depths(self, locations_m: ArrayLike, mean_m: Array, variance_m2: Array) -> tuple[Array, Array]:
        """Mean and standard deviation (P,), (P,) of the depth, from the posterior's moments at locations (P, 2)."""
        return depths(self.banks, np.asarray(locations_m, dtype=float), mean_m, variance_m2)


def _compared(posterior: Posterior, soundings: Array) -> tuple[Array, Array]:
    """Covariance (n, n) of the depths at soundings (n, 3), and what these deviate from their predictions (n,)."""
    locations = soundings[:, :2]
    at = posterior.at(locations)
    covariance, mean, banks = posterior.covariance(at, at), at.mean_m, posterior.banks
    np.fill_diagonal(covariance, at.data_var_m2)  # with the effect of uncertain positions
    if banks is not None and len(locations):
        factor = banks.factor(locations)
        covariance, mean = covariance * np.outer(factor, factor), banks.depths(locations, mean)
    return covariance, soundings[:, 2] - mean
