"""The driver against a modem whose every line is written in the test: no emulator, nothing shared but the format."""

import itertools
import math

import pytest

from auv_lse_common.mission_file.parameters import ParameterError, from_mapping
from auv_lse_common.mission_file.sections.modem import DRIVERS_OWN, PAYLOAD_BYTES, ModemConfig
from auv_lse_common.vocabulary.modem_rates import MINI_PACKET_S, packet_duration_s
from auv_lse_comms.micromodem.configuration import settings_of
from auv_lse_comms.micromodem.driver import Micromodem
from auv_lse_comms.micromodem.events import (
    Event,
    PacketReceived,
    PingAnswered,
    PingFailed,
    ReceptionFailed,
    TransmitDone,
    TransmitFailed,
    TransmitStarted,
)
from auv_lse_comms.micromodem.sentences.fields import iso_time
from auv_lse_comms.micromodem.sentences.messages import MESSAGES
from auv_lse_comms.micromodem.session import Session
from auv_lse_comms.micromodem.state import Cause, State
from auv_lse_comms.packet.fields import PACKET_BYTES

NOW_S = 1575255779.05  # 2019-12-02T03:02:59.05Z
PAYLOAD = bytes(range(252))


def line(text: str) -> bytes:
    value = 0
    for character in text:
        value ^= ord(character)
    return f"${text}*{value:02X}\r\n".encode()


def config(**values) -> ModemConfig:
    return ModemConfig(kind="micromodem", port="/dev/null", **values)


class Bench:
    """A driver and somebody who types the modem's answers."""

    def __init__(self, **values):
        self.modem = Micromodem(config(**values), 3)
        self.now_s = NOW_S

    def written(self) -> list[str]:
        return [text.split("*")[0].lstrip("$") for text in self.modem.outgoing().decode().split("\r\n") if text]

    def hear(self, *texts: str) -> list[Event]:
        for text in texts:
            self.modem.receive(self.now_s, line(text))
        return self.modem.events()

    def wait(self, seconds: float, step: float = 0.1) -> list[Event]:
        for _ in range(round(seconds / step)):
            self.now_s += step
            self.modem.poll(self.now_s)
        return self.modem.events()

    def open(self) -> None:
        """The port is open, on a modem that has just told its firmware."""
        self.modem.opened(self.now_s)
        self.hear("CAREV,030259,AUV,2.0.27087")

    def configure(self) -> "Bench":
        self.open()
        while (asked := self.written())[-1].startswith("CCCFG"):
            self.hear("CACFG," + asked[-1].split(",", 1)[1])
        assert asked == ["CCTMQ,0"]
        self.hear(f"CATMQ,{iso_time(self.now_s)},USER_CMD,RTC")
        assert self.modem.state is State.IDLE
        return self

    def sending(self) -> "Bench":
        self.configure()
        self.modem.send(self.now_s, PAYLOAD)
        self.written()
        self.hear("CACYC,0,3,0,4,0,1", "CADRQ,030259,3,0,0,256,1", "CATXD,3,0,0,252", "CATXP,252")
        self.written()
        assert self.modem.state is State.SENDING
        return self


def kinds(events):
    return [type(event).__name__ for event in events]


# ------------------------------------------------------------------ configuration


def test_settings_are_sent_one_by_one_each_after_the_answer_to_the_one_before():
    bench = Bench()
    bench.open()
    lines = []
    for _ in range(20):
        now = bench.written()
        assert len(now) == 1
        lines += now
        if not now[0].startswith("CCCFG"):
            break
        bench.hear("CACFG," + now[0].split(",", 1)[1])
    assert lines[0] == "CCCFG,SRC,3"
    assert {"CCCFG,CST,1", "CCCFG,RXP,1", "CCCFG,REV,1", "CCCFG,ASD,0"} <= set(lines)
    assert lines[-1] == "CCTMQ,0"


def test_ready_only_after_settings_and_clock():
    bench = Bench().configure()
    assert bench.modem.counts["configured"] == 1


def test_an_unanswered_setting_is_repeated_and_then_the_port_reopened():
    bench = Bench(retries=2, reply_timeout_s=1.0)
    bench.open()
    assert bench.written() == ["CCCFG,SRC,3"]
    bench.wait(1.1)
    assert bench.written() == ["CCCFG,SRC,3"]
    assert not bench.modem.wants_reopen
    events = bench.wait(2.2)
    assert bench.modem.wants_reopen
    assert "Problem" in kinds(events)
    bench.modem.closed(bench.now_s, "reopening")
    bench.open()
    assert not bench.modem.wants_reopen
    assert bench.written() == ["CCCFG,SRC,3"]


def test_a_refused_setting_is_reported_and_skipped_unless_required():
    bench = Bench()
    bench.open()
    bench.written()
    bench.hear("CACFG,SRC,3")
    bench.written()
    bench.hear("CACFG,CST,1")
    assert bench.written() == ["CCCFG,RXP,1"]
    (problem,) = bench.hear("CAERR,030259,NMEA,4,unknown setting")
    assert "RXP" in problem.text
    assert bench.written() == ["CCCFG,RXD,1"]
    assert bench.modem.counts["settings_refused"] == 1


def test_further_settings_of_the_mission_file_are_sent_last():
    bench = Bench(settings={"BND": 0, "FC0": 10000})
    bench.open()
    asked = []
    while (lines := bench.written())[-1].startswith("CCCFG"):
        asked.append(lines[-1])
        bench.hear("CACFG," + lines[-1].split(",", 1)[1])
    assert asked[-2:] == ["CCCFG,BND,0", "CCCFG,FC0,10000"]
    assert {"CCCFG,TXP,1", "CCCFG,TXF,1", "CCCFG,RXD,1"} < set(asked)


def test_the_drivers_own_settings_and_names_that_break_a_sentence_are_refused():
    assert tuple(setting.name for setting, _ in settings_of(config(), 3)) == DRIVERS_OWN
    for name in DRIVERS_OWN:
        with pytest.raises(ParameterError, match=rf"settings.{name} is 9, but the driver sets SRC, .* itself"):
            Bench(settings={name: 9})
    for name in ("BND,1", "", "B*D", "BND\r\n"):
        with pytest.raises(ParameterError, match="use letters, digits"):
            Bench(settings={name: 9})


def test_a_refused_required_setting_is_repeated_forever():
    bench = Bench(retries=1, reply_timeout_s=1.0)
    bench.open()
    for _ in range(5):
        assert bench.written() == ["CCCFG,SRC,3"]
        bench.hear("CAERR,030259,NMEA,4,no")
        if not (lines := bench.written()):
            bench.wait(1.1)
            lines = bench.written()
        assert lines == ["CCCFG,SRC,3"]
        bench.hear("CACFG,SRC,9")  # nor does another value count as an answer
        if not bench.modem._session._out:
            bench.wait(1.1)
    assert bench.modem.state is State.CONFIGURING


# ------------------------------------------------------------------ clock


@pytest.mark.parametrize(
    ("synchronous", "command"), [(False, "CCTMS,2019-12-02T03:03:00Z,0"), (True, "CCTMS,2019-12-02T03:03:01Z,1")]
)
def test_a_clock_that_is_off_is_set_at_the_start_of_a_second_and_checked_again(synchronous, command):
    """With a PPS the time is that of its next edge, a second ahead."""
    bench = Bench(synchronous=synchronous)
    bench.now_s = math.floor(NOW_S) + 0.5
    bench.open()
    while (asked := bench.written())[-1].startswith("CCCFG"):
        bench.hear("CACFG," + asked[-1].split(",", 1)[1])
    (checked,) = bench.hear("CATMQ,2000-01-01T00:00:00Z,NONE,NONE")
    assert not checked.within_tolerance
    assert checked.offset_s == pytest.approx(946684801.0 - bench.now_s)
    assert bench.written() == []  # not in the middle of a second
    bench.wait(0.55, step=0.05)
    assert bench.written() == [command]
    bench.hear("CATMS,0,2019-12-02T03:03:00Z")
    assert bench.written() == ["CCTMQ,0"]
    events = bench.hear("CATMQ,2019-12-02T03:03:00Z,USER_CMD,RTC")
    assert kinds(events) == ["ClockChecked", "ModemReady"]
    assert bench.modem.counts["clock_set"] == 1


@pytest.mark.parametrize(("reading_s", "offset_s"), [(0, 0.0), (-1, 0.0), (-2, -1.5), (1, 0.5), (5, 4.5)])
def test_a_clock_reading_in_whole_seconds_is_exact_within_its_second(reading_s, offset_s):
    bench = Bench(set_clock=False, clock_tolerance_s=0.1)
    bench.now_s = math.floor(NOW_S) + 0.5 if reading_s != -1 else math.floor(NOW_S)
    bench.open()
    while (asked := bench.written())[-1].startswith("CCCFG"):
        bench.hear("CACFG," + asked[-1].split(",", 1)[1])
    events = bench.hear(f"CATMQ,{iso_time(bench.now_s + reading_s)},NONE,NONE")
    assert events[0].offset_s == pytest.approx(offset_s)
    assert bench.modem.state is State.IDLE  # it is used all the same
    assert ("Problem" in kinds(events)) == (abs(offset_s) > 0.1)


def test_a_modem_without_clock_commands_is_used():
    bench = Bench()
    bench.open()
    while (asked := bench.written())[-1].startswith("CCCFG"):
        bench.hear("CACFG," + asked[-1].split(",", 1)[1])
    events = bench.hear("CAERR,030259,NMEA,1,unknown command")
    assert kinds(events) == ["Problem", "ModemReady"]


def test_clock_and_address_are_asked_for_again_and_again():
    bench = Bench(clock_period_s=10.0).configure()
    bench.wait(9.0)
    assert bench.written() == []
    bench.wait(1.5)
    assert bench.written() == ["CCCFQ,SRC", "CCTMQ,0"]


def test_silence_is_detected_by_the_clock_check():
    bench = Bench(clock_period_s=10.0, reply_timeout_s=1.0, retries=1).configure()
    bench.wait(25.0)
    assert bench.modem.wants_reopen


def test_a_step_back_of_the_hosts_clock_does_not_freeze_the_waits():
    bench = Bench(reply_timeout_s=1.0)
    bench.open()
    bench.written()
    bench.now_s -= 1e6
    bench.wait(1.2)
    assert bench.written() == ["CCCFG,SRC,3"]
    assert bench.modem.counts["clock_steps"] == 1


# ------------------------------------------------------------------ transmission


def test_the_handshake_word_for_word():
    bench = Bench().configure()
    number = bench.modem.send(bench.now_s, PAYLOAD)
    assert bench.written() == ["CCCYC,0,3,0,4,0,1"]
    bench.hear("CACYC,0,3,0,4,0,1")
    assert bench.written() == []
    bench.hear("CADRQ,030259,3,0,0,256,1")
    assert bench.written() == ["CCTXD,3,0,0," + PAYLOAD.hex().upper()]
    assert bench.hear("CATXD,3,0,0,252") == []
    assert bench.hear("CATXP,252") == [TransmitStarted(number=number)]
    assert bench.modem.quiet
    assert bench.hear("CATXF,252") == [TransmitDone(number=number)]
    assert bench.hear("CAXST,6,20191202,030259.0000,14,0,200,5000,25000,4,3,0,0,1,1,3,252") == []
    assert bench.modem.state is State.IDLE


@pytest.mark.parametrize(("rate", "size", "frames"), [(3, 252, 1), (4, 257, 2), (5, 2048, 8)])
def test_frames_by_rate(rate, size, frames):
    bench = Bench(rate=rate).configure()
    payload = bytes(i % 251 for i in range(size))
    bench.modem.send(bench.now_s, payload, 7)
    assert bench.written() == [f"CCCYC,0,3,7,{rate},0,{frames}"]
    bench.hear(f"CACYC,0,3,7,{rate},0,{frames}")
    sent = b""
    for frame in range(1, frames + 1):
        bench.hear(f"CADRQ,030259,3,7,0,256,{frame}")
        (lines,) = bench.written()
        sent += bytes.fromhex(lines.split(",")[-1])
        bench.hear(f"CATXD,3,7,0,{len(lines.split(',')[-1]) // 2}")
    assert sent == payload
    assert kinds(bench.hear(f"CATXP,{size}", f"CATXF,{size}")) == ["TransmitStarted", "TransmitDone"]


@pytest.mark.parametrize("size", [0, 513])
def test_a_payload_that_does_not_fit_is_refused(size):
    with pytest.raises(ValueError, match=f"payload: {size} bytes do not fit rate 4; send 1 to 512"):
        Bench().configure().modem.send(NOW_S, bytes(size))


@pytest.mark.parametrize(
    "lost",
    [{"CACYC,0,3,0,4,0,1"}, {"CATXD,3,0,0,252"}, {"CATXP,252"}, {"CACYC,0,3,0,4,0,1", "CATXD,3,0,0,252", "CATXP,252"}],
)
def test_lines_lost_on_the_wire_do_not_lose_the_transmission(lost):
    bench = Bench().configure()
    bench.modem.send(bench.now_s, PAYLOAD)
    answers = ["CACYC,0,3,0,4,0,1", "CADRQ,030259,3,0,0,256,1", "CATXD,3,0,0,252", "CATXP,252", "CATXF,252"]
    events = bench.hear(*(answer for answer in answers if answer not in lost))
    assert kinds(events) == ["TransmitStarted", "TransmitDone"]
    assert bench.modem.state is State.IDLE


@pytest.mark.parametrize(
    ("heard", "error", "reason"),
    [
        ((), "CAERR,030259,NMEA,5,bad rate", "refused by the modem"),
        (("CACYC,0,3,0,4,0,1",), "CAERR,030259,DATA_TIMEOUT,1", "data timeout at frame 1"),
        (("CACYC,0,3,0,4,0,1", "CADRQ,030259,3,0,0,256,1"), "CAERR,030259,DATA_TIMEOUT,1", "data timeout"),
        (("CACYC,0,3,0,4,0,1", "CADRQ,030259,3,0,0,256,1"), "CAXST,6,20191202,030259.0000,14,4", "data timeout"),
        (("CACYC,0,3,0,4,0,1",), "CAXST,6,20191202,030259.0000,14,1", "too hot"),
        (("CACYC,0,3,0,4,0,1",), "CAXST,6,20191202,030259.0000,14,2", "no external synchronization"),
        (("CACYC,0,3,0,4,0,1",), "CAXST,6,20191202,030259.0000,14,3,,,,,,,,,,", "transmission is inhibited"),
        (("CACYC,0,3,0,4,0,1", "CADRQ,030259,3,0,0,256,1"), "CAERR,030259,NMEA,7,bad frame", "refused"),
        (("CACYC,0,3,0,4,0,1",), "CADRQ,030259,3,0,0,64,1", "accepts 64 bytes"),
        (("CACYC,0,3,0,4,0,1",), "CADRQ,030259,3,0,0,256,2", "requested frame 2 of 1"),
        (("CACYC,0,3,0,4,0,1",), "CAREV,030259,INIT,", "rebooted"),
    ],
)
def test_every_refusal_ends_the_transmission_once(heard, error, reason):
    bench = Bench().configure()
    number = bench.modem.send(bench.now_s, PAYLOAD)
    bench.hear(*heard)
    failures = [e for e in bench.hear(error) + bench.wait(20.0) if isinstance(e, TransmitFailed)]
    assert [f.number for f in failures] == [number]
    assert reason in failures[0].reason


def test_other_errors_are_reported_and_leave_the_transmission_alone():
    bench = Bench().configure()
    bench.modem.send(bench.now_s, PAYLOAD)
    (problem,) = bench.hear("CAERR,030259,AUX,3,something inside")
    assert "AUX 3 something inside" in problem.text
    assert bench.modem.state is State.CYCLING
    assert bench.modem.counts["error: AUX"] == 1
    bench.hear("CAERR,030259,NEWMODULE,3,who knows")
    assert bench.modem.counts["error: other"] == 1


def test_a_packet_whose_slot_is_over_is_dropped_and_a_late_request_is_not_answered():
    bench = Bench(start_timeout_s=2.0).configure()
    number = bench.modem.send(bench.now_s, PAYLOAD)
    bench.written()
    bench.hear("CACYC,0,3,0,4,0,1")
    events = bench.wait(2.1)
    assert [e.number for e in events] == [number]
    assert "too late" in events[0].reason
    bench.hear("CADRQ,030302,3,0,0,256,1")
    assert bench.written() == []
    assert bench.modem.counts["unasked_requests"] == 1
    assert bench.hear("CAERR,030304,DATA_TIMEOUT,1") == []  # the modem's own end of it


def test_one_packet_waits_while_the_modem_is_busy_and_a_second_is_refused():
    bench = Bench().sending()
    second = bench.modem.send(bench.now_s, PAYLOAD[::-1])
    third = bench.modem.send(bench.now_s, PAYLOAD)
    assert [(e.number, "busy" in e.reason) for e in bench.modem.events()] == [(third, True)]
    assert bench.written() == []
    bench.hear("CATXF,252")
    assert bench.written() == ["CCCYC,0,3,0,4,0,1"]
    bench.hear("CACYC,0,3,0,4,0,1", "CADRQ,030259,3,0,0,256,1")
    assert bench.written() == ["CCTXD,3,0,0," + PAYLOAD[::-1].hex().upper()]
    assert bench.hear("CATXP,252") == [TransmitStarted(number=second)]


def test_a_packet_requested_while_the_modem_is_missing_is_dropped_in_time():
    bench = Bench(start_timeout_s=2.0)
    bench.modem.poll(bench.now_s)
    number = bench.modem.send(bench.now_s, PAYLOAD)
    assert bench.wait(1.5) == []
    (failure,) = bench.wait(1.0)
    assert (failure.number, "no modem" in failure.reason) == (number, True)
    bench.configure()
    assert bench.written() == []


def test_a_transmission_without_an_end_times_out():
    bench = Bench(transmit_timeout_s=5.0).sending()
    events = bench.wait(5.2)
    assert kinds(events) == ["TransmitFailed"]
    assert bench.modem.state is State.IDLE


def test_closing_the_port_fails_transmissions_in_progress():
    bench = Bench().sending()
    bench.modem.closed(bench.now_s, "unplugged")
    assert kinds(bench.modem.events()) == ["ModemLost", "TransmitFailed"]
    bench.modem.receive(bench.now_s, b"$CATXF,252*51\r\n")
    assert bench.modem.events() == []


# ------------------------------------------------------------------ reception

CYCLE, PROBE, MFD = "CACYC,0,2,0,4,0,1", "CARXP,1", "CAMFD,00300,00120,00030,00110"
FRAME = "CARXD,2,0,0,1," + PAYLOAD.hex().upper()


def statistics(mode=0, bad=0, frames=1, toa="20191202030257.0500", clock=14):
    return (
        f"CACST,6,{mode},{toa},{clock},00300,00120,00030,00110,0,0,0,0,0,4,2,0,0,3,{frames},{bad},"
        "12,12.3,10.0,9.9,-10.5,0,0.2,60,25000,5000"
    )


def test_a_reception_ends_with_its_statistics_and_reports_what_the_modem_measured():
    bench = Bench().configure()
    assert bench.hear(CYCLE, PROBE, MFD, FRAME) == []
    (packet,) = bench.hear(statistics())
    assert (packet.source, packet.destination, packet.payload, packet.rate) == (2, 0, PAYLOAD, 4)
    assert packet.snr_db == 12.3
    assert packet.utc_s == pytest.approx(1575255777.05 + packet_duration_s(4, 252), abs=1e-4)
    assert math.isnan(packet.travel_s)  # no synchronous clocks are configured


def test_statistics_that_the_driver_does_not_use_may_be_garbled():
    bench = Bench().configure()
    assert bench.hear(CYCLE, PROBE, MFD, FRAME) == []
    (packet,) = bench.hear(statistics().replace("-10.5", "#").replace("00300", "nan"))
    assert (packet.payload, packet.snr_db) == (PAYLOAD, 12.3)


@pytest.mark.parametrize("order", list(itertools.permutations([CYCLE, PROBE, MFD])))
def test_the_order_of_the_announcements_does_not_matter(order):
    bench = Bench().configure()
    assert kinds(bench.hear(*order, FRAME, statistics())) == ["PacketReceived"]


@pytest.mark.parametrize("lost", [CYCLE, PROBE, MFD])
def test_lost_announcements_do_not_lose_the_packet(lost):
    bench = Bench().configure()
    heard = [text for text in (CYCLE, PROBE, MFD, FRAME, statistics()) if text != lost]
    assert kinds(bench.hear(*heard)) == ["PacketReceived"]


def test_lost_statistics_do_not_lose_the_packet():
    bench = Bench(receive_timeout_s=5.0).configure()
    assert bench.hear(CYCLE, PROBE, FRAME) == []
    (packet,) = bench.wait(5.2)
    assert packet.payload == PAYLOAD
    assert math.isnan(packet.snr_db)
    assert bench.modem.counts["receptions_without_statistics"] == 1
    events = bench.hear(CYCLE, PROBE, FRAME, CYCLE, PROBE, FRAME, statistics())
    assert kinds(events) == ["PacketReceived", "PacketReceived"]


@pytest.mark.parametrize(
    ("heard", "reason"),
    [
        ((CYCLE, PROBE, "CAMSG,BAD_CRC,1", statistics(mode=1, bad=1)), "bad CRC"),
        ((CYCLE, PROBE, "CAMSG,Bad CRC,1", statistics(mode=1, bad=1)), "bad CRC"),
        ((CYCLE, PROBE, FRAME, statistics(mode=1, bad=1)), "bad CRC"),
        ((CYCLE, PROBE, "CAMSG,PACKET_TIMEOUT,1", "CACST,6,2,20191202030259.0500"), "packet timeout"),
        ((CYCLE, PROBE, statistics()), "no frame"),
        ((PROBE,), "timed out"),
        (("CACYC,0,2,0,4,0,2", PROBE, FRAME, statistics(frames=2)), "frames missing"),
        (("CARXD,2,0,0,2,00", statistics()), "frames missing"),
        ((statistics(),), "no frame"),
    ],
)
def test_a_reception_that_gives_no_packet_is_reported_once_with_its_reason(heard, reason):
    bench = Bench().configure()
    events = bench.hear(*heard) + bench.wait(30.0)
    failures = [e for e in events if isinstance(e, ReceptionFailed)]
    assert len(failures) == 1
    assert reason in failures[0].reason
    assert not [e for e in events if isinstance(e, PacketReceived)]


def test_two_frames_make_one_packet_in_the_order_of_their_numbers():
    bench = Bench().configure()
    (packet,) = bench.hear("CACYC,0,2,0,4,0,2", "CARXD,2,0,0,2,BB", "CARXD,2,0,0,1,AA", statistics(frames=2))
    assert packet.payload == b"\xaa\xbb"


def test_a_frame_filled_up_with_zeros_is_cut_to_the_packet():
    bench = Bench().configure()
    (packet,) = bench.hear(CYCLE, FRAME + "00000000", statistics())
    assert packet.payload == PAYLOAD
    (packet,) = bench.hear(CYCLE, FRAME + "00000001", statistics())
    assert len(packet.payload) == 256  # that was no filling: the packet layer shall judge it


def test_packets_for_others_are_not_handed_on():
    bench = Bench().configure()
    assert bench.hear("CACYC,0,2,9,4,0,1", "CARXD,2,9,0,1,00", statistics()) == []
    assert bench.modem.counts["not_for_us"] == 1


def test_a_reception_during_the_handshake_disturbs_neither():
    bench = Bench().configure()
    number = bench.modem.send(bench.now_s, PAYLOAD)
    events = bench.hear(PROBE, CYCLE, "CACYC,0,3,0,4,0,1", FRAME, "CADRQ,030259,3,0,0,256,1", statistics(), "CATXP,252")
    assert kinds(events) == ["PacketReceived", "TransmitStarted"]
    assert events[1].number == number


def test_travel_time_from_the_second_when_clocks_are_synchronous():
    bench = Bench(synchronous=True).configure()
    (packet,) = bench.hear(CYCLE, FRAME, statistics(toa="20191202030257.4000"))
    assert packet.travel_s == pytest.approx(0.4)
    assert (packet.sent_s, packet.arrival_s) == (1575255777.0, pytest.approx(1575255777.4, abs=1e-5))
    (packet,) = bench.hear(CYCLE, FRAME, statistics(toa="20191202030257.4000", clock=6))
    assert math.isnan(packet.travel_s)  # held by its own RTC only


def test_a_ping_word_for_word():
    bench = Bench().configure()
    number = bench.modem.ping(bench.now_s, 2)
    assert bench.written() == ["CCMPC,3,2"]
    assert kinds(bench.hear("CAMPC,3,2", "CATXP,0", "CATXF,0", "CARXP,0")) == ["PingStarted"]
    bench.wait(3.0)
    (answered,) = bench.hear("CAMPR,2,3,0.4567", statistics(frames=0).replace(",4,2,0,0,3,", ",0,2,3,0,2,"))
    assert (answered.number, answered.source, answered.travel_s) == (number, 2, 0.4567)
    assert answered.utc_s == pytest.approx(NOW_S + 0.5 * (3.0 - MINI_PACKET_S))
    assert bench.modem.state is State.IDLE


@pytest.mark.parametrize(
    ("heard", "reason"),
    [
        (["CAMPC,3,2"], "no answer from modem 2"),
        (["CAERR,030259,NMEA,1,unknown"], "refused by the modem"),
        (["CAMPC,3,2", "CAMPR,2,3"], "reported no travel time"),
        (["CAREV,030259,INIT,", "CAREV,030259,AUV,2.0"], "rebooted"),
    ],
)
def test_a_ping_that_fails_is_reported_once_with_its_reason(heard, reason):
    bench = Bench().configure()
    bench.modem.ping(bench.now_s, 2)
    events = bench.hear(*heard) + bench.wait(8.0)
    (failed,) = [event for event in events if isinstance(event, PingFailed)]
    assert reason in failed.reason
    assert not any(isinstance(event, (PingAnswered, ReceptionFailed)) for event in events)


@pytest.mark.parametrize("destination", [0, 3, 128])
def test_a_ping_of_no_other_modem_is_refused(destination):
    with pytest.raises(ValueError, match="choose another modem"):
        Bench().configure().modem.ping(NOW_S, destination)


@pytest.mark.parametrize("toa", ["20000101000000.0000", "garbage", ""])
def test_an_implausible_arrival_time_is_replaced_by_the_hosts(toa):
    bench = Bench().configure()
    (packet,) = bench.hear(CYCLE, FRAME, statistics(toa=toa))
    assert packet.utc_s == bench.now_s


def test_an_fsk_packet_has_two_statistics_and_ends_with_the_second():
    bench = Bench().configure()
    mini = "CACST,6,0,20191202030257.0500,14,1,1,1,1,0,0,0,0,0,0,2,0,0,1,1,0,12,12.3,10.0,9.9,-10.5,0,0.2,60,25000,5000"
    assert bench.hear("CACYC,0,2,0,0,0,1", mini) == []
    assert kinds(bench.hear("CARXP,0", "CARXD,2,0,0,1,AABB", mini)) == ["PacketReceived"]


def test_frames_of_two_senders_never_make_one_packet():
    bench = Bench().configure()
    other = "CARXD,5,0,0,2,BB"
    events = bench.hear("CACYC,0,2,0,4,0,2", "CARXD,2,0,0,1,AA", other, statistics(frames=2))
    assert kinds(events) == ["ReceptionFailed", "ReceptionFailed"]
    assert not [e for e in events if isinstance(e, PacketReceived)]


def test_a_frame_received_twice_counts_once():
    bench = Bench().configure()
    (packet,) = bench.hear(CYCLE, FRAME, FRAME, statistics())
    assert packet.payload == PAYLOAD
    assert bench.modem.counts["repeated_frames"] == 1


def test_a_modem_that_accepted_part_of_a_frame_is_reported():
    bench = Bench().configure()
    bench.modem.send(bench.now_s, PAYLOAD)
    (problem,) = bench.hear("CACYC,0,3,0,4,0,1", "CADRQ,030259,3,0,0,256,1", "CATXD,3,0,0,250")
    assert "accepted 250 of the frame's 252 bytes" in problem.text


def test_unexpected_sentences_change_nothing():
    bench = Bench().configure()
    events = bench.hear("CATXD,3,0,0,252", "CATXP,252", "CATXF,252", "CATMS,0,2019-12-02T03:02:59Z", "CAXXX,1")
    assert events == []
    assert bench.modem.state is State.IDLE
    assert bench.modem.counts["unasked_transmissions"] == 1
    assert bench.modem.ignored.counts["CAXXX"] == 1


# ------------------------------------------------------------------ reboot


@pytest.mark.parametrize("answers", [True, False])
def test_a_running_modem_is_restarted_once_to_report_its_firmware(answers):
    bench = Bench()
    bench.modem.opened(bench.now_s)
    bench.written()
    bench.hear("CACFG,SRC,3")
    assert bench.written() == ["CCMSC,3,3,0"]
    if answers:
        bench.hear("CAMSC,3,3,0", "CAREV,030259,INIT,", "CAREV,030300,AUV,2.0.27087")
    else:
        bench.wait(2.1)
    assert bench.modem.version == ("2.0.27087" if answers else "")
    assert bench.written() == ["CCCFG,CST,1"]
    while (asked := bench.written() or ["CCCFG,CST,1"])[-1].startswith("CCCFG"):
        bench.hear("CACFG," + asked[-1].split(",", 1)[1])
    assert asked == ["CCTMQ,0"]
    assert bench.modem.counts["restarts"] == 1
    assert bench.modem.counts["reboots"] == 0


def test_a_rebooted_modem_is_configured_when_it_reports_its_start():
    bench = Bench().sending()
    events = bench.hear("CAREV,030300,INIT,")
    assert kinds(events) == ["ModemLost", "TransmitFailed"]
    assert bench.written() == []
    bench.hear("CAREV,030300,AUV,2.0.27087")
    assert bench.written() == ["CCCFG,SRC,3"]
    assert bench.modem.version == "2.0.27087"
    assert bench.modem.counts["reboots"] == 1


def test_a_reboot_whose_second_line_is_lost_is_configured_after_a_wait():
    bench = Bench().configure()
    bench.hear("CAREV,030300,INIT,")
    bench.wait(2.1)
    assert bench.written() == ["CCCFG,SRC,3"]


def test_a_reboot_without_report_is_detected_by_the_address():
    bench = Bench(clock_period_s=5.0).configure()
    bench.wait(5.1)
    assert "CCCFQ,SRC" in bench.written()
    (lost,) = bench.hear("CACFG,SRC,0")
    assert "address is 0" in lost.reason
    assert bench.written() == ["CCCFG,SRC,3"]


def test_a_revision_without_init_is_not_a_reboot():
    bench = Bench().configure()
    assert bench.hear("CAREV,030300,AUV,2.0.27087") == []
    assert bench.modem.state is State.IDLE


# ------------------------------------------------------------------ the table, and the rest


def test_a_transition_that_is_not_in_the_table_raises():
    with pytest.raises(RuntimeError, match="no transition from CLOSED by SEND"):
        Session(config(), 3).move(Cause.SEND)


def test_every_message_has_a_handler():
    read = set(MESSAGES.values())
    assert read == set(Micromodem(config(), 3).handlers)


def test_bad_fields_are_reported_and_survived():
    bench = Bench().configure()
    (problem,) = bench.hear("CARXD,2,0,0,1,XYZ")
    assert "CARXD" in problem.text
    assert kinds(bench.hear(CYCLE, FRAME, statistics())) == ["PacketReceived"]


@pytest.mark.parametrize("address", [0, 128, -1])
def test_address_out_of_range(address):
    with pytest.raises(ValueError, match=f"modem address {address} is not from 1 to 127"):
        Micromodem(config(), address)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"kind": "micromodem"}, "port"),
        ({"rate": 2}, "rate"),
        ({"backoff_min_s": 5.0, "backoff_max_s": 1.0}, "backoff_max_s"),
        ({"bauds": 1}, "did you mean 'baud'"),
    ],
)
def test_settings_that_cannot_work_are_refused_by_name(values, words):
    with pytest.raises(ParameterError, match=words):
        from_mapping(ModemConfig, values, "mission.yaml: modem")


def test_frames_are_cut_to_the_size_of_a_packet():
    assert PAYLOAD_BYTES == PACKET_BYTES  # the driver does not import the packet
