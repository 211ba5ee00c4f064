"""A driver for the WHOI Micromodem-2 that can be used alone.

Theory of operation
-------------------
`Micromodem` is the driver. It opens no port and reads no clock: its owner gives it bytes and times and takes bytes and
events from it (docs/reference/python/modem.md). `state.py` has its states and the table of their transitions.

    bytes     sentences/wire.py   lines to sentences, and back; damaged lines are counted
    sentences sentences/          to messages, and back (fields.py, layout.py, *_messages.py, messages.py)
    messages  driver.py           passes each to the part that handles it: configuration.py, clock.py, sending.py,
                                  pinging.py, receiving.py; they share a session.py
    events    events.py           what the driver reports to its owner

`ModemPort` (port.py) joins a driver to a serial or TCP port and a line log; `replay_log` (log.py) feeds such a log to a
new driver. `modem_check.py` asks a modem for its settings and clock before the dive. `micromodem_node.py` is the ROS 2
node around a `ModemPort`.

Except for the node, everything here imports only the standard library, `auv_lse_common` and, in port.py,
`auv_lse_comms.transport`: no NumPy, no packet, no mission. An import contract enforces this.
"""

from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_comms.micromodem.driver import Micromodem
from auv_lse_comms.micromodem.events import (
    ClockChecked,
    Event,
    ModemLost,
    ModemReady,
    PacketReceived,
    PingAnswered,
    PingFailed,
    PingStarted,
    Problem,
    ReceptionFailed,
    TransmitDone,
    TransmitFailed,
    TransmitStarted,
)
from auv_lse_comms.micromodem.log import LogEntry, format_entry, read_entries, replay_log
from auv_lse_comms.micromodem.port import ModemPort
from auv_lse_comms.micromodem.sentences.wire import Sentence, SentenceReader
from auv_lse_comms.micromodem.state import State

__all__ = [
    "ClockChecked",
    "Event",
    "LogEntry",
    "Micromodem",
    "ModemConfig",
    "ModemLost",
    "ModemPort",
    "ModemReady",
    "PacketReceived",
    "PingAnswered",
    "PingFailed",
    "PingStarted",
    "Problem",
    "ReceptionFailed",
    "Sentence",
    "SentenceReader",
    "State",
    "TransmitDone",
    "TransmitFailed",
    "TransmitStarted",
    "format_entry",
    "read_entries",
    "replay_log",
]
