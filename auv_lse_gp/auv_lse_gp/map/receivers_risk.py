"""What the other vehicles know, as a sender believes, and what one more sample would be worth to them.

A sample's worth is the drop of the Bayes risk, summed over a coarse map of the operating area, that the receivers
expect of it before they know its depth (the paper's section "Search objective", with D1 what they know and D2 the
sample's place).

No sender learns what got through. A sender that takes all for known leaves holes where packets were lost, and does
worse than one that sends every n-th sample. So several receivers are supposed, each of which misses every packet, sent
or heard, with the chance that packets are lost then; a sample's worth is its mean over them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auv_lse_common.mission_file.parameters import section
from auv_lse_common.mission_file.sections.area import AreaConfig, OperatingArea
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.spacing import SpacingIndex

Array = NDArray[np.float64]

#: Left out: a place whose depth a sample explains by less than this share of its variance, ...
_NEGLIGIBLE_SHARE = 1e-3
#: ... and one whose Bayes risk is less than this share of the larger cost.
_NEGLIGIBLE_RISK = 1e-4
#: Supposed receivers.
ASSUMED_RECEIVERS = 4


class ReceiverMap:
    """What one vehicle knows: an exact Gaussian process on the samples it has, and the risk of a map given them.

    Samples nearer than `gp.min_spacing_m` to an earlier one are left out, as a vehicle's map merges them.

    Attributes:
        places_m: Where risk is summed, shape (G, 2): north, east.
    """

    def __init__(self, gp: GpConfig, level_set: LevelSetConfig, area: OperatingArea, spacing_m: float = 20.0) -> None:
        """Starts with nothing but the prior.

        Args:
            gp: The prior, and the noise of a sounding.
            level_set: The isobath and what errors cost.
            area: Where risk counts.
            spacing_m: Spacing of the places where it is summed.
        """
        self.places_m: Array = area.grid(spacing_m).places_m
        self._level_set = LevelSet.of(level_set)
        self._noise_std_m = gp.noise_std_m
        self._posterior = Posterior(gp)
        self._map = CachedPoints(self._posterior, self.places_m)
        self._index = SpacingIndex(gp.min_spacing_m)

    def __len__(self) -> int:
        """Number of samples that are known; the mark that `forget` takes."""
        return len(self._posterior)

    @property
    def risk(self) -> float:
        """Bayes risk, mean over the places."""
        return float(self._level_set.risk(*self.predict()).mean())

    def predict(self) -> tuple[Array, Array]:
        """Mean and standard deviation (G,), (G,) of the depth at the places."""
        places = self._map.current()
        return places.mean_m, np.sqrt(places.data_var_m2)

    def add(self, samples_m: Array) -> None:
        """Takes samples that the vehicle has now.

        Args:
            samples_m: North, east, water depth (m), shape (n, 3).
        """
        kept = []
        for north, east, depth in np.asarray(samples_m, dtype=float).tolist():
            if self._index.too_close(north, east) is None:
                self._index.add(north, east)
                kept.append((north, east, depth))
        if kept:
            rows = np.array(kept)
            self._posterior.extend(Centers(rows[:, :2], rows[:, 2], np.full(len(rows), self._noise_std_m)))

    def forget(self, mark: int) -> None:
        """Forgets all samples but the first `mark`."""
        self._posterior.truncate(mark)
        self._index.truncate(mark)

    def gains(self, samples_m: Array) -> Array:
        """Expected drop of its Bayes risk, summed over the places, by each sample alone, shape (n,).

        Args:
            samples_m: North, east, water depth (m), shape (n, 3). The depth is not looked at: it is not known
                yet.
        """
        at = np.asarray(samples_m, dtype=float)[:, :2]
        if not len(at):
            return np.zeros(0)
        places, samples = self._map.current(), self._posterior.at(at)
        mean, variance = places.mean_m, places.data_var_m2
        cross = self._posterior.covariance(samples, places)
        explained = np.minimum(cross**2 / (samples.data_var_m2 + self._posterior.noise_var_m2)[:, None], variance)
        cost = max(self._level_set.cost_false_safe, self._level_set.cost_false_unsafe)
        risky = self._level_set.risk(mean, np.sqrt(variance)) > _NEGLIGIBLE_RISK * cost
        sample, place = np.nonzero((explained > _NEGLIGIBLE_SHARE * variance) & risky)
        drop = explained[sample, place]
        benefit = self._level_set.benefit(mean[place], np.sqrt(drop), np.sqrt(np.maximum(variance[place] - drop, 0.0)))
        return np.asarray(np.bincount(sample, weights=benefit, minlength=len(at)), dtype=float)


class ReceiversRisk:
    """Has the shape that `auv_lse_comms.packet.selection.Receivers` asks for."""

    def __init__(
        self,
        gp: GpConfig,
        level_set: LevelSetConfig,
        area: OperatingArea,
        rng: np.random.Generator,
        spacing_m: float = 20.0,
    ) -> None:
        """Starts with receivers who know nothing but the prior.

        Args:
            gp: The prior, and the noise of a sounding.
            level_set: The isobath and what errors cost.
            area: Where risk counts.
            rng: Which packets the supposed receivers miss.
            spacing_m: Spacing of the places where risk is summed.
        """
        self._rng = rng
        self._receivers = [ReceiverMap(gp, level_set, area, spacing_m) for _ in range(ASSUMED_RECEIVERS)]
        self._missed = [0] * ASSUMED_RECEIVERS  # what each has missed, as a number: those with the same know the same
        self._marks = [len(receiver) for receiver in self._receivers]
        #: What the receivers knew and had missed before the last packet sent, while that can be taken back ...
        self._before_sent: tuple[list[int], list[int]] | None = None
        #: ... and what was heard after it: samples, and which receivers missed them.
        self._heard_since: list[tuple[Array, list[bool]]] = []

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any], where: str, address: int) -> ReceiversRisk:
        """From the sections `gp`, `level_set` and `area` of a mission file.

        Args:
            parameters: Nested parameters.
            where: Where they came from, for messages.
            address: Number of the sender.

        Raises:
            ParameterError: naming what cannot be used.
        """
        return cls(
            section(GpConfig, parameters, "gp", where),
            section(LevelSet, parameters, "level_set", where),
            OperatingArea(section(AreaConfig, parameters, "area", where)),
            stream(int(parameters.get("mission", {}).get("seed", 1)), "receivers", address),
        )

    def hear(self, samples_m: ArrayLike, loss: float) -> None:
        """A team mate's packet with these samples was heard; the others may have missed it.

        Args:
            samples_m: North, east, water depth (m), shape (n, 3).
            loss: Chance that a packet is lost at present.
        """
        samples = np.asarray(samples_m, dtype=float)
        missed = self._draw(loss)
        self._heard_since.append((samples, missed))
        self.suppose(samples)
        self._deliver(missed)

    def suppose(self, samples_m: ArrayLike) -> None:
        """The packet that is being made holds these samples too; its worth is computed as if it arrived.

        Args:
            samples_m: North, east, water depth (m), shape (n, 3).
        """
        for receiver in self._receivers:
            receiver.add(np.asarray(samples_m, dtype=float))

    def send(self, loss: float) -> None:
        """The packet is made; each of the supposed receivers misses it with the chance that packets are lost.

        Args:
            loss: That chance at present.
        """
        self._before_sent, self._heard_since = (self._marks, list(self._missed)), []
        self._deliver(self._draw(loss))

    def take_back(self) -> None:
        """The last packet given to `send` was not sent: nobody has its samples. What was heard since stays known."""
        if self._before_sent is None:
            return
        (self._marks, self._missed), self._before_sent = self._before_sent, None
        for receiver, mark in zip(self._receivers, self._marks, strict=True):
            receiver.forget(mark)
        for samples, missed in self._heard_since:
            self.suppose(samples)
            self._deliver(missed)

    def _draw(self, loss: float) -> list[bool]:
        """Which of the receivers miss a packet."""
        return [bool(missed) for missed in self._rng.random(len(self._receivers)) < loss]

    def _deliver(self, missed: list[bool]) -> None:
        """The packet of the samples supposed last is on its way; those who miss it forget them."""
        for i, receiver in enumerate(self._receivers):
            self._missed[i] = hash((self._missed[i], missed[i]))
            if missed[i]:
                receiver.forget(self._marks[i])
        self._marks = [len(receiver) for receiver in self._receivers]

    def gains(self, samples_m: ArrayLike) -> Array:
        """Expected drop of the receivers' Bayes risk by each sample alone, mean over the receivers, shape (n,).

        Args:
            samples_m: North, east, water depth (m), shape (n, 3).
        """
        samples = np.asarray(samples_m, dtype=float)
        different = dict(zip(self._missed, self._receivers, strict=True))
        known = {missed: receiver.gains(samples) for missed, receiver in different.items()}
        return np.asarray(np.mean([known[missed] for missed in self._missed], axis=0))
