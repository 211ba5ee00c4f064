"""Queues the inputs of a vehicle's map and applies them once per tick."""

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, Fix, MateNavigation
from auv_lse_common.vocabulary.map_quality import Quality
from auv_lse_common.vocabulary.sounding import Sounding, Soundings
from auv_lse_common.vocabulary.sounding_gate import SoundingGate
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.map.quality_watch import QualityWatch
from auv_lse_gp.positions.position_corrector import Checkpoint, PositionCorrector


class MapIntake:
    """Queues soundings, samples and navigation for the map, and applies them in a fixed order.

    Attributes:
        corrector: Corrects the positions of soundings; None: uses their estimated positions.
        watch: Judges the map's quality; None: it is not judged.
        sounded_s: Time (s) of the last step with a sounding of this vehicle, initially of the first step.
    """

    def __init__(
        self,
        depth_map: DepthMap,
        corrector: PositionCorrector | None = None,
        watch: QualityWatch | None = None,
    ) -> None:
        self.map = depth_map
        self.corrector = corrector
        self.watch = watch
        self.gate = SoundingGate()
        self.sounded_s = math.inf
        self._soundings: list[Sounding] = []
        self._samples: list[tuple[float, int, ArrayLike]] = []
        self._tracks: list[DeadReckoning] = []
        self._fixes: list[Fix] = []
        self._mates: list[MateNavigation] = []

    def add_soundings(self, rows: Iterable[Sequence[float]]) -> None:
        """Queues own soundings as rows of the fields of `Sounding` in order; the dead-reckoned position is optional."""
        self._soundings.extend(Sounding(*row) for row in rows)  # type: ignore[arg-type]  # vehicle: a whole number

    def add_samples(self, stamp_s: float, source: int, samples: ArrayLike) -> None:
        """Queues a mate's samples: end of reception (s), number of the sender, and north, east, depth (m), (n, 3)."""
        self._samples.append((stamp_s, source, samples))

    def add_dead_reckoning(self, position: DeadReckoning) -> None:
        """Queues the vehicle's dead-reckoned position; ignored without a corrector, like all navigation."""
        if self.corrector is not None:
            self._tracks.append(position)

    def add_fix(self, fix: Fix) -> None:
        """Queues a position fix of the vehicle."""
        if self.corrector is not None:
            self._fixes.append(fix)

    def add_navigation(self, mate: MateNavigation) -> None:
        """Queues the navigation data of a packet."""
        if self.corrector is not None:
            self._mates.append(mate)

    def waiting(self) -> dict[str, Any]:
        """The queued inputs as JSON values, for a journal; empty if there are none."""
        found: dict[str, list[Any]] = {
            "soundings": [[float(v) for v in (s if math.isfinite(s.raw_north_m) else s[:4])] for s in self._soundings],
            "samples": [[stamp_s, source, np.asarray(rows).tolist()] for stamp_s, source, rows in self._samples],
            "tracks": [dataclasses.asdict(position) for position in self._tracks],
            "fixes": [dataclasses.asdict(fix) for fix in self._fixes],
            "mates": [dataclasses.asdict(mate) for mate in self._mates],
        }
        return {name: values for name, values in found.items() if values}

    def put_back(self, waiting: Mapping[str, Any]) -> None:
        """Queues inputs that `waiting` returned, read from a journal."""
        self.add_soundings(waiting.get("soundings", ()))
        for stamp_s, source, rows in waiting.get("samples", ()):
            self.add_samples(stamp_s, source, rows)
        self._tracks += [DeadReckoning(**values) for values in waiting.get("tracks", ())]
        self._fixes += [Fix(**values) for values in waiting.get("fixes", ())]
        self._mates += [MateNavigation(**values) for values in waiting.get("mates", ())]

    def step_in_journal(self, now_s: float, write: Callable[..., None]) -> bool:
        """As `step`, then writes its inputs with `write`, and a checkpoint if there is one.

        They are written afterwards, so that inputs that crash the map are not repeated at every start.
        """
        if self._is_held:
            return False
        waiting = self.waiting()
        taken = self.step(now_s)
        if waiting:
            write("step", waiting, now_s)
            if self.corrector is not None and self.corrector.checkpoint is not None:
                write("checkpoint", dataclasses.asdict(self.corrector.checkpoint))
        return taken

    def restore(self, records: Sequence[Sequence[Any]]) -> None:
        """Repeats the steps of a journal. Inputs before the last checkpoint are only logged."""
        found = [values[0] for kind, *values in records if kind == "checkpoint"]
        joined_until_s = -math.inf
        if found and self.corrector is not None:
            checkpoint = Checkpoint(**found[-1])
            self.corrector.skip_to(checkpoint)
            joined_until_s = checkpoint.now_s if checkpoint.before_s is None else checkpoint.before_s
        last_s = math.inf  # of the queued step; infinite if there is none
        for kind, *values in records:
            if kind != "step":
                continue
            if math.isfinite(last_s) and not (values[1] < joined_until_s and self._can_join(values[0])):
                self.step(last_s)
            self.put_back(values[0])
            last_s = values[1]
        if math.isfinite(last_s):
            self.step(last_s)
        if self.corrector is not None:
            self.corrector.end_skip()
        judged = [values[0] for kind, *values in records if kind == "judged"]
        if judged and self.watch is not None:
            self.watch.restore(judged[-1])

    def _can_join(self, waiting: Mapping[str, Any]) -> bool:
        """Whether one step with the queued inputs and those of the next step gives the same log as two steps."""
        if self._samples or self._fixes or self._mates:
            return False
        queued = (
            [sounding.stamp_s for sounding in self._soundings[-1:]],
            [position.stamp_s for position in self._tracks[-1:]],
        )
        following = [row[0] for row in waiting.get("soundings", ())], [t["stamp_s"] for t in waiting.get("tracks", ())]
        return all(a <= b for one, other in zip(queued, following, strict=True) for a, b in pairwise(one + other))

    def step(self, now_s: float) -> bool:
        """Updates the map: own soundings by stamp, then samples by stamp and source.

        With a corrector, navigation comes before the soundings that it positions, and the correction comes last. While
        the map stands still (`QualityWatch.holds`), all inputs wait.

        Returns:
            Whether there were soundings or samples, or positions were corrected.
        """
        if self._is_held:
            return False
        waited = bool(self._soundings or self._samples)
        has_sounding = any(math.isfinite(sounding.depth_m) for sounding in self._soundings)
        self.sounded_s = now_s if has_sounding else min(self.sounded_s, now_s)
        if self.corrector is None:
            self._take()
            return waited
        for position in sorted(self._tracks, key=lambda position: position.stamp_s):
            self.corrector.add_dead_reckoning(position)
        for fix in sorted(self._fixes, key=lambda fix: fix.stamp_s):
            self.corrector.add_fix(fix)
        for mate in sorted(self._mates, key=lambda mate: (mate.stamp_s, mate.source)):
            self.corrector.add_navigation(mate)
        self._tracks, self._fixes, self._mates = [], [], []
        self._take()
        return self.corrector.step(now_s) or waited

    def judge(self, now_s: float, is_running: bool, write: Callable[..., None] | None = None) -> Quality | None:
        """Begins a judgement of the map's quality if one is due, and does one slice of it. Call it after each step.

        Args:
            now_s: Mission time.
            is_running: Whether the mission runs; else a judgement is abandoned.
            write: Writes the state of the watch into a journal when it has changed.

        Returns:
            The quality, once it is done.
        """
        if self.watch is None:
            return None
        if not is_running:
            self.watch.stop()
            return None
        begun = self.watch.begin_if_due(now_s, self.map.gp)
        quality = self.watch.advance(now_s)
        if write is not None and (begun or quality is not None):
            write("judged", self.watch.snapshot())
        return quality

    @property
    def _is_held(self) -> bool:
        return self.watch is not None and self.watch.holds

    def _take(self) -> None:
        passed = self.gate.passed(sorted(self._soundings, key=itemgetter(0)))
        self._soundings = []
        if passed:
            (self.map if self.corrector is None else self.corrector).add_soundings(Soundings.from_rows(passed))
        for _, source, samples in sorted(self._samples, key=lambda entry: entry[:2]):
            if self.corrector is None:
                self.map.add_samples(samples, source)
            else:
                self.corrector.add_samples(np.asarray(samples, dtype=float).reshape(-1, 3), source)
        self._samples = []
