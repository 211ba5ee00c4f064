"""From a sentence of the WHOI Micromodem-2 to the message of its type.

`read_message` uses an explicit table (`MESSAGES`): text from the modem selects code in no other way. The messages are
in `status_messages.py`, `transmit_messages.py`, `receive_messages.py` and `ping_messages.py`.

Sources: WHOI Micromodem-2 User's Guide, and the sentences as WHOI's `acomms` and Goby3 implement them.
"""

from auv_lse_comms.micromodem.sentences import ping_messages as ping
from auv_lse_comms.micromodem.sentences import receive_messages as rx
from auv_lse_comms.micromodem.sentences import status_messages as status
from auv_lse_comms.micromodem.sentences import transmit_messages as tx
from auv_lse_comms.micromodem.sentences.fields import SentenceError
from auv_lse_comms.micromodem.sentences.layout import Message
from auv_lse_comms.micromodem.sentences.wire import Sentence

_UNDERSTOOD: tuple[type[Message], ...] = (
    status.Revision, status.Setting, status.ClockSet, status.ClockTime, status.Notice, status.ErrorReport,
    tx.Cycle, tx.DataRequest, tx.FrameTaken, tx.TransmitStart, tx.TransmitEnd, tx.TransmitStatistics,
    rx.ReceptionStart, rx.Detection, rx.FrameHeard, rx.ReceptionStatistics,
    ping.PingEcho, ping.PingHeard, ping.PingReply,
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
