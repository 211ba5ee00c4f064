"""An emulated WHOI Micromodem-2: the modem's side of the sentences, connected to a simulated channel.

`ModemEmulator` takes and returns bytes. It sends packets into the simulated water through the callable `transmit`, and
receives them through `arrive`. `host_interface.py` holds settings, clock and output, `modem_transmitter.py` the packet
being sent, `host_ports.py` the ports, `modem_rack.py` one modem per vehicle.

The caller supplies the time: simulated time in a mission. The modem answers at once at any simulation speed;
transmissions and the wait for data end in `poll`. Not modelled: the speed of the serial line (a 252-byte frame takes
0.28 s each way at 19200 Bd), acknowledgements, and mini-packets other than those of pings.

Settings start with factory values: address 0, no statistics. A driver that does not configure the modem gets neither
packets nor `$CACST`.
"""

import math
from collections.abc import Callable

from auv_lse_common.vocabulary.modem_rates import BROADCAST, RATES
from auv_lse_comms.micromodem.sentences.fields import SentenceError
from auv_lse_comms.micromodem.sentences.ping_messages import PingEcho
from auv_lse_comms.micromodem.sentences.receive_messages import (
    MODE_BAD_CRC,
    MODE_GOOD,
    Detection,
    FrameHeard,
    ReceptionStart,
    ReceptionStatistics,
)
from auv_lse_comms.micromodem.sentences.status_messages import Notice, Revision
from auv_lse_comms.micromodem.sentences.transmit_messages import Cycle
from auv_lse_comms.micromodem.sentences.wire import Sentence, SentenceReader
from auv_lse_sim.emulated.host_interface import HostInterface
from auv_lse_sim.emulated.modem_packets import HeardPacket, Transmission
from auv_lse_sim.emulated.modem_transmitter import Transmitter
from auv_lse_sim.emulated.pings import MiniPacket, Pings

VERSION = "2.0.27087"
#: With REV on, the modem sends its revision with this period (s).
REVISION_PERIOD_S = 120.0


class ModemEmulator:
    """One emulated modem.

    Attributes:
        settings: Its settings by name, as text.
        counts: Events: "transmitted", "heard", "heard_bad", "mini_packets", "data_timeouts", "refused", "boots".
    """

    def __init__(
        self,
        transmit: Callable[[Transmission], float | None],
        *,
        clock_error_s: float = 0.0,
        pps: bool = True,
    ) -> None:
        """Creates a modem without power; `boot` starts it.

        Args:
            transmit: Sends a packet into the water; returns its duration (s), or None for the nominal one.
            clock_error_s: The modem's clock minus the simulation's clock (s), until it is set.
            pps: Whether a PPS is connected; it is used with SNV on.
        """
        self._host = HostInterface(clock_error_s, pps)
        self.settings, self.counts = self._host.settings, self._host.counts
        self._transmit = transmit
        self._transmitter = Transmitter(self._host, transmit)
        self._pings = Pings(lambda: self.address, self._host.write, self._transmit_mini)
        self._reader = SentenceReader()
        self._bad_lines = 0
        self._revision_s = -math.inf
        self._commands: dict[str, Callable[[float, Sentence], None]] = {
            "CCCFG": self._host.set_value,
            "CCCFQ": self._host.query_value,
            "CCTMS": self._host.set_clock,
            "CCTMQ": self._host.query_clock,
            "CCCYC": self._transmitter.start_cycle,
            "CCTXD": self._transmitter.take_frame,
            "CCMPC": self._on_ping,
            "CCMSC": self._on_sleep,
        }

    @property
    def address(self) -> int:
        """This modem's address, 0 until it is set."""
        return self._host.address

    def boot(self, now_s: float, forget: bool = False) -> None:
        """Starts or restarts the modem; drops what it was sending, with `forget` also the settings and the clock."""
        self.counts["boots"] += 1
        self._transmitter.reset()
        self._reader.reset()
        if forget:
            self._host.reset()
        self._host.write(Revision(time=self._host.clock_text(now_s), ident="INIT", version=""))
        self._write_revision(now_s)

    def _write_revision(self, now_s: float) -> None:
        self._revision_s = now_s
        self._host.write(Revision(time=self._host.clock_text(now_s), ident="AUV", version=VERSION))

    def receive(self, now_s: float, data: bytes) -> None:
        """Handles bytes from the host."""
        for sentence in self._reader.feed(data):
            command = self._commands.get(sentence.type)
            if command is None:
                self._host.refuse(now_s, 1, f"{sentence.type}: unknown command")
                continue
            try:
                command(now_s, sentence)
            except SentenceError as error:
                self._host.refuse(now_s, 2, str(error).replace(",", ";"))
        bad_lines = sum(self._reader.counts.values()) - self._reader.counts["sentences"]
        if bad_lines > self._bad_lines:
            self._host.refuse(now_s, 3, "bad line")
        self._bad_lines = bad_lines

    def poll(self, now_s: float) -> None:
        """Advances to `now_s`: ends transmissions, stops waiting for data, sends the revision."""
        self._transmitter.poll(now_s)
        if self.settings["REV"] != "0" and now_s - self._revision_s >= REVISION_PERIOD_S:
            self._write_revision(now_s)

    def arrive(self, now_s: float, arrival: HeardPacket) -> bool:
        """Receives a packet from the water: reports it to the host as the settings request, or answers a ping.

        Returns:
            Whether the host gets a packet, or the answer to its ping.
        """
        mini = MiniPacket.read(arrival.payload) if arrival.payload is not None else None
        if mini is not None:
            return self._pings.receive(now_s, mini, arrival.timed_s, free=not self._transmitter.busy)
        self._report(arrival)
        return arrival.payload is not None and arrival.destination in (BROADCAST, self.address)

    def _report(self, arrival: HeardPacket) -> None:
        good = arrival.payload is not None
        self.counts["heard" if good else "heard_bad"] += 1
        size = RATES[arrival.rate].frame_bytes
        payload = arrival.payload or b""
        snr_db = arrival.snr_db if math.isfinite(arrival.snr_db) else 0.0
        detection = Detection(
            peak=max(0, round(300 * 10 ** (min(snr_db, 40.0) / 40))),
            power_db=round(120 + snr_db),
            ratio_db=max(0, round(snr_db + 20)),
            spl_db=round(110 + snr_db),
        )
        self._host.write(
            Cycle(
                source=arrival.source,
                destination=arrival.destination,
                rate=arrival.rate,
                ack=False,
                frames=arrival.frames,
            )
        )
        if self.settings["RXP"] != "0":
            self._host.write(ReceptionStart(kind=0 if arrival.rate == 0 else 1))
        if self.settings["MFD"] != "0":
            self._host.write(detection)
        for number in range(1, arrival.frames + 1):
            if not good:
                self._host.write(Notice(kind="BAD_CRC", detail=str(number)))
            elif arrival.destination in (BROADCAST, self.address):
                self._host.write(
                    FrameHeard(
                        source=arrival.source,
                        destination=arrival.destination,
                        ack=False,
                        frame=number,
                        data=payload[(number - 1) * size : number * size],
                    )
                )
        if self.settings["CST"] != "0":
            arrived_s = arrival.timed_s if self._host.synchronized else arrival.start_s
            self._host.write(
                ReceptionStatistics(
                    mode=MODE_GOOD if good else MODE_BAD_CRC,
                    utc_s=self._host.utc_s(arrived_s),
                    clock=self._host.clock_status,
                    rate=arrival.rate,
                    source=arrival.source,
                    destination=arrival.destination,
                    frames=arrival.frames,
                    bad_frames=0 if good else arrival.frames,
                    snr_in_db=snr_db,
                )
            )

    def outgoing(self) -> bytes:
        """Bytes for the host; returns each byte once."""
        return self._host.outgoing()

    # ------------------------------------------------------------------ pings

    def _on_ping(self, now_s: float, sentence: Sentence) -> None:
        ping = PingEcho.read(sentence.fields)
        if self._transmitter.busy:
            self._host.refuse(now_s, 6, "transmitting")
            return
        if ping.source != self.address or ping.destination in (BROADCAST, self.address):
            self._host.refuse(now_s, 5, f"ping from {ping.source} to {ping.destination}")
            return
        self._pings.ask(now_s, ping)

    def _transmit_mini(self, start_s: float, mini: MiniPacket) -> None:
        self._transmit(
            Transmission(
                start_s=start_s,
                source=mini.source,
                destination=mini.destination,
                rate=0,
                frames=0,
                payload=mini.to_bytes(),
            )
        )
        self.counts["mini_packets"] += 1

    def _on_sleep(self, now_s: float, sentence: Sentence) -> None:
        """Restarts after zero minutes of sleep; settings and clock stay."""
        address = str(self.address)
        if sentence.fields != (address, address, "0"):
            self._host.refuse(
                now_s, 5, f"sleep {','.join(sentence.fields)}: only of this modem, 0 minutes, is modelled"
            )
            return
        self.boot(now_s)
