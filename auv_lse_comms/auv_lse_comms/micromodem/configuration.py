"""Configures a Micromodem setting by setting: each is sent once the previous one is confirmed."""

from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_comms.micromodem.clock import ClockCheck
from auv_lse_comms.micromodem.events import Problem
from auv_lse_comms.micromodem.sentences.status_messages import Setting
from auv_lse_comms.micromodem.sentences.wire import Sentence
from auv_lse_comms.micromodem.session import Session
from auv_lse_comms.micromodem.state import Cause

#: After INIT the driver waits for AUV, but at most this long, before it sends settings (s).
REBOOT_WAIT_S = 2.0


def settings_of(config: ModemConfig, address: int) -> tuple[tuple[Setting, bool], ...]:
    """The settings that the driver sends, in order, each with whether it is required.

    A modem that refuses a required setting is not used; the setting is repeated until it is accepted.
    """
    return tuple(
        (Setting(name=name, value=value), required)
        for name, value, required in (
            ("SRC", str(address), True),  # own address
            ("CST", "1", True),  # receive statistics, the end of every reception
            ("RXP", "1", False),  # report the start of a reception
            ("RXD", "1", True),  # give received frames
            ("TXP", "1", True),  # report that the transducer is on
            ("TXF", "1", True),  # report that it is off: the packet is sent
            ("REV", "1", False),  # report the revision every few minutes
            ("XST", "1", False),  # transmit statistics
            ("MFD", "1", False),  # report detections of the matched filter
            ("ASD", "0", False),  # never send test data of its own when the host is late
            ("SNV", str(int(config.synchronous)), False),  # start transmissions on the second
            *((name, str(value), False) for name, value in config.settings.items()),
        )
    )


class Configuration:
    """Sends one modem its settings; after the last one the clock check begins.

    A modem reports its firmware when it starts. If it was on already, it is restarted once after its address is set.

    Attributes:
        rebooting: Whether the modem is about to restart, or has reported INIT and not yet AUV: settings wait.
    """

    def __init__(self, session: Session, clock: ClockCheck) -> None:
        """Prepares the settings; writes to `session` and begins `clock` when the modem is configured."""
        self.rebooting = False
        self._session = session
        self._clock = clock
        self._settings = settings_of(session.config, session.address)
        self._number = 0
        self._tries = 0
        self._restarted = False

    def begin(self) -> None:
        """Sends the first setting, at once or when the modem has rebooted."""
        self._number = 0
        self._tries = 0
        self._clock.reset()
        if self.rebooting:
            self._session.start("reboot")
        else:
            self.write()

    def write(self) -> None:
        """Sends the current setting."""
        self._session.write(self._settings[self._number][0].command())
        self._session.start("setting")

    def answer(self, message: Setting) -> None:
        """Handles the modem's answer to a setting."""
        setting, _ = self._settings[self._number]
        if message.name != setting.name:
            return
        if message.value == setting.value:
            self._next()
        else:
            self.refuse(f"it answered {message.value!r}")

    def refuse(self, why: str) -> None:
        """The modem refuses the current setting: tries again if it is required, else continues without it."""
        session = self._session
        setting, required = self._settings[self._number]
        self._tries += 1
        if self._tries <= session.config.retries and required:
            self.write()
            return
        session.counts["settings_refused"] += 1
        session.report(Problem(text=f"the modem refused {setting.name},{setting.value}: {why}"))
        if not required:
            self._next()
            return
        session.start("setting")  # repeated when this wait is over
        self._tries = 0

    def poll(self) -> None:
        """Repeats a setting that was not answered."""
        session = self._session
        if self.rebooting:
            if session.waited_s("reboot") >= REBOOT_WAIT_S:
                self.rebooting = False
                self.write()
        elif session.waited_s("setting") >= session.config.reply_timeout_s:
            session.strike()
            self.write()

    def _restart_once(self) -> bool:
        """Restarts a modem that has not reported its firmware; returns whether settings must wait for that."""
        session = self._session
        if session.version or self._restarted:
            return False
        self._restarted = self.rebooting = True
        session.counts["restarts"] += 1
        session.write(Sentence("CCMSC", (str(session.address), str(session.address), "0")))
        session.start("reboot")
        return True

    def _next(self) -> None:
        self._number += 1
        self._tries = 0
        if self._number < len(self._settings):
            if not self._restart_once():
                self.write()
            return
        self._session.move(Cause.CONFIGURED)
        self._session.counts["configured"] += 1
        self._clock.ask(new=True)
