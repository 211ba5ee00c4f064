"""Messages as text, as `ros2 topic echo` prints them; needs only a message's list of fields."""

import difflib
import re
from collections.abc import Mapping, Sequence
from typing import Any

import yaml

#: Default length to which sequences and texts are cut.
TRUNCATE = 128

_PART = re.compile(r"(\w+)|\[(-?\d+)\]")


class FieldError(ValueError):
    """A field that a message does not have."""


def plain(value: Any, truncate: int | None = TRUNCATE, arrays: bool = True) -> Any:
    """A message, or a part of one, as mappings, lists and scalars.

    Args:
        value: A message (anything with `get_fields_and_field_types`), a sequence or a scalar.
        truncate: Length to which sequences and texts are cut; None: not cut.
        arrays: Whether sequences are written out; otherwise only their length.
    """
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name), truncate, arrays) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        value = list(value)
    elif hasattr(value, "tolist"):  # arrays of numpy or the standard library
        value = value.tolist()
    if isinstance(value, str):
        return value if truncate is None or len(value) <= truncate else value[:truncate] + "..."
    if isinstance(value, Sequence):
        if not arrays:
            return f"<sequence of {len(value)}>"
        shown = value if truncate is None else value[:truncate]
        more = ["..."] if len(shown) < len(value) else []
        return [plain(v, truncate, arrays) for v in shown] + more
    return value


def yaml_text(content: Any) -> str:
    """The result of `plain` as YAML; scalars are unchanged."""
    if not isinstance(content, Mapping | list):
        return f"{content}\n"
    text: str = yaml.safe_dump(content, sort_keys=False, default_flow_style=False, allow_unicode=True, width=2**31)
    return text


def csv_text(content: Any) -> str:
    """The result of `plain` as one line of comma-separated values."""
    return ",".join(str(v) for v in _leaves(content)) + "\n"


def _leaves(content: Any) -> list[Any]:
    if isinstance(content, Mapping):
        return [leaf for value in content.values() for leaf in _leaves(value)]
    if isinstance(content, list):
        return [leaf for value in content for leaf in _leaves(value)]
    return [content]


def field_of(message: Any, path: str) -> Any:
    """The part of a message at `path`: "pose.pose.position.x", "status[0].values[1].key".

    Raises:
        FieldError: naming the missing part, and the existing ones.
    """
    value, done = message, ""
    for part in _PART.finditer(path):
        name, index = part[1], part[2]
        if index is not None:
            if not hasattr(value, "__len__") or not -len(value) <= int(index) < len(value):
                count = f"{len(value)} elements" if hasattr(value, "__len__") else "no sequence"
                raise FieldError(f"field {path!r}: [{index}] not found; {done or 'the message'} has {count}")
            value, done = value[int(index)], f"{done}[{index}]"
            continue
        fields = list(value.get_fields_and_field_types()) if hasattr(value, "get_fields_and_field_types") else []
        if name not in fields:
            near = difflib.get_close_matches(name, fields, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else f"; it has {', '.join(fields) or 'no fields'}"
            raise FieldError(f"field {path!r}: {done or 'the message'} has no {name!r}{hint}")
        value, done = getattr(value, name), f"{done}.{name}".strip(".")
    return value
