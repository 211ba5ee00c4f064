"""From a sentence of the WHOI Micromodem-2 to the message of its type.

`read_message` uses an explicit table (`MESSAGES`): text from the modem selects code in no other way. The messages are
in `status_messages.py`, `transmit_messages.py`, `receive_messages.py` and `ping_messages.py`.

Sources: WHOI Micromodem-2 User's Guide, and the sentences as WHOI's `acomms` and Goby3 implement them.
"""

from __future__ import annotations

from auv_lse_comms.micromodem.sentences.fields import SentenceError
from auv_lse_comms.micromodem.sentences.layout import Message
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

_UNDERSTOOD: tuple[type[Message], ...] = (
    Revision, Setting, ClockSet, ClockTime, Cycle, DataRequest, FrameTaken, TransmitStart, TransmitEnd,
    TransmitStatistics, ReceptionStart, Detection, FrameHeard, ReceptionStatistics, PingEcho, PingHeard, PingReply,
    Notice, ErrorReport,
)  # fmt: skip

#: Every message that the driver understands, by its sentence's type.
MESSAGES: dict[str, type[Message]] = {message.TYPE: message for message in _UNDERSTOOD}


def read_message(sentence: Sentence) -> Message | None:
    """The message in a modem's sentence, or None if the driver does not use that type.

    Raises:
        SentenceError: if the fields do not fit the type; names the sentence, the field and its text.
    """
    message = MESSAGES.get(sentence.type)
    if message is None:
        return None
    try:
        return message.read(sentence.fields)
    except SentenceError as error:
        raise SentenceError(f"${sentence.type}: {error}") from None
