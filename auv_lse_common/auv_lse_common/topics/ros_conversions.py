"""Makes ROS messages from the fields that `codecs.py` encodes."""

import array
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time

from auv_lse_common.topics.codecs import header_fields, time_fields
from auv_lse_common.topics.table import Topic


@cache
def message_class(kind: str) -> Any:
    """The class of a message type, "auv_lse_msgs/msg/Plan" or "auv_lse_msgs/Plan".

    Raises:
        ImportError: if its package is not installed.
        AttributeError: if the package has no such message.
    """
    package, *_, name = kind.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def to_message(kind: str, fields: Mapping[str, Any]) -> Any:
    """A message of a type; fields missing in `fields` have ROS's defaults."""
    return _filled(message_class(kind)(), fields)


def encoded(topic: Topic, value: Any, vehicle: int) -> Any:
    """The message of one of the stack's topics with a value of this vehicle."""
    assert topic.encode is not None, f"{topic.name}: its messages are not encoded by the table"
    return to_message(topic.kind, topic.encode(value, vehicle))


def stamp(seconds: float) -> Time:
    """ROS time of seconds since the clock's epoch, to the nearest nanosecond."""
    return Time(**time_fields(seconds))


def header(stamp_s: float) -> Any:
    """Header in the map frame (ENU)."""
    return to_message("std_msgs/msg/Header", header_fields(stamp_s))


@cache
def _element_class(kind: Any, field: str) -> Any:
    """The class of the messages in a sequence."""
    declared = kind.get_fields_and_field_types()[field]  # "sequence<geometry_msgs/Point>"
    return message_class(declared.removeprefix("sequence<").rstrip(">"))


def _filled(message: Any, fields: Mapping[str, Any]) -> Any:
    for name, value in fields.items():
        if isinstance(value, dict):
            _filled(getattr(message, name), value)
            continue
        if isinstance(value, list) and value and isinstance(value[0], dict):
            kind = _element_class(type(message), name)
            messages = {id(each): _filled(kind(), each) for each in value}  # ends of a line's segments come twice
            value = [messages[id(each)] for each in value]
        elif isinstance(value, np.ndarray) and isinstance(current := getattr(message, name), array.array):
            value = array.array(current.typecode, value.astype(current.typecode).tobytes())  # without a Python loop
        elif isinstance(value, int) and isinstance(getattr(message, name), bytes):  # a field of type byte
            value = bytes([value])
        setattr(message, name, value)
    return message
