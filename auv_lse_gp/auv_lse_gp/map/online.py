"""The online Gaussian process of the depth (paper, section "Online GP").

Soundings become kernel centers in a table, or are merged into centers. The posterior is updated only when it is read:
one refactorization, from the first moved center on, for any number of soundings. If a factorization could fail
(`_is_well_conditioned`), each new center is factorized immediately, so that `add` can reject it.
"""

from __future__ import annotations

import dataclasses
import enum
import math
import warnings

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_gp.covariance.kernels import LOCAL_RATIO
from auv_lse_gp.covariance.prior_mean import PriorMean, prior_mean
from auv_lse_gp.inference.banks import Banks, depths
from auv_lse_gp.inference.centers import NO_CENTERS, Centers, CenterTable
from auv_lse_gp.inference.factor import IllConditionedError
from auv_lse_gp.inference.local_subset import predict_locally
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.inference.tiled_posterior import TiledPosterior
from auv_lse_gp.map.consistency import blocks_of, noise_of_samples
from auv_lse_gp.map.gate import SoundingError, check_sounding, plausible, within_gate
from auv_lse_gp.map.merging import MAX_MERGED, MERGE_WINDOW, MergedCenter
from auv_lse_gp.map.spacing import SpacingIndex

Array = NDArray[np.float64]

_EPSILON = float(np.finfo(float).eps)
#: A map of more centers is computed tile by tile.
MAX_DENSE = 1000


class Outcome(enum.Enum):
    """The outcome of a sounding."""

    KEPT = "kept"
    TOO_CLOSE = "too_close"
    MERGED = "merged"
    OUTLIER = "outlier"
    FULL = "full"


@dataclasses.dataclass(slots=True)
class Counts:
    """Number of soundings by outcome; `refused` ones are implausible or would make the covariance ill-conditioned."""

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
        problems: Messages for the user: a support below the default, undone merges.
        last_problem: Reason of the last rejected sounding; "" without one.
    """

    def __init__(self, config: GpConfig, mean: PriorMean | None = None, banks: Banks | None = None) -> None:
        """Starts with no data.

        Args:
            mean: Prior mean (P, 2) -> (P,) of open ground; by default the one that `config` describes.
            banks: The banks of the area; None: all ground is open.
        """
        self.config = config
        self.counts = Counts()
        self.revision = 0
        self.problems: list[str] = []
        self.last_problem = ""
        self.banks, self.prior_mean = banks, mean or prior_mean(config)
        self._posterior = Posterior(config, self.prior_mean, banks)
        self.kernel = self._posterior.kernel
        self._warn_of_short_support()
        self._tiled = TiledPosterior(self._posterior)
        self._tiled_revision = -1
        self._table = CenterTable()
        self._outdated = False  # whether the posterior lacks changes of the table
        self._index = SpacingIndex(config.min_spacing_m)
        self._merged: list[MergedCenter] = []
        self._moved: set[int] = set()
        self._position_effect_m: Array | None = None

    def __len__(self) -> int:
        """Number of centers."""
        return len(self._table)

    # ---------------------------------------------------------------- data in

    def add(
        self, north_m: float, east_m: float, depth_m: float, grow: bool = True, noise_std_m: float | None = None
    ) -> Outcome:
        """Takes one sounding.

        Args:
            depth_m: Water depth (m, positive down).
            grow: Whether it may become a new center; if not, it can still be merged into an existing one.
            noise_std_m: Standard deviation of its noise (m); None: `gp.noise_std_m`.

        Returns:
            Its outcome.

        Raises:
            SoundingError: if it is implausible (counted as refused).
            IllConditionedError: if the centers' covariance cannot be factorized with it; it is then discarded.
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
        """Takes soundings one after another, as `add`, and continues after a rejected one.

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
        together = plausible(self.config, soundings) & self._is_well_conditioned(
            min(len(self) + len(soundings), max(self.config.max_centers, len(self)))
        )
        inserted = self._insert(soundings[together], room, noise[together]) if together.any() else []
        for i, outcome in zip(np.flatnonzero(together).tolist(), inserted, strict=True):
            outcomes[i] = outcome
        for i in np.flatnonzero(~together).tolist():
            north_m, east_m, depth_m = soundings[i].tolist()
            try:
                outcomes[i] = self.add(north_m, east_m, depth_m, grow=room > 0, noise_std_m=float(noise[i]))
                room -= outcomes[i] is Outcome.KEPT
            except SoundingError as error:
                self.last_problem = str(error)
            except IllConditionedError as error:
                self.counts.refused += 1
                self.last_problem = str(error)
        return outcomes

    def add_if_fitting(
        self, soundings: Array, sigmas: float, max_new: int, packets: NDArray[np.int64] | None = None
    ) -> tuple[list[Outcome | None], NDArray[np.bool_]]:
        """Takes the soundings that fit the current map, as `add_all`; the others are outliers.

        Those that fit the map but contradict each other are weighed down (`consistency.py`).

        Args:
            soundings: North, east, depth (m), shape (n, 3).
            sigmas: Largest deviation of a sounding, in standard deviations; 0: no limit. Without centers, all fit.
            max_new: Largest number of new centers.
            packets: Number of each sounding's packet (n,), in order; None: they are of one packet.

        Returns:
            The outcome of each, None if it was rejected; and a mask (n,) of those that fit and were not weighed down.
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

    def _checked(self, soundings: Array, sigmas: float, packets: NDArray[np.int64]) -> tuple[NDArray[np.bool_], Array]:
        """Which of the soundings (n, 3) are within `sigmas` of the map, without pending merges; and their noise.

        Returns:
            A mask (n,), and the standard deviations (n,) with which those that fit are consistent with each other.
        """
        self._sync()
        mean, variance = self._posterior.moments(soundings[:, :2])
        if self.banks is not None:
            mean, std = self.depths(soundings[:, :2], mean, variance)
            variance = std**2
        fit = within_gate(self.config, soundings[:, 2], mean, variance, sigmas)
        noise, used = np.full(len(soundings), self.config.noise_std_m), np.flatnonzero(fit)
        for block in blocks_of(packets[used]):
            own = used[block]
            covariance, residuals = _compared(self._posterior, soundings[own])
            noise[own] = noise_of_samples(covariance, residuals, self.config.noise_std_m, sigmas, packets[own])
        return fit, noise

    def _checked_in_tiles(
        self, soundings: Array, sigmas: float, packets: NDArray[np.int64]
    ) -> tuple[NDArray[np.bool_], Array]:
        """As `_checked`, of a map in tiles; each tile is solved once."""
        fit, noise = np.empty(len(soundings), dtype=bool), np.full(len(soundings), self.config.noise_std_m)
        predicted = []  # numbers, covariance and residuals of the soundings of each tile that fit
        for members, posterior in self.tiled.near(soundings[:, :2]):
            covariance, residuals = _compared(posterior, soundings[members])
            variance = np.diag(covariance)
            fit[members] = within_gate(self.config, residuals, np.zeros_like(residuals), variance, sigmas)
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
        """Inserts soundings (n, 3) that passed the gates, with their noise (n,); several only if always factorizable.

        A sounding that was weighed down is merged into no better center.

        Raises:
            IllConditionedError: as `add`.
        """
        size = len(self)
        near, new = self._index.take(rows[:, :2], max(min(max_new, self.config.max_centers - size), 0))
        kept = rows[new]
        try:
            self._append(Centers(kept[:, :2], kept[:, 2], noise_std_m[new]))
        except IllConditionedError:
            self._index.truncate(size)
            raise
        outcomes = []
        numbers, fresh, noises = near.tolist(), new.tolist(), noise_std_m.tolist()
        for number, is_new, noise, (north_m, east_m, depth_m) in zip(
            numbers, fresh, noises, rows.tolist(), strict=True
        ):
            if is_new:
                size += 1
                if self.config.merge:
                    self._merged.append(MergedCenter(self.kernel, (north_m, east_m), depth_m, noise))
                self.counts.kept += 1
                outcomes.append(Outcome.KEPT)
            elif number < 0:
                self.counts.full += 1
                outcomes.append(Outcome.FULL)
            elif self.config.merge and number >= size - MERGE_WINDOW and self._merged[number].takes(noise):
                self._merged[number].add((north_m, east_m), depth_m, noise)
                self._moved.add(number)
                self.revision += 1
                self.counts.merged += 1
                outcomes.append(Outcome.MERGED)
            else:
                self.counts.too_close += 1
                outcomes.append(Outcome.TOO_CLOSE)
        return outcomes

    @property
    def can_shift(self) -> bool:
        """Whether `shift` is possible: the map is tiled, and its centers can be factorized wherever they are."""
        return self.is_tiled and self._is_well_conditioned(len(self))

    def shift(self, by_m: Array) -> None:
        """Moves each center by (n, 2), with what was merged into it; the soundings are not compared with the map again.

        Raises:
            ValueError: if the map cannot be shifted (`can_shift`).
        """
        if not self.can_shift or by_m.shape != (len(self), 2):
            raise ValueError(
                f"shift: {by_m.shape} cannot be shifted; needs shape ({len(self)}, 2) and a tiled map (can_shift)"
            )
        self._apply_merges()
        self._table.shift(by_m)
        self._index.shift(by_m)
        self._tiled.shift(by_m)
        for center, by in zip(self._merged[-MERGE_WINDOW:], by_m[-MERGE_WINDOW:].tolist(), strict=False):
            center.shift(by)
        self._outdated = True
        self.revision += 1

    def clear(self) -> None:
        """Drops all soundings."""
        self.counts = Counts()
        self._table = CenterTable()
        self._tiled.forget()
        self._outdated = True
        self._index = SpacingIndex(self.config.min_spacing_m)
        self._merged.clear()
        self._moved.clear()
        self._position_effect_m = None
        self.revision += 1

    def set_position_effect(self, effect_m: Array | None) -> None:
        """Sets the effect of uncertain positions on the centers' depths, (n, r): see `Centers.position_effect_m`.

        Later centers have no effect until the next call.

        Raises:
            ValueError: if there are more rows than centers.
        """
        if effect_m is not None and len(effect_m) > len(self):
            raise ValueError(f"location effect: {len(effect_m)} rows are more than the {len(self)} centers")
        self._position_effect_m = effect_m
        self._outdated = True
        self.revision += 1

    @property
    def _current_centers(self) -> Centers:
        """The centers in the table with their location effects; read-only."""
        held, effect = self._table.centers, self._position_effect_m
        if effect is None:
            return held
        padded = np.zeros((len(held), effect.shape[1]))
        padded[: len(effect)] = effect[: len(held)]
        return Centers(held.locations_m, held.depths_m, held.noise_std_m, padded)

    # ---------------------------------------------------------------- posterior out

    @property
    def centers(self) -> Centers:
        """A copy of the kernel centers."""
        if self.is_tiled or self._is_well_conditioned(len(self)):
            self._apply_merges()
        else:
            self._sync()
        held = self._current_centers
        return Centers(held.locations_m.copy(), held.depths_m.copy(), held.noise_std_m.copy(), held.position_effect_m)

    @property
    def posterior(self) -> Posterior:
        """The posterior given all centers; it follows later soundings. To plan locations, use `Posterior.with_planned`.

        Of n centers it takes O(n^2) memory and time. Where that matters, use `tiled` if `is_tiled`.
        """
        self._sync()
        return self._posterior

    @property
    def is_tiled(self) -> bool:
        """Whether the map has more centers than `MAX_DENSE`."""
        return len(self) > MAX_DENSE

    @property
    def tiled(self) -> TiledPosterior:
        """The posterior tile by tile; the next sounding changes it."""
        if self._tiled_revision != self.revision:
            self._apply_merges()
            self._tiled.follow(self._current_centers)
            self._tiled_revision = self.revision
            if self._posterior.data_rows:
                self._posterior.follow(NO_CENTERS)  # releases its memory
                self._outdated = True
        return self._tiled

    def slopes(self) -> Array:
        """Slope (n, 2) of the mean depth at the centers, metres per metre north and east."""
        return self.tiled.slopes() if self.is_tiled else self.posterior.slopes(self.centers.locations_m)

    def predict(self, locations_m: ArrayLike) -> tuple[Array, Array]:
        """Mean and standard deviation (P,), (P,) of the depth (without noise) at locations (P, 2)."""
        return self.depths(locations_m, *self.moments(locations_m))

    def moments(self, locations_m: ArrayLike) -> tuple[Array, Array]:
        """Mean and variance (P,), (P,) of the posterior at locations (P, 2): of relative depths, if there are banks."""
        if self.is_tiled and not self.config.local:
            return self.tiled.moments(locations_m)
        self._sync()
        if self.config.local and not self.kernel.compact:
            mean, variance = predict_locally(self._posterior.blank(), self._table.centers, locations_m)
            scaled = self.kernel.scale(np.asarray(locations_m, dtype=float))
            return mean, variance + self._posterior.position_variance(scaled)
        return self._posterior.moments(locations_m)

    def depths(self, locations_m: ArrayLike, mean_m: Array, variance_m2: Array) -> tuple[Array, Array]:
        """Mean and standard deviation (P,), (P,) of the depth, from the posterior's moments at locations (P, 2)."""
        return depths(self.banks, np.asarray(locations_m, dtype=float), mean_m, variance_m2)

    # ---------------------------------------------------------------- inside

    def _warn_of_short_support(self) -> None:
        usual = LOCAL_RATIO.get(self.kernel.name, 0.0) * self.config.length_scale_m
        if self.config.local and not self.kernel.compact and self.kernel.local_m < usual:
            text = (
                f"gp.support_m: {self.kernel.local_m:g} m is less than {LOCAL_RATIO[self.kernel.name]:g} length scales "
                f"({usual:g} m); the error of the local subset of {self.kernel.name} is visible (docs/design/gp.md)"
            )
            self.problems.append(text)
            warnings.warn(text, stacklevel=3)

    def _is_well_conditioned(self, size: int) -> bool:
        """Whether `size` centers can be factorized wherever they are.

        No pivot is less than the smallest noise variance, and rounding errors are below about size^2 eps times the
        largest variance (Higham 2002, theorems 10.3 and 10.7).
        """
        noise_m2 = self.config.noise_std_m**2
        least_noise_m2 = noise_m2 / (MAX_MERGED if self.config.merge else 1)
        largest = 4.0 * self.kernel.signal_variance_m2 + noise_m2  # merging adds at most 4 k(p, p) of noise
        rounding = 4.0 * (size + 1) ** 2 * _EPSILON * largest
        return least_noise_m2 > rounding

    def _append(self, centers: Centers) -> None:
        """Appends centers, or changes nothing if it raises IllConditionedError."""
        if not len(centers):
            return
        n = len(self)
        can_wait = self._is_well_conditioned(n + len(centers))
        if not can_wait and not self.is_tiled:
            self._sync()
        self._table.append(centers)
        self._outdated = True
        self.revision += len(centers)
        if not can_wait:
            try:
                if self.is_tiled:
                    for _ in self.tiled.near(centers.locations_m):
                        pass  # raises
                else:
                    self._sync()
            except IllConditionedError:
                self._table.truncate(n)
                self.revision += 1
                raise

    def _apply_merges(self) -> None:
        """Moves the centers with newly merged soundings."""
        for i in self._moved:
            location, depth, noise_m2 = self._merged[i].summary()
            self._table.move(i, location, depth, math.sqrt(noise_m2))
        self._outdated = self._outdated or bool(self._moved)
        self._moved.clear()

    def _sync(self) -> None:
        """Applies merges and updates the posterior."""
        before = self._table.copy() if self._moved else None
        self._apply_merges()
        if not self._outdated:
            return
        try:
            self._posterior.follow(self._current_centers)
        except IllConditionedError:
            if before is None:
                raise
            # Merging lowers the noise and may move centers closer together. The centers before it can be factorized.
            self._table = before
            self._posterior.follow(self._current_centers)
            self.problems.append("undid merges: they made the covariance of the centers ill-conditioned")
        self._outdated = False


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
