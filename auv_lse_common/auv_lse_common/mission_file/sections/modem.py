"""Section `modem` of the parameter file: how a vehicle reaches its acoustic modem, and how it drives it."""

from __future__ import annotations

import re
from dataclasses import dataclass

from auv_lse_common.mission_file.parameters import ParameterError, parameter
from auv_lse_common.vocabulary.modem_rates import packet_duration_s

#: What the packet takes on the wire (docs/reference/packet.md); every transmission carries exactly one packet.
PAYLOAD_BYTES = 252
#: What the driver's reports may take on their way (s).
_SPARE_S = 1.0
#: What a modem at 19200 Bd needs of a packet before it can start to send it (s): 560 characters and their answers.
HANDSHAKE_S = 0.4
#: Settings of the modem that are the driver's own (`configuration.py`): another value would stop it.
DRIVERS_OWN = ("SRC", "CST", "RXP", "RXD", "TXP", "TXF", "REV", "XST", "MFD", "ASD", "SNV")


@dataclass(frozen=True, slots=True, kw_only=True)
class ModemConfig:
    """How `micromodem_node` reaches and drives a WHOI Micromodem-2; the modem's address is the vehicle's number."""

    kind: str = parameter(
        "direct",
        choices=("direct", "micromodem"),
        help="direct: the simulator carries modem/tx and modem/rx; micromodem: micromodem_node drives a modem",
    )
    port: str = parameter(
        "", help="where the modem is: a serial device ('/dev/ttyUSB0'), or 'tcp://HOST:PORT'; needed by micromodem"
    )
    baud: int = parameter(19200, unit="Bd", low=1200, high=921600, help="serial speed, 8N1, no flow control")
    rate: int = parameter(
        4, low=3, high=5, help="packet rate; 0 to 2 cannot hold a 252-byte packet (docs/reference/hardware.md)"
    )
    destination: int = parameter(0, low=0, high=127, help="modem address that packets to all (0) are sent to; 0: all")
    set_clock: bool = parameter(
        True, help="set the modem's clock when it is further off than clock_tolerance_s; false: only report it"
    )
    synchronous: bool = parameter(
        False,
        help="transmissions start on the second (SNV,1), clocks held by a PPS: travel time is then reported",
    )
    ping: bool = parameter(
        False,
        help="in what is left of each own slot ping one team mate in turn: ranges where clocks are not synchronized",
    )
    clock_tolerance_s: float = parameter(
        0.5, unit="s", above=0.0, high=60.0, help="largest accepted difference between modem clock and host clock"
    )
    clock_period_s: float = parameter(
        10.0, unit="s", low=1.0, help="time between clock checks, which also prove that the modem is alive"
    )
    reply_timeout_s: float = parameter(
        2.0, unit="s", above=0.0, help="longest wait for the modem's answer to a command, before it is repeated"
    )
    retries: int = parameter(
        3, low=0, high=100, help="how often an unanswered command is repeated before the connection is made anew"
    )
    start_timeout_s: float = parameter(
        2.0,
        unit="s",
        above=0.0,
        help="a packet whose transmission has not begun this long after it was asked for is dropped: its slot is over",
    )
    transmit_timeout_s: float = parameter(
        8.0, unit="s", above=0.0, help="longest wait for the end of a transmission after its start"
    )
    receive_timeout_s: float = parameter(
        10.0, unit="s", above=0.0, help="a reception without its statistics is closed this long after its last sentence"
    )
    backoff_min_s: float = parameter(0.2, unit="s", above=0.0, help="first wait before the port is opened again")
    backoff_max_s: float = parameter(10.0, unit="s", above=0.0, help="longest wait: doubled at every failure up to it")
    settings: dict[str, int] = parameter(
        {}, help="further settings of the modem (NVRAM) by name, such as BND: 0; each is sent and its answer checked"
    )
    log_file: str = parameter("", help="line log of all that goes over the port, which can be replayed; '': none")

    @property
    def send_duration_s(self) -> float:
        """Longest time (s) from handing a packet to the modem until it is sent: a late start, and the rate's length."""
        return round(self.start_timeout_s + packet_duration_s(self.rate, PAYLOAD_BYTES), 2)

    @property
    def confirm_s(self) -> float:
        """Time (s) after which a packet's transmission has ended or failed, however it went."""
        return self.start_timeout_s + self.transmit_timeout_s + _SPARE_S

    def __post_init__(self) -> None:
        """Refuses combinations that cannot work.

        Raises:
            ParameterError: naming the keys and values.
        """
        if self.kind == "micromodem" and not self.port:
            raise ParameterError("port: got '' with kind 'micromodem'; expected a serial device or 'tcp://HOST:PORT'")
        if self.ping and self.synchronous:
            raise ParameterError(
                "ping: got true with synchronous true; expected one of them: with synchronized clocks each packet "
                "already gives a range"
            )
        if self.backoff_max_s < self.backoff_min_s:
            raise ParameterError(
                f"backoff_max_s: got {self.backoff_max_s:g}; expected at least backoff_min_s = {self.backoff_min_s:g} s"
            )
        for name, value in self.settings.items():
            if name in DRIVERS_OWN:
                raise ParameterError(
                    f"settings.{name}: got {value}; the driver sets {', '.join(DRIVERS_OWN)} itself; fix: leave it out"
                )
            if not re.fullmatch(r"[A-Za-z0-9_.]+", name):
                raise ParameterError(f"settings: got the name {name!r}; expected letters, digits, '_' and '.'")
