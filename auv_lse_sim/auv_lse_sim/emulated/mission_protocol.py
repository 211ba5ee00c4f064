"""The vehicle's side of the mission protocol: receives an uploaded mission item by item, and returns it on request.

Requests that are not answered are repeated every `ITEM_TIMEOUT_S`, `ITEM_REPEATS` times, then the upload is cancelled.
"""

from collections.abc import Callable, Mapping

from auv_lse_mavlink.messages.wire import Message, mavlink

#: Maximum number of items of a mission.
MAX_ITEMS = 512
#: Time (s) after which a missing item is requested again, and the number of such requests.
ITEM_TIMEOUT_S = 1.0
ITEM_REPEATS = 5


class MissionProtocol:
    """One vehicle's side of the protocol.

    Attributes:
        items: Items of the last accepted mission.
    """

    def __init__(
        self,
        send: Callable[[Message], None],
        accept: Callable[[tuple[Message, ...]], int],
        *,
        asks_int: bool = True,
    ) -> None:
        """Starts without a mission.

        Args:
            accept: Called with the items of a complete upload; returns MAV_MISSION_RESULT.
            asks_int: Whether items are requested by MISSION_REQUEST_INT; else by MISSION_REQUEST.
        """
        self.items: tuple[Message, ...] = ()
        self._send, self._accept = send, accept
        self._request = (
            mavlink.MAVLink_mission_request_int_message if asks_int else mavlink.MAVLink_mission_request_message
        )
        self._incoming: list[Message] = []
        self._wanted = 0
        self._uploader = (0, 0)
        self._requested_s = 0.0
        self._repeats = 0

    def handle(self, now_s: float, message: Message, denied: bool = False) -> bool:
        """Handles a message of the protocol; returns whether it is one. `denied`: missions are refused."""
        handler = _HANDLERS.get(message.get_type())
        if handler is None:
            return False
        if denied and message.get_type() == "MISSION_COUNT":
            self._uploader = _sender(message)
            self._acknowledge(mavlink.MAV_MISSION_DENIED)
            return True
        handler(self, now_s, message)
        return True

    def poll(self, now_s: float) -> None:
        """Requests a missing item again if it is time."""
        if not self._wanted or now_s - self._requested_s < ITEM_TIMEOUT_S:
            return
        self._repeats += 1
        if self._repeats > ITEM_REPEATS:
            self._wanted = 0
            self._acknowledge(mavlink.MAV_MISSION_OPERATION_CANCELLED)
        else:
            self._ask(now_s)

    def _on_count(self, now_s: float, message: Message) -> None:
        self._uploader = _sender(message)
        if message.mission_type != mavlink.MAV_MISSION_TYPE_MISSION:
            self._acknowledge(mavlink.MAV_MISSION_UNSUPPORTED, message.mission_type)
            return
        if message.count > MAX_ITEMS:
            self._acknowledge(mavlink.MAV_MISSION_NO_SPACE)
            return
        self._incoming, self._wanted, self._repeats = [], message.count, 0
        if self._wanted == 0:
            self._finish()
        else:
            self._ask(now_s)

    def _on_item(self, now_s: float, message: Message) -> None:
        if message.mission_type != mavlink.MAV_MISSION_TYPE_MISSION:
            return
        if not self._wanted:
            if self.items and message.seq == len(self.items) - 1:
                self._acknowledge(mavlink.MAV_MISSION_ACCEPTED)  # repeated because the acknowledgement was lost
            return
        if message.seq != len(self._incoming):
            self._ask(now_s)  # repeated or out of order
            return
        self._incoming.append(message)
        self._repeats = 0
        if len(self._incoming) < self._wanted:
            self._ask(now_s)
        else:
            self._finish()

    def _finish(self) -> None:
        items, self._incoming, self._wanted = tuple(self._incoming), [], 0
        result = self._accept(items)
        if result == mavlink.MAV_MISSION_ACCEPTED:
            self.items = items
        self._acknowledge(result)

    def _on_list(self, now_s: float, message: Message) -> None:
        count = len(self.items) if message.mission_type == mavlink.MAV_MISSION_TYPE_MISSION else 0
        self._send(mavlink.MAVLink_mission_count_message(*_sender(message), count, message.mission_type))

    def _on_request(self, now_s: float, message: Message) -> None:
        if not 0 <= message.seq < len(self.items):
            return
        item = self.items[message.seq]
        fields = {name: getattr(item, name) for name in item.fieldnames}
        fields["target_system"], fields["target_component"] = _sender(message)
        self._send(mavlink.MAVLink_mission_item_int_message(**fields))

    def _on_clear(self, now_s: float, message: Message) -> None:
        self._uploader = _sender(message)
        self.items = ()
        self._accept(())
        self._acknowledge(mavlink.MAV_MISSION_ACCEPTED, message.mission_type)

    def _ask(self, now_s: float) -> None:
        self._requested_s = now_s
        self._send(self._request(*self._uploader, len(self._incoming), mavlink.MAV_MISSION_TYPE_MISSION))

    def _acknowledge(self, result: int, mission_type: int = mavlink.MAV_MISSION_TYPE_MISSION) -> None:
        self._send(mavlink.MAVLink_mission_ack_message(*self._uploader, result, mission_type))


def _sender(message: Message) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


_HANDLERS: Mapping[str, Callable[[MissionProtocol, float, Message], None]] = {
    "MISSION_COUNT": MissionProtocol._on_count,
    "MISSION_ITEM_INT": MissionProtocol._on_item,
    "MISSION_REQUEST_LIST": MissionProtocol._on_list,
    "MISSION_REQUEST_INT": MissionProtocol._on_request,
    "MISSION_CLEAR_ALL": MissionProtocol._on_clear,
}
