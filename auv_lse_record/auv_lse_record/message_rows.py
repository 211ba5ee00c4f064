"""Serializes many messages of one type that differ only in some numbers, such as those of a track, at once."""

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.topics.columns import Columns
from auv_lse_record.message_types import make_message


class MessageRows:
    """The messages of one topic.

    The first message is serialized as any other. Changing one number after the other shows where the other messages
    differ from it, so that no layout of a type is assumed.
    """

    def __init__(self, store: Any, kind: str, fields: Mapping[str, Any], columns: Columns) -> None:
        """Finds where the numbers are.

        Args:
            store: Type store with the type.
            fields: Fields of one of the messages.
            columns: The numbers that differ, shape (n,) each.

        Raises:
            ValueError: if one of them is not a number of its column's type in the message.
        """

        def serialized(changed: Mapping[tuple[str | int, ...], Any]) -> NDArray[np.uint8]:
            own = copy.deepcopy(dict(fields))
            for path, value in changed.items():
                inner: Any = own
                for name in path[:-1]:
                    inner = inner[name] if isinstance(inner, np.ndarray) else inner.setdefault(name, {})
                inner[path[-1]] = value
            return np.frombuffer(store.serialize_cdr(make_message(store, kind, own), kind), dtype=np.uint8)

        zeros = {path: values.dtype.type(0) for path, values in columns.items()}
        self._first = serialized(zeros)
        self._columns: list[tuple[slice, NDArray[Any]]] = []
        for path, values in columns.items():
            width = values.dtype.itemsize
            mark = np.frombuffer(b"\1" * width, dtype=values.dtype)[0]
            at = np.flatnonzero(serialized(zeros | {path: mark}) != self._first)
            if len(at) != width or at[-1] - at[0] != width - 1:
                raise ValueError(f"{kind} has no number of {width} bytes at {'.'.join(map(str, path))}.")
            self._columns.append((slice(int(at[0]), int(at[-1]) + 1), np.ascontiguousarray(values)))

    def between(self, start: int, stop: int) -> NDArray[np.uint8]:
        """The bytes (CDR) of some of the messages, one in each row."""
        rows = np.tile(self._first, (stop - start, 1))
        for at, values in self._columns:
            rows[:, at] = values[start:stop, None].view(np.uint8)
        return rows
