"""Messages of recordings of earlier versions, rewritten as this version publishes them, so that they can be played.

Readers without ROS need none of this: they decode messages by the definitions in the recording. Version 0.2 put the id
of the dive into the frame of each header ("sim-1123-184534-3f2a/map"), and had fewer and other fields.
"""

import re
from typing import Any

from auv_lse_common.topics.codecs import base_frame
from auv_lse_record.message_types import frame_of, make_message

_TAGGED = re.compile(r"((?:sim|auv\d+)-\d{4}-\d{6}-[0-9a-f]{4})/(.*)")
_OWN = "auv_lse_msgs/msg/"


class Translator:
    """Translates serialized messages of one recording."""

    def __init__(self, recorded: Any, present: Any) -> None:
        """Args: recorded, present: type stores of the recording and of this version."""
        self._recorded, self._present = recorded, present

    def translated(self, kind: str, data: bytes) -> bytes:
        """A message as this version publishes it; most are returned unchanged.

        Args:
            data: The message (CDR).
        """
        if not kind.startswith(_OWN):
            if not _begins_with_header(self._recorded, kind) or not _TAGGED.fullmatch(frame_of(data)):
                return data
        elif kind not in self._present.fielddefs or self._is_same(kind):
            return data
        message = self._recorded.deserialize_cdr(data, kind)
        fields = self._fields(message, kind)
        if (header := fields.get("header")) and (found := _TAGGED.fullmatch(header["frame_id"])):
            dive, header["frame_id"] = found.groups()
            fields["dive"] = dive
        if (vehicle := re.fullmatch(r"(?:truth/)?auv(\d+)", str(fields.get("child_frame_id", "")))) is not None:
            fields["child_frame_id"] = base_frame(int(vehicle[1]))
        known = {name for name, _ in self._present.fielddefs[kind][1]}
        kept = {name: value for name, value in fields.items() if name in known}
        return bytes(self._present.serialize_cdr(make_message(self._present, kind, kept), kind))

    def _is_same(self, kind: str) -> bool:
        return bool(self._recorded.fielddefs[kind] == self._present.fielddefs[kind])

    def _fields(self, message: Any, kind: str) -> dict[str, Any]:
        """The fields of a message, also under their present names ("place_modes": "position_modes")."""
        fields = {}
        for name, _ in self._recorded.fielddefs[kind][1]:
            fields[name] = fields[name.replace("place", "position")] = _plain(self, getattr(message, name))
        return fields


def _plain(translator: Translator, value: Any) -> Any:
    if isinstance(value, list):
        return [_plain(translator, each) for each in value]
    if hasattr(value, "__msgtype__"):
        return translator._fields(value, value.__msgtype__)
    return value


def _begins_with_header(store: Any, kind: str) -> bool:
    fields: list[Any] = store.fielddefs[kind][1] if kind in store.fielddefs else []
    return bool(fields) and fields[0][0] == "header"
