"""What a vehicle's map does in a tick: takes what has come in."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix, MateNavigation
from auv_lse_common.vocabulary.sounding_gate import SoundingGate
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.places.position_corrector import PositionCorrector


class MapIntake:
    """Soundings, samples and navigation that wait for the map, and the order in which it takes them.

    Attributes:
        map: The map.
        corrector: What corrects the soundings' places; None: they are taken where they were told.
        gate: What own soundings pass before the map takes them.
        sounded_s: Time of the step that last had an own sounding (s); at first of the first step.
    """

    def __init__(self, depth_map: DepthMap, corrector: PositionCorrector | None = None) -> None:
        """Nothing waits yet."""
        self.map = depth_map
        self.corrector = corrector
        self.gate = SoundingGate()
        self.sounded_s = math.inf
        self._soundings: list[Sequence[float]] = []
        self._samples: list[tuple[float, int, ArrayLike]] = []
        self._tracks: list[DeadReckoning] = []
        self._fixes: list[Fix] = []
        self._mates: list[MateNavigation] = []

    def add_soundings(self, rows: Iterable[Sequence[float]]) -> None:
        """Own soundings: stamp (s), north, east, depth (m) of each, then raw north, east (m) where known."""
        self._soundings.extend(rows)

    def add_samples(self, stamp_s: float, source: int, samples: ArrayLike) -> None:
        """A mate's samples: end of reception (s), number of the sender; north, east, depth (m) of each, (n, 3)."""
        self._samples.append((stamp_s, source, samples))

    def add_dead_reckoning(self, place: DeadReckoning) -> None:
        """The vehicle's raw place; without a corrector nothing is made of navigation."""
        if self.corrector is not None:
            self._tracks.append(place)

    def add_fix(self, fix: Fix) -> None:
        """A fix of the vehicle's own."""
        if self.corrector is not None:
            self._fixes.append(fix)

    def add_navigation(self, mate: MateNavigation) -> None:
        """What a packet told of its sender's navigation."""
        if self.corrector is not None:
            self._mates.append(mate)

    def waiting(self) -> dict[str, Any]:
        """What the next step will take, as values that JSON holds: for a journal; empty if nothing waits."""
        found: dict[str, list[Any]] = {
            "soundings": [[float(v) for v in row] for row in self._soundings],
            "samples": [[stamp_s, source, np.asarray(rows).tolist()] for stamp_s, source, rows in self._samples],
            "tracks": [dataclasses.asdict(place) for place in self._tracks],
            "fixes": [dataclasses.asdict(fix) for fix in self._fixes],
            "mates": [dataclasses.asdict(mate) for mate in self._mates],
        }
        return {name: values for name, values in found.items() if values}

    def put_back(self, waiting: Mapping[str, Any]) -> None:
        """Takes what `waiting` gave, read from a journal."""
        self.add_soundings(waiting.get("soundings", ()))
        for stamp_s, source, rows in waiting.get("samples", ()):
            self.add_samples(stamp_s, source, rows)
        self._tracks += [DeadReckoning(**values) for values in waiting.get("tracks", ())]
        self._fixes += [Fix(**values) for values in waiting.get("fixes", ())]
        self._mates += [MateNavigation(**values) for values in waiting.get("mates", ())]

    def step(self, now_s: float) -> bool:
        """The map takes what waits: own soundings by stamp, then samples by stamp and source.

        With a corrector, navigation comes before the soundings that it places, and places are corrected last.

        Returns:
            False if nothing waited for the map, and no place was corrected.
        """
        waited = bool(self._soundings or self._samples)
        has_sounding = any(math.isfinite(row[3]) for row in self._soundings)
        self.sounded_s = now_s if has_sounding else min(self.sounded_s, now_s)
        if self.corrector is None:
            self._take()
            return waited
        for place in sorted(self._tracks, key=lambda place: place.stamp_s):
            self.corrector.add_dead_reckoning(place)
        for fix in sorted(self._fixes, key=lambda fix: fix.stamp_s):
            self.corrector.add_fix(fix)
        for mate in sorted(self._mates, key=lambda mate: (mate.stamp_s, mate.source)):
            self.corrector.add_navigation(mate)
        self._tracks, self._fixes, self._mates = [], [], []
        self._take()
        return self.corrector.step(now_s) or waited

    def _take(self) -> None:
        passed, self._soundings = self.gate.passed(sorted(self._soundings, key=lambda row: row[0])), []
        if passed:
            if self.corrector is None:
                self.map.add_soundings([row[:4] for row in passed])
            else:
                self.corrector.add_soundings(np.array([_with_raw(row) for row in passed], dtype=float))
        for _, source, samples in sorted(self._samples, key=lambda entry: entry[:2]):
            if self.corrector is None:
                self.map.add_samples(samples, source)
            else:
                self.corrector.add_samples(np.asarray(samples, dtype=float).reshape(-1, 3), source)
        self._samples = []


def _with_raw(row: Sequence[float]) -> tuple[float, ...]:
    """A sounding's row with its raw place, NaN where it has none."""
    return (*row, float("nan"), float("nan")) if len(row) == 4 else tuple(row)
