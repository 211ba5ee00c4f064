"""The parameter protocol, as the vehicle. A name that it does not know is not answered."""

from collections.abc import Callable

from auv_lse_mavlink.messages.wire import Message, mavlink
from auv_lse_sim.emulated.ardupilot.parameters import Parameters

#: Index of a value that is sent by name, or unasked.
NO_INDEX = 65535


class ParameterProtocol:
    """One autopilot's side of the protocol."""

    def __init__(self, parameters: Parameters, send: Callable[[Message], None]) -> None:
        """Answers with `send` from `parameters`."""
        self._parameters, self._send = parameters, send

    def handle(self, message: Message) -> bool:
        """Handles a message of the protocol; returns whether it is one."""
        kind = message.get_type()
        if kind == "PARAM_REQUEST_READ":
            names = self._parameters.names
            by_index = 0 <= message.param_index < len(names)
            self.send_value(names[message.param_index] if by_index else message.param_id, by_index)
        elif kind == "PARAM_REQUEST_LIST":
            for name in self._parameters.names:
                self.send_value(name, by_index=True)
        elif kind == "PARAM_SET":
            self._parameters.change(message.param_id, message.param_value)
            self.send_value(message.param_id)
        else:
            return False
        return True

    def send_value(self, name: str, by_index: bool = False) -> None:
        """Sends the parameter with this name on the wire, if there is one."""
        found = self._parameters.on_wire(name)
        if found is not None:
            index = found.index if by_index else NO_INDEX
            fields = found.name.encode(), found.value, found.kind, len(self._parameters), index
            self._send(mavlink.MAVLink_param_value_message(*fields))
