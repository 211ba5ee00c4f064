"""Measures the distance to one other modem with a two-way ping, which needs no synchronized clocks.

    host                    modem
    $CCMPC,src,dest         $CAMPC (accepted)  ~ mini-packet ~>  the other modem answers after a fixed time
                            $CAMPR (answered, with the one-way travel time)

A ping begins only if the modem is idle and no packet waits; packets requested during a ping wait. Every ping ends with
one `PingAnswered` or `PingFailed`.
"""

import math

from auv_lse_common.vocabulary.modem_rates import MINI_PACKET_S
from auv_lse_comms.micromodem.events import PingAnswered, PingFailed, PingStarted
from auv_lse_comms.micromodem.sentences.ping_messages import PingEcho, PingHeard, PingReply
from auv_lse_comms.micromodem.session import Session
from auv_lse_comms.micromodem.state import Cause, State

#: Longest wait for an answer (s): 3 km there and back, two mini-packets, and the other modem's turn-around.
ANSWER_TIMEOUT_S = 7.0


class Pinging:
    """The ping in progress at one modem, if there is one."""

    def __init__(self, session: Session) -> None:
        """Starts without a ping; writes to `session`."""
        self._session = session
        self._number = 0
        self._destination = 0
        self._taken = False

    def ask(self, destination: int, free: bool) -> int:
        """Pings another modem; returns the ping's number, which the events about it carry; `free`: no packet waits.

        Raises:
            ValueError: if it is not another modem's address.
        """
        session = self._session
        if not 1 <= destination <= 127 or destination == session.address:
            raise ValueError(f"ping: modem {destination} cannot be pinged; choose another modem, 1 to 127")
        number = session.next_number()
        session.counts["pings"] += 1
        if session.state is not State.IDLE or not free:
            self._report_failure(number, f"busy: modem {session.state.value}")
            return number
        self._number, self._destination, self._taken = number, destination, False
        session.move(Cause.PING)
        session.start("ping")
        session.write(PingEcho(source=session.address, destination=destination).command())
        return number

    def poll(self) -> None:
        """Aborts a ping that was not answered in time."""
        if self._session.state is State.PINGING and self._session.waited_s("ping") >= ANSWER_TIMEOUT_S:
            if not self._taken:
                self._session.strike()
            self.abort(f"no answer from modem {self._destination}")

    def fail(self, reason: str) -> None:
        """Reports the ping in progress, if there is one, as failed; the state does not change."""
        if self._session.state is State.PINGING:
            self._report_failure(self._number, reason)

    def abort(self, reason: str) -> None:
        """Reports the ping in progress, if there is one, as failed; the modem is idle again."""
        if self._session.state is State.PINGING:
            self.fail(reason)
            self._session.move(Cause.FAILED)

    def _report_failure(self, number: int, reason: str) -> None:
        self._session.counts["pings_failed"] += 1
        self._session.report(PingFailed(number=number, reason=reason))

    # ------------------------------------------------------------------ the modem's sentences

    def on_echo(self, message: PingEcho) -> None:
        """The modem pings."""
        if self._session.state is State.PINGING and message.source == self._session.address and not self._taken:
            self._taken = True
            self._session.report(PingStarted(number=self._number))

    def on_heard(self, message: PingHeard) -> None:
        """Counts a ping from another modem; this modem answers it without the host."""
        self._session.counts["pings_heard"] += 1

    def on_reply(self, message: PingReply) -> None:
        """The other modem has answered."""
        session = self._session
        if session.state is not State.PINGING or message.source != self._destination:
            session.counts["unasked_ping_replies"] += 1
            return
        if math.isnan(message.travel_s):
            self.abort(f"the modem reported no travel time to modem {message.source}")
            return
        # half-way between the start of the ping and the start of the answer
        half_s = 0.5 * max(session.waited_s("ping") - MINI_PACKET_S, 0.0)
        session.move(Cause.FINISHED)
        session.counts["pings_answered"] += 1
        session.report(
            PingAnswered(
                number=self._number,
                source=message.source,
                travel_s=message.travel_s,
                utc_s=session.now_s - MINI_PACKET_S - half_s,
            )
        )
