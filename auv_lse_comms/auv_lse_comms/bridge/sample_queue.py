"""The soundings of one vehicle that wait to be sent as samples."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auv_lse_common.mission_file.sections.acoustics import PacketConfig
from auv_lse_common.vocabulary.sounding import Sounding, Soundings
from auv_lse_comms.packet.codec import Limits
from auv_lse_comms.packet.selection import Receivers, every_nth, most_useful

Array = NDArray[np.float64]


class SampleQueue:
    """Unsent samples in time order, and the choice of those that go into the next packet.

    Its rows have six columns: stamp (s), north, east, depth (m), the gain when last computed (infinite: never), and
    that gain before the last packet.
    """

    def __init__(
        self, config: PacketConfig, limits: Limits | None, receivers: Receivers | None, counts: Counter[str]
    ) -> None:
        """Starts empty.

        Args:
            config: What goes into a packet.
            limits: What a mission's packets can hold; None: the ranges of the field table.
            receivers: Estimate of the receivers' knowledge, for `packet.selection` "useful".
            counts: Counter for "samples.<what>".
        """
        self._config, self._limits, self._counts = config, limits or Limits(), counts
        self._receivers = receivers
        self._useful = receivers if config.selection == "useful" else None
        self._rows = np.zeros((0, 6))
        self._new: list[Array] = []  # added, not merged into the rows yet, shape (n, 4)
        self._last: tuple[float, float] | None = None  # place (m) of the last sounding added

    def __len__(self) -> int:
        """Number of unsent samples."""
        return len(self._rows) + sum(map(len, self._new))

    def add(self, soundings: ArrayLike | Soundings | Sequence[Sounding]) -> Array:
        """Adds soundings and drops unusable ones, see `ModemBridge.add_soundings`.

        Returns:
            The added rows: stamp, north, east, depth, shape (k, 4).
        """
        given = soundings if isinstance(soundings, Soundings) else Soundings.from_rows(soundings)
        if not len(given):
            return given.rows
        if self._config.navigation:
            placed = np.asarray(np.isfinite(given.raw_places_m).all(axis=1))
            self._counts["samples.unplaced"] += int((~placed).sum())
            given = given[placed]
        places_m = given.raw_places_m if self._config.navigation else given.places_m
        rows = np.column_stack([given.stamp_s, places_m, given.depth_m])
        finite = np.isfinite(rows).all(axis=1)
        if not finite.all():
            self._counts["samples.bad"] += int((~finite).sum())
            rows = rows[finite]
        inside = self._limits.fits(rows[:, 1:])
        self._counts["samples.outside"] += int((~inside).sum())
        rows = rows[inside]
        if self._config.min_spacing_m > 0.0:
            rows = self._thinned(rows)
        if len(rows):
            self._new.append(rows)
            self._counts["samples.queued"] += len(rows)
        return rows

    def _thinned(self, rows: Array) -> Array:
        keep = np.zeros(len(rows), dtype=bool)
        for i, (_, north, east, _) in enumerate(rows.tolist()):
            last = self._last
            if last is None or math.hypot(north - last[0], east - last[1]) >= self._config.min_spacing_m:
                keep[i] = True
                self._last = (north, east)
        self._counts["samples.thinned"] += int((~keep).sum())
        return rows[keep]

    def take(self, room: int, loss: float) -> Array:
        """Removes and returns the rows for the next packet, shape (k, 6) with k <= `room`.

        Args:
            room: Samples that fit the packet.
            loss: Chance that a packet is lost.
        """
        rows = self._merged()
        if self._useful is None:
            chosen = every_nth(len(rows), room)
        else:
            rows[:, 5] = rows[:, 4]
            chosen = most_useful(rows[:, 1:4], room, self._useful, rows[:, 4])
            self._useful.send(loss)
        taken, self._rows = rows[chosen], np.delete(rows, chosen, axis=0)
        return taken

    def put_back(self, rows: Array, last: bool) -> None:
        """Requeues the rows of a packet that was not sent; `last`: no packet was taken after it."""
        merged = np.concatenate([rows, self._merged()])
        self._rows = merged[np.argsort(merged[:, 0], kind="stable")]
        if self._receivers is not None and last:
            self._receivers.take_back()
            self._rows[:, 4] = self._rows[:, 5]  # the later gains assumed that receivers know this packet's samples

    def restore(self, rows: Array) -> None:
        """Adds rows (n, 4) again that were added before a restart."""
        self._new.append(rows)
        self._last = (float(rows[-1, 1]), float(rows[-1, 2]))
        self._counts["samples.queued"] += len(rows)

    def restore_taken(self, samples: Array, loss: float) -> Array:
        """Removes and returns rows that were taken before a restart, by their stamps, places and depths (n, 4)."""
        rows = self._merged()
        gone = set(map(tuple, samples.tolist()))
        taken = np.array([tuple(row) in gone for row in rows[:, :4].tolist()], dtype=bool)
        found: Array = rows[taken]
        self._rows = rows[~taken]
        if self._useful is not None:
            self._useful.suppose(found[:, 1:4])
            self._useful.send(loss)
        return found

    def _merged(self) -> Array:
        """All unsent rows, in time order."""
        if self._new:
            new = np.concatenate(self._new)
            self._new.clear()
            self._rows = np.concatenate([self._rows, np.column_stack([new, np.full((len(new), 2), np.inf)])])
            if (np.diff(self._rows[:, 0]) < 0.0).any():
                self._rows = self._rows[np.argsort(self._rows[:, 0], kind="stable")]
        return self._rows
