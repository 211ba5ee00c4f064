"""Finds the dive that sent a message of a standard type, which has no field for its id.

A node that publishes such messages for other nodes introduces itself on the topic `dive`. Its readers note the
participant of the ROS domain from which the introduction came: all writers of a process share the first 12 bytes of
their ids. rclpy 7.1 leaves the writer's id out of what it returns with a message, so rcl is asked for it.
"""

import contextlib
import ctypes
import functools
import weakref
from typing import Any, NamedTuple

from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rclpy.utilities import get_rmw_implementation_identifier

from auv_lse_common.node.dive import dive_of

#: Bytes of a writer's id that its participant's other writers share (RTPS: GUID prefix).
_PARTICIPANT = 12
#: Time (s) in which a participant must introduce itself; one that does not belongs to a user's driver.
_PATIENCE_S = 1.0
#: Number of participants that are remembered; the oldest are dropped.
_REMEMBERED = 256


class _Allocator(ctypes.Structure):
    _fields_ = [(name, ctypes.c_void_p) for name in ("allocate", "deallocate", "reallocate", "zero_allocate", "state")]


class _Bytes(ctypes.Structure):
    _fields_ = [
        ("buffer", ctypes.c_void_p),
        ("length", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
        ("allocator", _Allocator),
    ]


class _MessageInfo(ctypes.Structure):
    _fields_ = [
        ("times_and_numbers", ctypes.c_int64 * 4),
        ("implementation", ctypes.c_char_p),
        ("writer", ctypes.c_uint8 * 24),  # 16 in Jazzy
        ("rest", ctypes.c_uint8 * 64),
    ]


@functools.cache
def _rcl() -> Any:
    library = ctypes.CDLL("librcl.so")
    library.rcl_take_serialized_message.argtypes = [ctypes.c_void_p] * 4
    utilities = ctypes.CDLL("librcutils.so")
    utilities.rcutils_get_default_allocator.restype = _Allocator
    utilities.rcutils_uint8_array_fini.argtypes = [ctypes.c_void_p]
    return library.rcl_take_serialized_message, utilities


class Taken(NamedTuple):
    """A message and the participant that has sent it."""

    message: Any
    participant: bytes


class _Taker:
    """Reads the messages of a subscription with their senders; called by `StandingExecutor`."""

    def __init__(self, subscription: Subscription) -> None:
        self._subscription, self._info = subscription, _MessageInfo()
        self._take, utilities = _rcl()
        self._data = _Bytes(allocator=utilities.rcutils_get_default_allocator())  # grows with the longest message
        self._addresses = ctypes.addressof(self._data), ctypes.addressof(self._info), None
        weakref.finalize(self, lambda data: utilities.rcutils_uint8_array_fini(ctypes.addressof(data)), self._data)

    def __call__(self) -> Taken | None:
        """The next message, as bytes if the subscription is a raw one; None: there is none."""
        subscription = self._subscription
        if self._take(subscription.handle.pointer, *self._addresses):
            return None
        message = ctypes.string_at(self._data.buffer, self._data.length)
        participant = bytes(self._info.writer[:_PARTICIPANT])
        return Taken(message if subscription.raw else deserialize_message(message, subscription.msg_type), participant)


def take_with_sender(subscription: Subscription) -> Subscription:
    """Lets `StandingExecutor` call the subscription's callback with each message and its participant.

    Only Fast DDS is known to name a participant; with another middleware, or where rcl cannot be called, the callback
    gets the message alone.
    """
    with contextlib.suppress(OSError, AttributeError):  # a ROS whose libraries are elsewhere, or differ
        _rcl()
        if get_rmw_implementation_identifier().startswith("rmw_fastrtps"):
            subscription.take = _Taker(subscription)
    return subscription


class Senders:
    """The dives of the participants that have introduced themselves.

    Attributes:
        nodes: Names of the nodes of this node's dive that have done so.
    """

    def __init__(self, own: str) -> None:
        """Args: own: id of the node's dive."""
        self._own = own
        self._dives: dict[bytes, str] = {}
        self._heard_s: dict[bytes, float] = {}
        self.nodes: set[str] = set()

    def introduce(self, message: Any, participant: bytes = b"") -> None:
        """Handles a message of the topic `dive`."""
        if message.dive == self._own:
            self.nodes.add(message.node)
        self._dives.pop(participant, None)
        self._dives[participant] = message.dive
        if len(self._dives) > _REMEMBERED:
            del self._dives[next(iter(self._dives))]

    def sender_of(self, frame: str, participant: bytes | None, now_s: float) -> str | None:
        """The id of the dive that has sent a message of a standard type.

        Args:
            frame: The frame in its header; in recordings of earlier versions it begins with the id.
            participant: The participant that has sent it; None: unknown, as with rclpy's own executor or another
                middleware than Fast DDS, and taken for one of this node's dive.
            now_s: A monotonic clock.

        Returns:
            The id; "" for a sender without one; None while the participant may still introduce itself.
        """
        if (found := dive_of(frame)) or participant is None:
            return found or self._own
        if participant in self._dives:
            return self._dives[participant]
        heard_s = self._heard_s.setdefault(participant, now_s)
        if len(self._heard_s) > _REMEMBERED:
            del self._heard_s[next(iter(self._heard_s))]
        return None if now_s - heard_s < _PATIENCE_S else ""
