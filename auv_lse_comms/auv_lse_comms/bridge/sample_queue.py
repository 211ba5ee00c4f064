"""The soundings of one vehicle that wait to be sent as samples."""

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auv_lse_common.mission_file.sections.acoustics import PacketConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.sounding import Sounding, Soundings
from auv_lse_comms.packet.codec import Limits


def every_nth(unsent: int, room: int) -> NDArray[np.intp]:
    """Every n-th of the unsent samples in time order, with n = (unsent - 1) / (room - 1), not rounded (section 5).

    The oldest is always included, so that every sample is sent eventually; a backlog is covered evenly.

    Args:
        unsent: Number of unsent samples.
        room: Number of samples that fit the packet.

    Returns:
        Ascending indices of min(unsent, room) different samples.
    """
    if unsent <= room:
        return np.arange(unsent)
    if room <= 1:
        return np.arange(room)
    return np.rint(np.linspace(0.0, unsent - 1.0, room)).astype(np.intp)


class SampleQueue:
    """Unsent samples in time order, and the choice of those that go into the next packet.

    Its rows have four columns: stamp (s), north, east, depth (m).
    """

    def __init__(self, config: PacketConfig, limits: Limits | None, counts: Counter[str]) -> None:
        """Starts empty.

        Args:
            config: The content of packets.
            limits: Limits of a mission's packets; None: the ranges of the field table.
            counts: Counter for "samples.<what>".
        """
        self._config, self._limits, self._counts = config, limits or Limits(), counts
        self._rows = np.zeros((0, 4))
        self._new: list[Array] = []  # added, not merged into the rows yet

    def __len__(self) -> int:
        """Number of unsent samples."""
        return len(self._rows) + sum(map(len, self._new))

    def add(self, soundings: ArrayLike | Soundings | Sequence[Sounding]) -> Array:
        """Adds soundings and drops unusable ones, see `ModemBridge.add_soundings`.

        Returns:
            The added rows.
        """
        given = soundings if isinstance(soundings, Soundings) else Soundings.from_rows(soundings)
        if not len(given):
            return given.rows
        if self._config.navigation:
            placed = np.asarray(np.isfinite(given.raw_positions_m).all(axis=1))
            self._counts["samples.unplaced"] += int((~placed).sum())
            given = given[placed]
        locations_m = given.raw_positions_m if self._config.navigation else given.locations_m
        rows = np.column_stack([given.stamp_s, locations_m, given.depth_m])
        finite = np.isfinite(rows).all(axis=1)
        if not finite.all():
            self._counts["samples.bad"] += int((~finite).sum())
            rows = rows[finite]
        inside = self._limits.fits(rows[:, 1:])
        self._counts["samples.outside"] += int((~inside).sum())
        rows = rows[inside]
        if len(rows):
            self._new.append(rows)
            self._counts["samples.queued"] += len(rows)
        return rows

    def take(self, room: int) -> Array:
        """Removes and returns the rows for the next packet, at most `room`."""
        rows = self._merged()
        chosen = every_nth(len(rows), room)
        taken, self._rows = rows[chosen], np.delete(rows, chosen, axis=0)
        return taken

    def put_back(self, rows: Array) -> None:
        """Requeues the rows of a packet that was not sent."""
        merged = np.concatenate([rows, self._merged()])
        self._rows = merged[np.argsort(merged[:, 0], kind="stable")]

    def restore(self, rows: Array) -> None:
        """Adds rows again that were added before a restart."""
        self._new.append(rows)
        self._counts["samples.queued"] += len(rows)

    def restore_taken(self, samples: Array) -> Array:
        """Removes and returns rows that were taken before a restart."""
        rows = self._merged()
        sent = set(map(tuple, samples.tolist()))
        taken = np.array([tuple(row) in sent for row in rows.tolist()], dtype=bool)
        found: Array = rows[taken]
        self._rows = rows[~taken]
        return found

    def _merged(self) -> Array:
        """All unsent rows, in time order."""
        if self._new:
            self._rows = np.concatenate([self._rows, *self._new])
            self._new.clear()
            if (np.diff(self._rows[:, 0]) < 0.0).any():
                self._rows = self._rows[np.argsort(self._rows[:, 0], kind="stable")]
        return self._rows
