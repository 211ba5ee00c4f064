"""Section `modem`: connection to the acoustic modem, and its operation."""

import re

from auv_lse_common.mission_file.parameters import ParameterError, configuration, parameter
from auv_lse_common.mission_file.port_address import check_address
from auv_lse_common.vocabulary.modem_rates import packet_duration_s

#: Size of a packet (docs/reference/packet.md); every transmission carries exactly one packet.
PAYLOAD_BYTES = 252
#: Margin (s) for the delay of the driver's reports.
_SPARE_S = 1.0
#: Time (s) to hand a packet to a modem at 19200 Bd: 560 characters and the replies.
HANDSHAKE_S = 0.4
#: Modem settings that the driver sets itself (`configuration.py`).
DRIVERS_OWN = ("SRC", "CST", "RXP", "RXD", "TXP", "TXF", "REV", "XST", "MFD", "ASD", "SNV")


@configuration
class ModemConfig:
    """WHOI Micromodem-2, driven by `micromodem_node`; its address is the vehicle's number."""

    kind: str = parameter(
        "direct",
        choices=("direct", "micromodem"),
        help="direct: the simulator carries modem/tx and modem/rx; micromodem: micromodem_node drives a modem",
    )
    port: str = parameter(
        "", help="serial device ('/dev/ttyUSB0') or 'tcp://HOST:PORT' of the modem; required by micromodem"
    )
    baud: int = parameter(19200, unit="Bd", low=1200, high=921600, help="serial speed, 8N1, no flow control")
    rate: int = parameter(
        4,
        low=3,
        high=5,
        help="Micromodem packet rate; 0 to 2 cannot hold a 252-byte packet (docs/reference/hardware.md)",
    )
    destination: int = parameter(0, low=0, high=127, help="modem address that broadcast packets are sent to; 0: all")
    set_clock: bool = parameter(
        True, help="set the modem's clock when its error exceeds clock_tolerance_s; false: only report the error"
    )
    synchronous: bool = parameter(
        False,
        help="start transmissions on the second (SNV,1), with clocks synchronized by a PPS; each packet then "
        "measures a range",
    )
    ping: bool = parameter(
        False,
        help="ping one team mate in the rest of each own slot, in turn: ranges without synchronized clocks",
    )
    clock_tolerance_s: float = parameter(
        0.5, unit="s", above=0.0, high=60.0, help="largest accepted difference between the clocks of modem and host"
    )
    clock_period_s: float = parameter(
        10.0, unit="s", low=1.0, high=3600.0, help="time between clock checks, which also show that the modem is alive"
    )
    reply_timeout_s: float = parameter(
        2.0,
        unit="s",
        above=0.0,
        high=600.0,
        help="longest wait for the modem's reply to a command, before it is repeated",
    )
    retries: int = parameter(
        3, low=0, high=100, help="repetitions of an unanswered command before the connection is reopened"
    )
    start_timeout_s: float = parameter(
        2.0,
        unit="s",
        above=0.0,
        high=600.0,
        help="a packet whose transmission has not started after this time is dropped: its slot is over",
    )
    transmit_timeout_s: float = parameter(
        8.0, unit="s", above=0.0, high=600.0, help="longest duration of a transmission"
    )
    receive_timeout_s: float = parameter(
        10.0,
        unit="s",
        above=0.0,
        high=600.0,
        help="a reception without statistics is closed this long after its last sentence",
    )
    backoff_min_s: float = parameter(
        0.2, unit="s", above=0.0, high=3600.0, help="first wait before the port is reopened"
    )
    backoff_max_s: float = parameter(
        10.0, unit="s", above=0.0, high=3600.0, help="longest wait; each failure doubles the wait up to it"
    )
    settings: dict[str, int] = parameter(
        {}, help="further modem settings (NVRAM) by name, such as BND: 0; each is sent and its reply checked"
    )
    log_file: str = parameter("", help="log of every line on the port, which can be replayed; empty: none")

    @property
    def send_duration_s(self) -> float:
        """Longest time (s) from handing a packet to the modem to the end of its transmission."""
        return round(self.start_timeout_s + packet_duration_s(self.rate, PAYLOAD_BYTES), 2)

    @property
    def confirm_s(self) -> float:
        """Time (s) after which a transmission has succeeded or failed."""
        return self.start_timeout_s + self.transmit_timeout_s + _SPARE_S

    def __post_init__(self) -> None:
        """Rejects combinations that cannot work.

        Raises:
            ParameterError: naming the keys and values.
        """
        if self.kind == "micromodem" and not self.port:
            raise ParameterError("port is empty, but kind 'micromodem' needs a serial device or 'tcp://HOST:PORT'")
        if self.kind == "micromodem":
            check_address("port", self.port)
        if self.ping and self.synchronous:
            raise ParameterError(
                "ping and synchronous are both true; choose one. With synchronized clocks every packet already "
                "gives a range"
            )
        if self.backoff_max_s < self.backoff_min_s:
            raise ParameterError(
                f"backoff_max_s is {self.backoff_max_s:g} s, but must be at least backoff_min_s "
                f"({self.backoff_min_s:g} s)"
            )
        for name, value in self.settings.items():
            if name in DRIVERS_OWN:
                raise ParameterError(
                    f"settings.{name} is {value}, but the driver sets {', '.join(DRIVERS_OWN)} itself. Remove it"
                )
            if not re.fullmatch(r"[A-Za-z0-9_.]+", name):
                raise ParameterError(f"settings: {name!r} is not a setting's name; use letters, digits, '_' and '.'")
