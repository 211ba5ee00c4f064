"""Kernel centers: the depth measurements that the Gaussian process is conditioned on."""

from __future__ import annotations

import dataclasses

import numpy as np

from auv_lse_common.support.arrays import Array, Ints


@dataclasses.dataclass(frozen=True, slots=True)
class Centers:
    """The kernel centers.

    Attributes:
        locations_m: North, east (n, 2).
        depths_m: Depth (n,).
        noise_std_m: Standard deviation of each depth as a measurement (n,).
        position_effect_m: Change of each center's depth per standard deviation of each mode of common position errors
            (n, r); None if positions are assumed exact. A fix of the map's vehicle would remove the first two modes.
    """

    locations_m: Array
    depths_m: Array
    noise_std_m: Array
    position_effect_m: Array | None = None

    def __len__(self) -> int:
        """Number of centers."""
        return len(self.depths_m)

    def copy(self) -> Centers:
        """An independent copy."""
        effect = None if self.position_effect_m is None else self.position_effect_m.copy()
        return Centers(self.locations_m.copy(), self.depths_m.copy(), self.noise_std_m.copy(), effect)

    def slice(self, begin: int, end: int) -> Centers:
        """The centers from number `begin` to `end`, without copying."""
        effect, part = self.position_effect_m, slice(begin, end)
        kept = None if effect is None else effect[part]
        return Centers(self.locations_m[part], self.depths_m[part], self.noise_std_m[part], kept)

    def take(self, numbers: Ints) -> Centers:
        """The centers with these numbers, as copies."""
        effect = self.position_effect_m
        kept = None if effect is None else effect[numbers]
        return Centers(self.locations_m[numbers], self.depths_m[numbers], self.noise_std_m[numbers], kept)

    def averaged(self, groups: Ints) -> Centers:
        """One center in place of each group: the mean of its members, whose errors are independent.

        The new centers are in the order of the groups' first members. The curvature of the ground within a group is
        neglected.

        Args:
            groups: Keys (n, k); centers with equal keys form a group.
        """
        _, first, group = np.unique(groups, axis=0, return_index=True, return_inverse=True)
        ranks = np.empty(len(first), dtype=np.int64)
        ranks[np.argsort(first)] = np.arange(len(first))
        number = ranks[group.ravel()]
        count = np.bincount(number)

        def mean(columns: Array) -> Array:
            return np.stack([np.bincount(number, column) / count for column in columns.T], axis=1)

        effect = self.position_effect_m
        noise_std_m = np.sqrt(np.bincount(number, self.noise_std_m**2)) / count
        averaged_effect = None if effect is None or not effect.shape[1] else mean(effect)
        return Centers(mean(self.locations_m), mean(self.depths_m[:, None])[:, 0], noise_std_m, averaged_effect)

    def joined(self, others: Centers) -> Centers:
        """These centers, then `others`."""
        return Centers(
            np.concatenate([self.locations_m, others.locations_m]),
            np.concatenate([self.depths_m, others.depths_m]),
            np.concatenate([self.noise_std_m, others.noise_std_m]),
            _joined_effects(self, others),
        )


def _joined_effects(first: Centers, second: Centers) -> Array | None:
    """Position effects of both; missing modes are zero."""
    a, b = first.position_effect_m, second.position_effect_m
    if a is None and b is None:
        return None
    if a is None:
        a = np.zeros((len(first), b.shape[1] if b is not None else 0))
    if b is None:
        b = np.zeros((len(second), a.shape[1]))
    return np.concatenate([a, b])


#: An empty set of centers.
NO_CENTERS = Centers(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
