"""The online Gaussian process of the depth: soundings in, one at a time; posterior out (paper, section "Online GP").

Theory of operation. The kept soundings are kernel centers, in a table; the posterior (`posterior.py`) follows the
table. Merging moves centers. That is put off until an answer is asked for, so that a hundred merged soundings cost one
refactoring, of the rows from the first moved center on, which as a rule is one of the last. New centers wait likewise,
and are factorized as a block, where it is certain that they can be (`_certain`): which soundings are kept, and where
the centers are, does not depend on the factor. Otherwise each is factorized at once, so that `add` can refuse it.
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
from auv_lse_gp.covariance.prior_mean import PriorMean
from auv_lse_gp.inference.centers import Centers, CenterTable
from auv_lse_gp.inference.factor import IllConditionedError
from auv_lse_gp.inference.local_subset import predict_locally
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.map.gate import SoundingError, can_be_soundings, check_sounding, within_gate
from auv_lse_gp.map.merging import MAX_MERGED, MERGE_WINDOW, MergedCenter
from auv_lse_gp.map.spacing import SpacingIndex

Array = NDArray[np.float64]

_EPSILON = float(np.finfo(float).eps)


class Outcome(enum.Enum):
    """What became of a sounding."""

    KEPT = "kept"
    TOO_CLOSE = "too_close"
    MERGED = "merged"
    OUTLIER = "outlier"
    FULL = "full"


@dataclasses.dataclass(slots=True)
class Counts:
    """How many soundings became what."""

    kept: int = 0
    too_close: int = 0
    merged: int = 0
    outliers: int = 0
    full: int = 0
    refused: int = 0


class OnlineGp:
    """Posterior of the depth given the soundings so far.

    Attributes:
        config: The configuration.
        kernel: Its covariance function.
        prior_mean: Its prior mean, places (P, 2) -> depths (P,).
        counts: What became of the soundings.
        revision: Changes whenever the posterior does.
        problems: What the user should know of: a support below the default, merges that were undone.
        last_problem: Why `add_all` refused the last sounding that it refused.
    """

    def __init__(self, config: GpConfig, mean: PriorMean | None = None) -> None:
        """Starts with no data.

        Args:
            config: Prior and rules for soundings.
            mean: Prior mean (P, 2) -> (P,); by default the one `config` describes (read from its file for a survey).
        """
        self.config = config
        self.counts = Counts()
        self.revision = 0
        self.problems: list[str] = []
        self.last_problem = ""
        self._posterior = Posterior(config, mean)
        self.kernel, self.prior_mean = self._posterior.kernel, self._posterior.prior_mean
        self._warn_of_short_support()
        self._table = CenterTable()
        self._behind = False  # whether the table has changed since the posterior followed it
        self._index = SpacingIndex(config.min_spacing_m)
        self._merged: list[MergedCenter] = []
        self._moved: set[int] = set()
        self._place_effect_m: Array | None = None

    def __len__(self) -> int:
        """Number of centers."""
        return len(self._table)

    # ---------------------------------------------------------------- data in

    def add(self, north_m: float, east_m: float, depth_m: float, grow: bool = True) -> Outcome:
        """Takes one sounding, of the configured noise.

        Args:
            north_m: North (m).
            east_m: East (m).
            depth_m: Water depth (m, positive down).
            grow: Whether it may become a new center; if not, it can still be merged into one that is there.

        Returns:
            What became of it.

        Raises:
            SoundingError: if it cannot be a sounding (counted as refused).
            IllConditionedError: if the centers' covariance cannot be factorized with it (it is not kept).
        """
        try:
            check_sounding(self.config, north_m, east_m, depth_m)
        except SoundingError:
            self.counts.refused += 1
            raise
        row = np.array([[north_m, east_m, depth_m]], dtype=float)
        if self.config.outlier_sigmas > 0.0 and len(self):
            mean, variance = self._posterior.moments(row[:, :2])  # as it stands, without merges that wait
            if not within_gate(self.config, row[:, 2], mean, variance, self.config.outlier_sigmas)[0]:
                self.counts.outliers += 1
                return Outcome.OUTLIER
        return self._take(row, int(grow))[0]

    def add_all(self, soundings: Array, most_new: int | None = None) -> list[Outcome | None]:
        """Takes soundings, one after another, as `add`, and goes on after one that it refuses.

        Args:
            soundings: North, east, depth (m) of each, shape (n, 3).
            most_new: So many of them may become centers; None: all.

        Returns:
            What became of each; None for one that was refused, see `last_problem`.
        """
        room = len(soundings) if most_new is None else most_new
        outcomes: list[Outcome | None] = [None] * len(soundings)
        together = can_be_soundings(self.config, soundings) & self._certain(len(self) + len(soundings))
        taken = self._take(soundings[together], room) if together.any() else []
        for i, outcome in zip(np.flatnonzero(together).tolist(), taken, strict=True):
            outcomes[i] = outcome
        for i in np.flatnonzero(~together).tolist():
            north_m, east_m, depth_m = soundings[i].tolist()
            try:
                outcomes[i] = self.add(north_m, east_m, depth_m, grow=room > 0)
                room -= outcomes[i] is Outcome.KEPT
            except SoundingError as error:
                self.last_problem = str(error)
            except IllConditionedError as error:
                self.counts.refused += 1
                self.last_problem = str(error)
        return outcomes

    def _take(self, rows: Array, most_new: int) -> list[Outcome]:
        """Takes soundings (n, 3) that passed the gates; of more than one it must be `_certain` that they can be kept.

        Raises:
            IllConditionedError: as `add`.
        """
        size, noise_std_m = len(self), self.config.noise_std_m
        near, new = self._index.take(rows[:, :2], max(min(most_new, self.config.max_centers - size), 0))
        kept = rows[new]
        try:
            self._append(Centers(kept[:, :2], kept[:, 2], np.full(len(kept), noise_std_m)))
        except IllConditionedError:
            self._index.truncate(size)
            raise
        outcomes = []
        for number, is_new, (north_m, east_m, depth_m) in zip(near.tolist(), new.tolist(), rows.tolist(), strict=True):
            if is_new:
                size += 1
                if self.config.merge:
                    self._merged.append(MergedCenter(self.kernel, (north_m, east_m), depth_m, noise_std_m))
                self.counts.kept += 1
                outcomes.append(Outcome.KEPT)
            elif number < 0:
                self.counts.full += 1
                outcomes.append(Outcome.FULL)
            elif self.config.merge and number >= size - MERGE_WINDOW and not self._merged[number].full:
                self._merged[number].add((north_m, east_m), depth_m)
                self._moved.add(number)
                self.revision += 1
                self.counts.merged += 1
                outcomes.append(Outcome.MERGED)
            else:
                self.counts.too_close += 1
                outcomes.append(Outcome.TOO_CLOSE)
        return outcomes

    def fits(self, places_m: ArrayLike, depths_m: ArrayLike, sigmas: float) -> NDArray[np.bool_]:
        """Whether soundings (P,) at places (P, 2) lie within `sigmas` standard deviations of the map, shape (P,)."""
        self._sync()
        mean, variance = self._posterior.moments(places_m)
        return within_gate(self.config, np.asarray(depths_m, dtype=float), mean, variance, sigmas)

    def clear(self) -> None:
        """Forgets all soundings, to take them in again at other places."""
        self.counts = Counts()
        self._table = CenterTable()
        self._behind = True
        self._index = SpacingIndex(self.config.min_spacing_m)
        self._merged.clear()
        self._moved.clear()
        self._place_effect_m = None
        self.revision += 1

    def set_place_effect(self, effect_m: Array | None) -> None:
        """How uncertain places change what the centers should have measured, (n, r): see `Centers`.

        Centers that come later have none until this is called again.

        Raises:
            ValueError: if there are more rows than centers.
        """
        if effect_m is not None and len(effect_m) > len(self):
            raise ValueError(f"place effect: got {len(effect_m)} rows; expected at most one for each of {len(self)}")
        self._place_effect_m = effect_m
        self._behind = True
        self.revision += 1

    @property
    def _held(self) -> Centers:
        """The centers as the table has them, with their place effects: not to be written to."""
        held, effect = self._table.centers, self._place_effect_m
        if effect is None:
            return held
        padded = np.zeros((len(held), effect.shape[1]))
        padded[: len(effect)] = effect[: len(held)]
        return Centers(held.places_m, held.depths_m, held.noise_std_m, padded)

    # ---------------------------------------------------------------- posterior out

    @property
    def centers(self) -> Centers:
        """A copy of the kernel centers."""
        if self._certain(len(self)):
            self._settle()
        else:
            self._sync()
        held = self._held
        return Centers(held.places_m.copy(), held.depths_m.copy(), held.noise_std_m.copy(), held.place_effect_m)

    @property
    def posterior(self) -> Posterior:
        """The posterior given all centers, brought up to date.

        Whoever plans places on it forgets them before the next sounding comes.
        """
        self._sync()
        return self._posterior

    def predict(self, places_m: ArrayLike) -> tuple[Array, Array]:
        """Mean and standard deviation (P,), (P,) of the depth (without noise) at places (P, 2)."""
        self._sync()
        if self.config.local and not self.kernel.compact:
            mean, variance = predict_locally(self._posterior.blank(), self._table.centers, places_m)
            variance = variance + self._posterior.place_variance(self.kernel.scale(np.asarray(places_m, dtype=float)))
        else:
            mean, variance = self._posterior.moments(places_m)
        return mean, np.sqrt(variance)

    # ---------------------------------------------------------------- inside

    def _warn_of_short_support(self) -> None:
        usual = LOCAL_RATIO.get(self.kernel.name, 0.0) * self.config.length_scale_m
        if self.config.local and not self.kernel.compact and self.kernel.local_m < usual:
            text = (
                f"gp.support_m: {self.kernel.local_m:g} m is less than {LOCAL_RATIO[self.kernel.name]:g} length scales "
                f"({usual:g} m): the local subset of {self.kernel.name} then errs visibly, see docs/gp.md"
            )
            self.problems.append(text)
            warnings.warn(text, stacklevel=3)

    def _certain(self, size: int) -> bool:
        """Whether `size` centers can be factorized wherever they are, so that nothing is lost by doing it later.

        No pivot is less than the least noise variance; their rounding errors are within about size^2 eps times the
        largest variance (Higham 2002, theorems 10.3 and 10.7). The gate for outliers wants the factor each time anyway.
        """
        noise_m2 = self.config.noise_std_m**2
        least_noise_m2 = noise_m2 / (MAX_MERGED if self.config.merge else 1)
        largest = 4.0 * self.kernel.signal_variance_m2 + noise_m2  # merging adds at most 4 k(p, p) of noise
        rounding = 4.0 * (size + 1) ** 2 * _EPSILON * largest
        return self.config.outlier_sigmas == 0.0 and least_noise_m2 > rounding

    def _append(self, centers: Centers) -> None:
        """Appends centers; a refusal changes nothing."""
        if not len(centers):
            return
        n = len(self)
        certain = self._certain(n + len(centers))
        if not certain:
            self._sync()
        self._table.append(centers)
        self._behind = True
        if not certain:
            try:
                self._sync()
            except IllConditionedError:
                self._table.truncate(n)
                raise
        self.revision += len(centers)

    def _settle(self) -> None:
        """Moves the centers that soundings were merged into."""
        for i in self._moved:
            place, depth, noise_m2 = self._merged[i].summary()
            self._table.move(i, place, depth, math.sqrt(noise_m2))
        self._behind = self._behind or bool(self._moved)
        self._moved.clear()

    def _sync(self) -> None:
        """Moves the centers that soundings were merged into, and lets the posterior follow the table."""
        before = self._table.copy() if self._moved else None
        self._settle()
        if not self._behind:
            return
        try:
            self._posterior.follow(self._held)
        except IllConditionedError:
            if before is None:
                raise
            # Merging lowers the noise and may bring centers together. What was held before is known to work.
            self._table = before
            self._posterior.follow(self._held)
            self.problems.append(
                "merging made the covariance of the centers ill-conditioned: these soundings are not merged"
            )
        self._behind = False
