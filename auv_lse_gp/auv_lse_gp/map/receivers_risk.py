"""The value of one more sample to the other vehicles, estimated by the sender.

The value is the expected drop of the receivers' Bayes risk, summed over a coarse map of the operating area (paper,
section "Search objective", with D1 the receivers' samples and D2 the sample's place).

A sender does not know which packets arrive. If it assumed that all do, lost packets would leave holes in the receivers'
maps. So it simulates several receivers, each of which misses every packet with the current loss rate, and averages the
value over them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.parameters import section
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_gp.inference.banks import Banks
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.spacing import SpacingIndex

Array = NDArray[np.float64]

#: Places are ignored if a sample explains less than this share of their variance ...
_NEGLIGIBLE_SHARE = 1e-3
#: ... or if their Bayes risk, relative to the larger cost, is below this.
_NEGLIGIBLE_RISK = 1e-4
#: Number of simulated receivers.
ASSUMED_RECEIVERS = 4


class ReceiverMap:
    """The map of one receiver: an exact Gaussian process on its samples, and its Bayes risk.

    Samples closer than `gp.min_spacing_m` to an earlier one are dropped, since a vehicle's map merges them.

    Attributes:
        places_m: Places over which risk is summed, shape (G, 2): north, east.
    """

    def __init__(self, gp: GpConfig, level_set: LevelSetConfig, area: OperatingArea, spacing_m: float = 20.0) -> None:
        """Starts with the prior; `spacing_m` is the spacing (m) of the places over which risk is summed."""
        self.places_m: Array = area.grid(spacing_m).places_m
        self._level_set = LevelSet.of(level_set)
        self._noise_std_m = gp.noise_std_m
        self._posterior = Posterior(gp, banks=Banks.of(area.config, level_set.level_m))
        self._map = CachedPoints(self._posterior, self.places_m)
        self._index = SpacingIndex(gp.min_spacing_m)

    def __len__(self) -> int:
        """Number of samples, which `truncate` takes as a mark."""
        return len(self._posterior)

    @property
    def risk(self) -> float:
        """Mean Bayes risk over the places."""
        return float(self._level_set.risk(*self.predict()).mean())

    def predict(self) -> tuple[Array, Array]:
        """Mean and standard deviation (G,), (G,) of the depth at the places."""
        places = self._map.current()
        return places.mean_m, np.sqrt(places.data_var_m2)

    def add(self, samples_m: Array) -> None:
        """Takes samples: north, east, water depth (m), shape (n, 3)."""
        kept = []
        for north, east, depth in np.asarray(samples_m, dtype=float).tolist():
            if self._index.too_close(north, east) is None:
                self._index.add(north, east)
                kept.append((north, east, depth))
        if kept:
            rows = np.array(kept)
            self._posterior.extend(Centers(rows[:, :2], rows[:, 2], np.full(len(rows), self._noise_std_m)))

    def truncate(self, mark: int) -> None:
        """Drops all samples but the first `mark`."""
        self._posterior.truncate(mark)
        self._index.truncate(mark)

    def gains(self, samples_m: Array) -> Array:
        """Expected drop of the Bayes risk, summed over the places, by each sample alone, shape (n,).

        Args:
            samples_m: North, east, water depth (m), shape (n, 3). The depths are not used.
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
    """Simulated receivers; implements `auv_lse_comms.packet.selection.Receivers`."""

    def __init__(
        self,
        gp: GpConfig,
        level_set: LevelSetConfig,
        area: OperatingArea,
        rng: np.random.Generator,
        spacing_m: float = 20.0,
    ) -> None:
        """Starts with receivers without samples; `rng` draws which packets they miss."""
        self._rng = rng
        self._receivers = [ReceiverMap(gp, level_set, area, spacing_m) for _ in range(ASSUMED_RECEIVERS)]
        self._missed = [0] * ASSUMED_RECEIVERS  # hash of the packets that each missed; equal hashes: equal samples
        self._marks = [len(receiver) for receiver in self._receivers]
        #: Marks and missed packets before the last packet sent, while it can be undone ...
        self._before_sent: tuple[list[int], list[int]] | None = None
        #: ... and packets heard after it: samples, and which receivers missed them.
        self._heard_since: list[tuple[Array, list[bool]]] = []

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any], where: str, address: int) -> ReceiversRisk:
        """From the sections `gp`, `level_set` and `area` of a mission file.

        Raises:
            ParameterError: naming the invalid parameter.
        """
        return cls(
            section(GpConfig, parameters, "gp", where),
            section(LevelSet, parameters, "level_set", where),
            OperatingArea(section(AreaConfig, parameters, "area", where)),
            stream(int(parameters.get("mission", {}).get("seed", 1)), "receivers", address),
        )

    def receive(self, samples_m: ArrayLike, loss: float) -> None:
        """Records a team mate's packet that this vehicle heard and the others may have missed.

        Args:
            samples_m: North, east, water depth (m), shape (n, 3).
            loss: Current probability that a packet is lost.
        """
        samples = np.asarray(samples_m, dtype=float)
        missed = self._draw(loss)
        self._heard_since.append((samples, missed))
        self.suppose(samples)
        self._deliver(missed)

    def suppose(self, samples_m: ArrayLike) -> None:
        """Adds samples (n, 3) to the packet being composed: north, east, water depth (m)."""
        for receiver in self._receivers:
            receiver.add(np.asarray(samples_m, dtype=float))

    def send(self, loss: float) -> None:
        """Sends the composed packet; each receiver misses it with probability `loss`."""
        self._before_sent, self._heard_since = (self._marks, list(self._missed)), []
        self._deliver(self._draw(loss))

    def take_back(self) -> None:
        """Undoes the last `send` of a packet that was not transmitted; packets heard since are kept."""
        if self._before_sent is None:
            return
        (self._marks, self._missed), self._before_sent = self._before_sent, None
        for receiver, mark in zip(self._receivers, self._marks, strict=True):
            receiver.truncate(mark)
        for samples, missed in self._heard_since:
            self.suppose(samples)
            self._deliver(missed)

    def _draw(self, loss: float) -> list[bool]:
        """Draws which receivers miss a packet."""
        return [bool(missed) for missed in self._rng.random(len(self._receivers)) < loss]

    def _deliver(self, missed: list[bool]) -> None:
        """Ends the composed packet; receivers that miss it drop its samples."""
        for i, receiver in enumerate(self._receivers):
            self._missed[i] = hash((self._missed[i], missed[i]))
            if missed[i]:
                receiver.truncate(self._marks[i])
        self._marks = [len(receiver) for receiver in self._receivers]

    def gains(self, samples_m: ArrayLike) -> Array:
        """Expected drop of the Bayes risk by each sample (n, 3) alone, averaged over the receivers, shape (n,)."""
        samples = np.asarray(samples_m, dtype=float)
        different = dict(zip(self._missed, self._receivers, strict=True))
        known = {missed: receiver.gains(samples) for missed, receiver in different.items()}
        return np.asarray(np.mean([known[missed] for missed in self._missed], axis=0))
