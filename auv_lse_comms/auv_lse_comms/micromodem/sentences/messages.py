"""What the sentences of the WHOI Micromodem-2 mean: from a sentence to the dataclass of its type.

`read_message` goes by an explicit table (`MESSAGES`): text from the modem never chooses what code runs in any other
way. The dataclasses are in `status_messages.py`, `transmit_messages.py`, `receive_messages.py` and `ping_messages.py`;
each can make its own sentence again.

Sources: WHOI Micromodem-2 User's Guide, and the sentences as WHOI's `acomms` and Goby3 understand them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from auv_lse_comms.micromodem.sentences.fields import SentenceError
from auv_lse_comms.micromodem.sentences.ping_messages import PingEcho, PingHeard, PingReply
from auv_lse_comms.micromodem.sentences.receive_messages import (
    Detection,
    FrameHeard,
    ReceptionStart,
    ReceptionStatistics,
)
from auv_lse_comms.micromodem.sentences.status_messages import (
    ClockSet,
    ClockTime,
    ErrorReport,
    Notice,
    Revision,
    Setting,
)
from auv_lse_comms.micromodem.sentences.transmit_messages import (
    Cycle,
    DataRequest,
    FrameTaken,
    TransmitEnd,
    TransmitStart,
    TransmitStatistics,
)
from auv_lse_comms.micromodem.sentences.wire import Sentence


class Message(Protocol):
    """What `read_message` gives: a dataclass that can also make its sentence."""

    def sentence(self) -> Sentence:
        """The sentence with this content."""
        ...


#: Every sentence the driver understands, and what reads it.
MESSAGES: dict[str, Callable[[Sequence[str]], Message]] = {
    "CAREV": Revision.read,
    "CACFG": Setting.read,
    "CATMS": ClockSet.read,
    "CATMQ": ClockTime.read,
    "CACYC": Cycle.read,
    "CADRQ": DataRequest.read,
    "CATXD": FrameTaken.read,
    "CATXP": TransmitStart.read,
    "CATXF": TransmitEnd.read,
    "CAXST": TransmitStatistics.read,
    "CARXP": ReceptionStart.read,
    "CAMFD": Detection.read,
    "CARXD": FrameHeard.read,
    "CACST": ReceptionStatistics.read,
    "CAMPC": PingEcho.read,
    "CAMPA": PingHeard.read,
    "CAMPR": PingReply.read,
    "CAMSG": Notice.read,
    "CAERR": ErrorReport.read,
}


def read_message(sentence: Sentence) -> Message | None:
    """The message in a modem's sentence, or None if the driver has no use for its type.

    Raises:
        SentenceError: if the fields do not fit the type; names the sentence, the field and its text.
    """
    reader = MESSAGES.get(sentence.type)
    if reader is None:
        return None
    try:
        return reader(sentence.fields)
    except SentenceError as error:
        raise SentenceError(f"${sentence.type}: {error}") from None
