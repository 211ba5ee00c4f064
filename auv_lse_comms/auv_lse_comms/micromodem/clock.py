"""Checks a Micromodem's clock against the host's, and sets it when it is off.

step      what happens                          next
REST      `clock_period_s` is over, when idle   ASKED     $CCTMQ written
ASKED     $CATMQ: right, or must not be set     REST
ASKED     $CATMQ: off                           WAITING   until the host's next second begins
WAITING   a second begins                       SETTING   $CCTMS written (it carries whole seconds)
SETTING   $CATMS                                ASKED     $CCTMQ written, to check the result
ASKED, SETTING
          no answer, `CLOCK_TRIES` times        REST      reported
"""

import enum
import math

from auv_lse_comms.micromodem.events import ClockChecked, ModemReady, Problem
from auv_lse_comms.micromodem.sentences.fields import iso_time
from auv_lse_comms.micromodem.sentences.status_messages import ClockSet, ClockTime
from auv_lse_comms.micromodem.sentences.wire import Sentence
from auv_lse_comms.micromodem.session import Session
from auv_lse_comms.micromodem.state import Cause, State

#: $CCTMS carries whole seconds: it is written within this time after a second begins (s).
SECOND_START_S = 0.1
#: If the driver is polled too rarely for that, $CCTMS is written after this wait (s).
SECOND_WAIT_S = 3.0
#: Attempts at setting the clock before the driver reports the failure and leaves the clock unchanged.
CLOCK_TRIES = 3


def clock_offset_s(message: ClockTime, now_s: float) -> float:
    """The modem's clock minus the host's (s), read at `now_s`; 0 within the reading's resolution."""
    early_s = message.utc_s - now_s
    late_s = now_s - (message.utc_s + message.resolution_s)
    return early_s if early_s > 0.0 else -late_s if late_s > 0.0 else 0.0


class ClockStep(enum.Enum):
    """Step of a clock check."""

    REST = "rest"
    ASKED = "asked"
    WAITING = "waiting"
    SETTING = "setting"


class ClockCheck:
    """The checks of one modem's clock: the first one in state CLOCK, later ones independent of the state.

    Attributes:
        step: Step of the current check.
        right: Whether the clock was within `clock_tolerance_s` of the host's at the last check.
    """

    def __init__(self, session: Session) -> None:
        """Starts without a check; writes to `session`."""
        self.step = ClockStep.REST
        self.right = False
        self._session = session
        self._tries = 0

    def reset(self) -> None:
        """Discards the result: the connection or the modem is new."""
        self.step = ClockStep.REST
        self.right = False

    def ask(self, new: bool) -> None:
        """Asks the modem for its time; `new` begins a check, otherwise the current one is repeated."""
        if new:
            self._tries = 0
        self.step = ClockStep.ASKED
        self._session.start("clock")
        self._session.start("clock_period")
        self._session.write(Sentence("CCTMQ", ("0",)))

    def end(self) -> None:
        """Ends the check, whatever its result; after the first one packets can be sent."""
        session = self._session
        self.step = ClockStep.REST
        session.start("clock_period")
        if session.state is State.CLOCK:
            session.move(Cause.CLOCKED)
            session.report(ModemReady(version=session.version))

    def poll(self) -> None:
        """Begins a check if one is due, sets the clock on the second, repeats unanswered queries."""
        session = self._session
        if self.step is ClockStep.REST:
            if session.state is State.IDLE and session.waited_s("clock_period") >= session.config.clock_period_s:
                session.write(Sentence("CCCFQ", ("SRC",)))  # another address reveals a reboot that was missed
                self.ask(new=True)
        elif self.step is ClockStep.WAITING:
            fraction_s = session.now_s - math.floor(session.now_s)
            if fraction_s <= SECOND_START_S or session.waited_s("clock") >= SECOND_WAIT_S:
                self.step = ClockStep.SETTING
                session.start("clock")
                session.write(Sentence("CCTMS", self._time_to_set()))
        elif session.waited_s("clock") >= session.config.reply_timeout_s:
            session.strike()
            self._tries += 1
            if self._tries < CLOCK_TRIES:
                self.ask(new=False)
            else:
                session.report(Problem(text="the modem does not answer queries about its clock"))
                self.end()

    def _time_to_set(self) -> tuple[str, str]:
        """Time and mode of $CCTMS: this second, to be set at once, or the next one, to be set at the PPS edge."""
        second_s = round(self._session.now_s)
        return (iso_time(second_s + 1), "1") if self._session.config.synchronous else (iso_time(second_s), "0")

    def on_time(self, message: ClockTime) -> None:
        """Compares the modem's time with the host's."""
        if self.step is not ClockStep.ASKED:
            return
        session, config = self._session, self._session.config
        offset_s = clock_offset_s(message, session.now_s)
        self.right = abs(offset_s) <= config.clock_tolerance_s
        session.report(
            ClockChecked(offset_s=offset_s, within_tolerance=self.right, source=message.source, pps=message.pps)
        )
        self._tries += 1
        # an arrival time counts as synchronous only if the clock was set by the host, however right it is
        unset = config.synchronous and message.source in ("NONE", "RTC")
        if (self.right and not unset) or not config.set_clock or self._tries > CLOCK_TRIES:
            if not self.right:
                session.counts["clock_off"] += 1
                session.report(Problem(text=f"the modem's clock is {offset_s:+z.1f} s off the host's"))
            self.end()
        else:
            self.step = ClockStep.WAITING
            session.start("clock")
            self.poll()

    def on_set(self, message: ClockSet) -> None:
        """The modem has set its clock: checks it again."""
        if self.step is not ClockStep.SETTING:
            return
        self._session.counts["clock_timed_out" if message.timed_out else "clock_set"] += 1
        self.ask(new=False)

    def on_refused(self) -> None:
        """The modem has refused a command, which may have been a clock command."""
        if self.step in (ClockStep.ASKED, ClockStep.SETTING):
            self.end()
