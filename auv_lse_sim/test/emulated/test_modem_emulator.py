"""The emulated modem and the driver, on a wire of bytes that the test owns."""

import math
import random

import pytest

from auv_lse_common.mission_file.sections.acoustics import PacketConfig, TdmaConfig
from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_common.vocabulary.modem_rates import packet_duration_s
from auv_lse_common.vocabulary.plan import Plan, Tour
from auv_lse_comms.bridge import ModemBridge
from auv_lse_comms.micromodem.driver import Micromodem
from auv_lse_comms.micromodem.events import (
    ClockChecked,
    ModemReady,
    PacketReceived,
    PingAnswered,
    PingFailed,
    ReceptionFailed,
    TransmitDone,
    TransmitFailed,
    TransmitStarted,
)
from auv_lse_comms.micromodem.sentences.messages import read_message
from auv_lse_comms.micromodem.sentences.transmit_messages import Cycle
from auv_lse_comms.micromodem.sentences.wire import Sentence, SentenceReader
from auv_lse_comms.micromodem.state import State
from auv_lse_sim.emulated.modem_emulator import ModemEmulator
from auv_lse_sim.emulated.modem_packets import HeardPacket
from auv_lse_sim.emulated.pings import MiniPacket

NOW_S = 5000.0
PAYLOAD = bytes(range(252))


class Wire:
    """A driver and an emulated modem, joined; `spoil` may change bytes on their way."""

    def __init__(self, vehicle=3, spoil=lambda data: data, clock_error_s=0.0, pps=True, transmit=None, **values):
        self.sent = []
        self.spoil = spoil
        self.modem = ModemEmulator(transmit or self.sent.append, clock_error_s=clock_error_s, pps=pps)
        self.driver = Micromodem(ModemConfig(kind="micromodem", port="/dev/pty", **values), vehicle)
        self.events = []
        self.now_s = NOW_S
        self.modem.boot(self.now_s)
        self.modem.outgoing()  # nobody was connected yet
        self.driver.opened(self.now_s)
        self.flow()

    def flow(self):
        for _ in range(200):
            down, up = self.driver.outgoing(), self.modem.outgoing()
            if down:
                self.modem.receive(self.now_s, self.spoil(down))
            if up:
                self.driver.receive(self.now_s, self.spoil(up))
            self.events += self.driver.events()
            if self.driver.wants_reopen:
                self.driver.closed(self.now_s, "reopening")
                self.driver.opened(self.now_s)
            elif not down and not up:
                return
        raise AssertionError("driver and modem never come to rest")

    def pass_time(self, seconds, step=0.5):
        for _ in range(round(seconds / step)):
            self.now_s += step
            self.modem.poll(self.now_s)
            self.driver.poll(self.now_s)
            self.flow()

    def of(self, kind):
        return [event for event in self.events if isinstance(event, kind)]


def test_no_time_need_pass_to_configure_and_to_start_a_packet():
    wire = Wire(clock_error_s=-1000.0)
    assert wire.driver.state is State.IDLE
    assert wire.modem.settings["SRC"] == "3"
    assert wire.modem.settings["CST"] == "1"
    wire.driver.send(wire.now_s, PAYLOAD)
    wire.flow()
    (packet,) = wire.sent
    assert (packet.start_s, packet.source, packet.destination, packet.rate) == (NOW_S, 3, 0, 4)
    assert packet.payload == PAYLOAD
    assert wire.driver.quiet
    wire.pass_time(3.0)
    assert [type(e) for e in wire.events if not isinstance(e, ClockChecked)] == [
        ModemReady,
        TransmitStarted,
        TransmitDone,
    ]


def test_the_channels_duration_ends_the_transmission():
    wire = Wire(transmit=lambda packet: 7.0)
    wire.driver.send(wire.now_s, PAYLOAD)
    wire.pass_time(6.5)
    assert wire.driver.state is State.SENDING
    wire.pass_time(1.0)
    assert wire.driver.state is State.IDLE


@pytest.mark.parametrize(("rate", "size", "frames"), [(3, 252, 1), (4, 500, 2), (5, 2000, 8)])
def test_every_usable_rate_both_ways(rate, size, frames):
    wire = Wire(rate=rate)
    payload = bytes(i % 255 + 1 for i in range(size))
    wire.driver.send(wire.now_s, payload)
    wire.flow()
    assert (wire.sent[0].payload, wire.sent[0].frames) == (payload, frames)
    wire.pass_time(8.0)
    wire.modem.arrive(
        wire.now_s,
        HeardPacket(start_s=wire.now_s, source=1, destination=0, payload=payload, snr_db=5.0, rate=rate, frames=frames),
    )
    wire.flow()
    (packet,) = wire.of(PacketReceived)
    assert (packet.payload, packet.snr_db, packet.rate) == (payload, 5.0, rate)
    assert packet.utc_s == pytest.approx(wire.now_s + packet_duration_s(rate, size), abs=1e-4)


def test_a_plan_with_a_tour_goes_through_the_modem():
    """From the sender's bridge through driver and modem, and out of another modem into the receiver's bridge."""
    tour = Tour(segment_legs=2, bearings=tuple(range(0, 250, 5)))
    plan = Plan(step=3, heading_rad=0.5, north_m=1.0, east_m=2.0, actions=(1, 2, 3), naive_path=0xF4, tour=tour)
    sender = ModemBridge(TdmaConfig(), PacketConfig(), 1, 3)
    sender.set_plan(plan)
    sender.add_soundings([[t, 100.0 + t, 50.0, 15.0] for t in range(40)])
    out, into = Wire(vehicle=1), Wire(vehicle=3)
    out.driver.send(out.now_s, sender.poll(1.0))
    out.flow()
    (packet,) = out.sent
    into.modem.arrive(
        into.now_s, HeardPacket(start_s=NOW_S, source=1, destination=0, payload=packet.payload, snr_db=5.0)
    )
    into.flow()
    (heard,) = into.of(PacketReceived)
    received = ModemBridge(TdmaConfig(), PacketConfig(), 3, 3).receive(4.0, heard.source, heard.payload)
    assert received.packet.plan == plan
    assert len(received.packet.samples) == 15


def test_what_cannot_be_decoded_is_reported_as_a_failed_reception():
    wire = Wire()
    wire.modem.arrive(wire.now_s, HeardPacket(start_s=NOW_S, source=1, destination=0, payload=None, snr_db=-4.0))
    wire.flow()
    assert [(e.reason, e.snr_db) for e in wire.of(ReceptionFailed)] == [("bad CRC", -4.0)]


def test_an_unconfigured_modem_gives_no_statistics_and_sends_nothing():
    modem = ModemEmulator(pytest.fail)
    modem.boot(NOW_S)
    modem.arrive(NOW_S, HeardPacket(start_s=NOW_S, source=1, destination=0, payload=PAYLOAD))
    said = modem.outgoing()
    assert b"CARXD" in said
    assert b"CACST" not in said
    modem.receive(NOW_S, Cycle(source=0, destination=0, rate=4, ack=False, frames=1).command().encode())
    assert b"CADRQ" not in modem.outgoing()


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (Sentence("CCXYZ", ("1",)).encode(), b"unknown command"),
        (b"$CCCFG,SRC,1*00\r\n", b"bad line"),
        (Sentence("CCCFG", ("NOPE", "1")).encode(), b"unknown setting"),
        (Sentence("CCCFG", ("SRC", "200")).encode(), b"out of range"),
        (Sentence("CCCYC", ("0", "1", "0", "4", "0", "3")).encode(), b"rate 4 with 3 frames"),
        (Sentence("CCTMS", ("noon", "0")).encode(), b"not a time such as"),
        (Sentence("CCTXD", ("1", "0", "0", "ABC")).encode(), b"hexadecimal"),
    ],
)
def test_wrong_commands_are_refused(command, words):
    modem = ModemEmulator(pytest.fail)
    modem.receive(NOW_S, command)
    said = modem.outgoing()
    assert b"CAERR" in said
    assert words in said
    assert modem.counts["refused"] == 1


def test_the_modem_gives_up_waiting_for_data():
    modem = ModemEmulator(pytest.fail)
    modem.settings |= {"SRC": "1", "XST": "1"}
    modem.receive(NOW_S, b"$CCCYC,0,1,0,4,0,1*5D\r\n")
    assert b"CADRQ" in modem.outgoing()
    modem.poll(NOW_S + 2.0)
    said = modem.outgoing()
    assert b"DATA_TIMEOUT,1" in said
    assert b"CAXST,6," in said
    modem.poll(NOW_S + 60.0)
    assert b"CATXP" not in modem.outgoing()


def test_synchronous_transmissions_wait_for_the_second_and_give_travel_times():
    wire = Wire(synchronous=True)
    wire.now_s += 0.4
    wire.driver.send(wire.now_s, PAYLOAD)
    wire.flow()
    assert wire.sent == []
    wire.pass_time(0.6, step=0.1)
    assert wire.sent[0].start_s == pytest.approx(NOW_S + 1.0)
    wire.pass_time(5.0)
    wire.modem.arrive(
        wire.now_s,
        HeardPacket(start_s=NOW_S + 4.3, measured_s=NOW_S + 4.31, source=1, destination=0, payload=PAYLOAD, snr_db=5.0),
    )
    wire.flow()
    packet = wire.of(PacketReceived)[0]
    assert packet.travel_s == pytest.approx(0.31, abs=1e-4)
    assert (packet.sent_s, packet.arrival_s) == (NOW_S + 4.0, pytest.approx(NOW_S + 4.31, abs=1e-4))


def test_a_transmission_begins_on_the_second_however_seldom_time_passes():
    wire = Wire(synchronous=True)
    wire.now_s += 0.4
    wire.driver.send(wire.now_s, PAYLOAD)
    wire.flow()
    wire.pass_time(0.9, step=0.45)  # 0.85, 1.3: never within 20 ms of the second
    assert wire.sent[0].start_s == pytest.approx(NOW_S + 1.0)


def test_without_a_pps_a_synchronous_modem_sends_nothing_and_times_nothing():
    wire = Wire(synchronous=True, pps=False)
    number = wire.driver.send(wire.now_s, PAYLOAD)
    wire.flow()
    wire.pass_time(3.0)
    assert wire.sent == []
    (failed,) = wire.of(TransmitFailed)
    assert failed.number == number
    assert "no external synchronization" in failed.reason
    wire.modem.arrive(
        wire.now_s, HeardPacket(start_s=NOW_S + 4.3, source=1, destination=0, payload=PAYLOAD, snr_db=5.0)
    )
    wire.flow()
    assert math.isnan(wire.of(PacketReceived)[0].travel_s)


def test_a_modem_that_forgets_everything_is_configured_again():
    wire = Wire()
    wire.modem.boot(wire.now_s, forget=True)
    wire.flow()
    assert wire.modem.settings["SRC"] == "3"
    assert wire.driver.state is State.IDLE
    assert len(wire.of(ModemReady)) == 2
    wire.modem.settings["SRC"] = "0"  # another reboot, unheard
    wire.pass_time(61.0)
    assert wire.modem.settings["SRC"] == "3"
    assert wire.driver.counts["reboots"] == 2


@pytest.mark.parametrize("seed", range(8))
def test_a_bad_cable_costs_packets_but_never_the_driver(seed):
    """One byte in 1000 is changed, dropped or doubled, both ways, for two hours of slots; then the cable is good."""
    rng = random.Random(seed)

    def spoil(data):
        out = bytearray()
        for byte in data:
            chance = rng.random()
            if chance < 1 / 3000:
                out.append(byte ^ 1 << rng.randrange(8))
            elif chance < 2 / 3000:
                continue
            elif chance < 3 / 3000:
                out += bytes((byte, byte))
            else:
                out.append(byte)
        return bytes(out)

    wire = Wire(spoil=spoil)
    asked = []
    words = {random.Random(slot).randbytes(252) for slot in range(240)}
    for slot in range(240):
        asked.append(wire.driver.send(wire.now_s, PAYLOAD))
        wire.flow()
        wire.pass_time(15.0)
        payload = random.Random(slot).randbytes(252)
        wire.modem.arrive(
            wire.now_s, HeardPacket(start_s=wire.now_s, source=1, destination=0, payload=payload, snr_db=9.0)
        )
        wire.flow()
        wire.pass_time(15.0)
    started = [e.number for e in wire.of(TransmitStarted)]
    done = [e.number for e in wire.of(TransmitDone)]
    failed = [e.number for e in wire.of(TransmitFailed)]
    # every packet has one outcome, and one that is reported as sent went out as it was
    assert sorted(done + failed) == asked
    assert set(done) <= set(started)
    assert len(wire.sent) >= len(done)
    # eight bits of exclusive or let through what cancels (a character doubled twice): one in a hundred on such a
    # cable, which is why packets can carry a tag
    wrong_out = sum(packet.payload != PAYLOAD for packet in wire.sent)
    received = wire.of(PacketReceived)
    wrong_in = sum(packet.payload not in words for packet in received)
    assert wrong_out <= 0.05 * len(wire.sent)
    assert wrong_in <= 0.05 * len(received)
    assert 20 < len(done) < 240  # it was a bad cable, and it was used
    wire.spoil = lambda data: data
    wire.pass_time(180.0)
    assert wire.driver.state is State.IDLE
    before = len(wire.of(TransmitDone))
    for _ in range(5):
        wire.driver.send(wire.now_s, PAYLOAD)
        wire.flow()
        wire.pass_time(10.0)
    assert len(wire.of(TransmitDone)) == before + 5


def answer_of(wire, mate=1, turn_s=0.7, back_s=0.30):
    """What comes back of the ping that `wire` has sent last: there in 0.26 s, and back."""
    mini = MiniPacket.read(wire.sent[-1].payload)
    assert (mini.source, mini.destination, mini.answer) == (3, mate, False)
    answer = MiniPacket(source=mate, destination=3, answer=True, turn_s=turn_s)
    start_s = wire.sent[-1].start_s + 0.26 + turn_s + back_s
    return HeardPacket(start_s=start_s, source=mate, destination=0, payload=answer.to_bytes())


def test_a_ping_gives_the_travel_time_there_and_back_whatever_the_turn_takes():
    wire = Wire()
    number = wire.driver.ping(wire.now_s, 1)
    wire.flow()
    assert wire.driver.quiet
    wire.pass_time(2.5)
    wire.modem.arrive(wire.now_s, answer_of(wire))
    wire.flow()
    (answered,) = wire.of(PingAnswered)
    assert (answered.number, answered.source) == (number, 1)
    assert answered.travel_s == pytest.approx(0.28, abs=1e-4)
    assert NOW_S < answered.utc_s < NOW_S + 2.5
    assert wire.driver.state is State.IDLE


def test_a_pinged_modem_answers_by_itself_and_only_if_it_is_meant():
    wire = Wire()
    for destination in (1, 3):
        ping = MiniPacket(source=2, destination=destination).to_bytes()
        heard = HeardPacket(start_s=NOW_S + 3.1, measured_s=NOW_S + 3.2, source=2, destination=0, payload=ping)
        assert not wire.modem.arrive(NOW_S + 4.0, heard)
    wire.flow()
    (answer,) = wire.sent
    mini = MiniPacket.read(answer.payload)
    assert (mini.source, mini.destination, mini.answer, mini.turn_s) == (3, 2, True, pytest.approx(0.8))
    assert wire.driver.counts["pings_heard"] == 1


def test_a_packet_asked_for_during_a_ping_waits_for_its_end():
    wire = Wire()
    wire.driver.ping(wire.now_s, 1)
    wire.flow()
    wire.driver.send(wire.now_s, PAYLOAD)
    wire.flow()
    assert len(wire.sent) == 1
    wire.modem.arrive(wire.now_s, answer_of(wire))
    wire.flow()
    assert len(wire.sent) == 2
    wire.driver.ping(wire.now_s, 1)
    wire.flow()
    assert "busy" in wire.of(PingFailed)[0].reason


def test_every_sentence_sent_can_be_read():
    """The modem's own sentences, over all settings and levels, pass the reader that the driver uses."""
    modem = ModemEmulator(lambda packet: None)
    modem.settings |= dict.fromkeys(("CST", "RXP", "REV", "XST", "MFD"), "1") | {"SRC": "2"}
    for snr_db in (-40.0, -0.04, 0.0, 12.34, 99.9, math.nan, -math.inf):
        for payload in (PAYLOAD, None):
            modem.arrive(0.0, HeardPacket(start_s=0.0, source=1, destination=0, payload=payload, snr_db=snr_db))
    sentences = SentenceReader().feed(modem.outgoing())
    assert len(sentences) == 7 * 2 * 5
    for sentence in sentences:
        assert read_message(sentence) is not None
