"""The types of recorded messages (rosbags), and messages made from the fields that the topic table encodes."""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

#: NumPy names of basic types, where they differ from those of ROS.
_DTYPES = {"octet": "uint8", "byte": "uint8", "char": "uint8"}


def message_folder() -> Path | None:
    """The folder with this project's `.msg` files (source tree or installed workspace); None if missing."""
    installed = (p for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p)
    folders = [
        Path(__file__).resolve().parents[2] / "auv_lse_msgs",
        *(Path(p) / "share" / "auv_lse_msgs" for p in installed),
    ]
    return next((folder / "msg" for folder in folders if (folder / "msg" / "Plan.msg").is_file()), None)


def definitions(folders: Sequence[Path], package: str = "") -> dict[str, str]:
    """The text of every `.msg` file in folders (each ".../share/PACKAGE/msg"), by message type."""
    files = (path for folder in folders for path in sorted(folder.glob("*.msg")))
    return {f"{package or path.parent.parent.name}/msg/{path.stem}": path.read_text() for path in files}


def types_of(texts: Mapping[str, str]) -> Any:
    """The type store of ROS 2 Jazzy with the messages of `texts` added, except those that ROS has.

    Raises:
        ImportError: if rosbags is not installed.
    """
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for name, text in texts.items():
        if name not in store.fielddefs:
            types.update(get_types_from_msg(text, name))
    store.register(types)
    return store


def project_types() -> Any:
    """The types of ROS 2 Jazzy, and this project's if their definitions are found."""
    folder = message_folder()
    return types_of({} if folder is None else definitions([folder], "auv_lse_msgs"))


def stamp_of(data: bytes) -> float:
    """The stamp (s) in the header with which a serialized message begins (CDR)."""
    order: Literal["little", "big"] = "little" if data[1:2] == b"\1" else "big"
    return int.from_bytes(data[4:8], order, signed=True) + 1e-9 * int.from_bytes(data[8:12], order)


def frame_of(data: bytes) -> str:
    """The frame in the header with which a serialized message begins (CDR); "" if it is too short."""
    return _text(data, 12)[0]


def dive_in(data: bytes) -> str:
    """The id of the dive in a serialized message of the project, after its header; "" if it is too short."""
    _, end = _text(data, 12)
    return _text(data, end)[0]


def _text(data: bytes, start: int) -> tuple[str, int]:
    """A string of a serialized message (CDR), and where the next one begins."""
    size = int.from_bytes(data[start : start + 4], "little" if data[1:2] == b"\1" else "big")
    end = start + 4 + size
    return data[start + 4 : end].rstrip(b"\0").decode(errors="replace"), end + -end % 4


def make_message(store: Any, kind: str, fields: Mapping[str, Any]) -> Any:
    """A recorded message of a type; fields missing in `fields` are zero, false or empty.

    Raises:
        ValueError: if the type lacks one of the fields.
    """
    from rosbags.interfaces import Nodetype

    _, declared = store.fielddefs[kind]
    if unknown := set(fields) - {name for name, _ in declared}:
        raise ValueError(
            f"{kind} has no field {', '.join(sorted(unknown))}; its fields are {', '.join(n for n, _ in declared)}"
        )
    values: dict[str, Any] = {}
    for name, (node, about) in declared:
        value = fields.get(name)
        if node == Nodetype.NAME:
            values[name] = make_message(store, about, value or {})
        elif node == Nodetype.BASE:
            values[name] = value if value is not None else {"string": "", "bool": False}.get(about[0], 0)
        else:  # an array, or a sequence
            (inner, inner_about), length = about
            if inner == Nodetype.NAME:
                values[name] = [make_message(store, inner_about, each) for each in value or ()]
            elif inner_about[0] == "string":
                values[name] = list(value or ())
            else:
                count = length if node == Nodetype.ARRAY else 0
                values[name] = _array(value, count).astype(_DTYPES.get(inner_about[0], inner_about[0]))
    return store.types[kind](**values)


def _array(value: Iterable[Any] | None, count: int) -> Any:
    if value is None:
        return np.zeros(count)
    return np.frombuffer(value, dtype=np.uint8) if isinstance(value, bytes) else np.asarray(value)
