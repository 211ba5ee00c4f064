"""Fields of many messages of one type at once, as arrays; `codecs.py` encodes those of one message."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.vocabulary.frames import wrap_pi
from auv_lse_common.vocabulary.sounding import Soundings

#: Where a number is in a message's fields, such as ("pose", "covariance", 7), and its values (n,) in n messages.
Columns = dict[tuple[str | int, ...], NDArray[Any]]


def stamps_ns(stamps_s: Array) -> Ints:
    """Stamps (s), shape (n,), in whole nanoseconds."""
    rounded: Ints = np.rint(stamps_s * 1e9).astype(np.int64)
    return rounded


def _header(stamps_s: Array) -> Columns:
    whole, rest = np.divmod(stamps_ns(stamps_s), 10**9)
    return {("header", "stamp", "sec"): whole.astype("<i4"), ("header", "stamp", "nanosec"): rest.astype("<u4")}


def odometry_columns(track: Array, position_std_m: Array | None = None) -> Columns:
    """The fields that differ between the Odometry messages of a track, as `encode_odometry` encodes them.

    Args:
        track: Rows (time s, north m, east m, heading rad), and perhaps the vehicle's depth (m), shape (n, 4 or 5).
        position_std_m: Standard deviations north and east (m), shape (n, 2); None: not in the messages.
    """
    half = wrap_pi(np.pi / 2.0 - track[:, 3]) / 2.0
    columns: Columns = {
        **_header(track[:, 0]),
        ("pose", "pose", "position", "x"): track[:, 2],
        ("pose", "pose", "position", "y"): track[:, 1],
        ("pose", "pose", "orientation", "z"): np.sin(half),
        ("pose", "pose", "orientation", "w"): np.cos(half),
    }
    if track.shape[1] > 4:
        columns["pose", "pose", "position", "z"] = -track[:, 4]
    if position_std_m is not None:
        columns["pose", "covariance", 0] = position_std_m[:, 1] ** 2
        columns["pose", "covariance", 7] = position_std_m[:, 0] ** 2
    return columns


def sounding_columns(soundings: Soundings) -> Columns:
    """The fields that differ between Sounding messages, as `encode_sounding` encodes them."""
    names = ("north_m", "east_m", "depth_m", "raw_north_m", "raw_east_m")
    return {**_header(soundings.stamp_s), **{(name,): getattr(soundings, name) for name in names}}
