"""Messages of the Micromodem: round trips, bad fields, older firmware."""

import contextlib
import dataclasses
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_lse_common.vocabulary.modem_rates import packet_duration_s
from auv_lse_comms.micromodem.sentences.fields import SentenceError
from auv_lse_comms.micromodem.sentences.messages import MESSAGES, read_message
from auv_lse_comms.micromodem.sentences.ping_messages import PingEcho, PingHeard, PingReply
from auv_lse_comms.micromodem.sentences.receive_messages import (
    MODE_PACKET_TIMEOUT,
    Detection,
    FrameHeard,
    ReceptionStart,
    ReceptionStatistics,
    clock_is_synchronous,
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
from auv_lse_comms.micromodem.sentences.wire import Sentence, SentenceReader


def one(data: bytes) -> Sentence:
    (sentence,) = SentenceReader().feed(data)
    return sentence


EXAMPLES = [
    Revision(time="030259", ident="AUV", version="2.0.27087"),
    Setting(name="SRC", value="3"),
    ClockSet(timed_out=False, utc_s=1575255779.0),
    ClockTime(utc_s=1575255779.0, resolution_s=1.0, source="USER_CMD", pps="EXT"),
    Cycle(source=1, destination=0, rate=4, ack=False, frames=1),
    DataRequest(time="030259", source=1, destination=0, ack=False, max_bytes=256, frame=1),
    FrameTaken(source=1, destination=0, ack=False, count=252),
    TransmitStart(count=252),
    TransmitEnd(count=252),
    TransmitStatistics(
        utc_s=1575255779.5,
        clock=14,
        mode=0,
        rate=4,
        source=1,
        destination=0,
        frames_expected=1,
        frames_sent=1,
        count=252,
    ),
    PingEcho(source=1, destination=2),
    PingHeard(source=1, destination=2),
    PingReply(source=2, destination=1, travel_s=0.4567),
    ReceptionStart(kind=1),
    Detection(peak=300, power_db=120, ratio_db=30, spl_db=110),
    FrameHeard(source=2, destination=0, ack=False, frame=1, data=bytes(range(252))),
    ReceptionStatistics(
        mode=0,
        utc_s=1575255779.1234,
        clock=14,
        rate=4,
        source=2,
        destination=0,
        frames=1,
        snr_in_db=12.3,
    ),
    Notice(kind="BAD_CRC", detail="1"),
    ErrorReport(time="030259", module="DATA_TIMEOUT", number=1, detail=""),
]


@pytest.mark.parametrize("message", EXAMPLES, ids=lambda m: type(m).__name__)
def test_messages_survive_the_wire(message):
    again = read_message(one(message.sentence().encode()))
    if isinstance(message, ReceptionStatistics):
        assert math.isclose(again.utc_s, message.utc_s, abs_tol=1e-4)
        assert dataclasses.replace(again, utc_s=message.utc_s) == message
    else:
        assert again == message


def test_every_message_the_driver_understands_is_covered_above():
    assert {m.sentence().type for m in EXAMPLES} == set(MESSAGES)


def test_statistics_of_older_firmware_have_no_version_and_no_date():
    fields = "0,030259.1234,0,00300,00120,00030,00110,0,0,0,0,0,4,2,0,0,3,1,0,12,12.3,10.0,9.9,-10.5,0,0.2"
    statistics = read_message(Sentence("CACST", tuple(fields.split(","))))
    assert (statistics.rate, statistics.source, statistics.frames, statistics.snr_in_db) == (4, 2, 1, 12.3)
    assert math.isnan(statistics.utc_s)


def test_statistics_of_a_packet_timeout_need_no_more_than_mode_and_time():
    statistics = read_message(Sentence("CACST", ("6", "2", "20191202030259.1234")))
    assert statistics.mode == MODE_PACKET_TIMEOUT
    assert math.isclose(statistics.utc_s, 1575255779.1234, abs_tol=1e-5)


def test_statistics_may_hold_decimals_and_leave_fields_empty():
    fields = "6,0,20191202030259.1234,,300.5,,,110.0,0,0,0,0,0,4,2.0,,,3,1,0,12.4,,10.0,9.9,,0,-0.2"
    statistics = read_message(Sentence("CACST", tuple(fields.split(","))))
    assert (statistics.rate, statistics.source, statistics.destination, statistics.frames) == (4, 2, -1, 1)
    assert math.isnan(statistics.snr_in_db)


@pytest.mark.parametrize(
    ("kind", "fields", "words"),
    [
        ("CARXD", ("2", "0", "0", "1", "0G"), "data"),
        ("CARXD", ("2", "0", "0", "1", "000"), "data"),
        ("CARXD", ("2", "0", "0"), "frame"),
        ("CARXD", ("-1", "0", "0", "1", "00"), "src"),
        ("CARXD", ("200", "0", "0", "1", "00"), "is 200, outside 0 to 127"),
        ("CADRQ", ("030259", "1", "0", "0", "1_0", "1"), "nbytes"),
        ("CACYC", ("0", "1", "0", "9", "0", "1"), "rate"),
        ("CATMQ", ("yesterday", "NONE", "NONE"), "not a time such as"),
        ("CATMQ", ("2019-13-02T03:02:59Z", "NONE", "NONE"), "not a time such as"),
        ("CACST", ("6", "0", "x", "nan"), "toa_mode"),
        ("CATXP", ("９",), "integer"),  # a Unicode digit is no digit here
    ],
)
def test_bad_fields_are_refused_by_name(kind, fields, words):
    with pytest.raises(SentenceError, match=words) as error:
        read_message(Sentence(kind, fields))
    assert f"${kind}" in str(error.value)


@settings(max_examples=500)
@given(st.sampled_from(sorted(MESSAGES)), st.lists(st.text(max_size=12), max_size=35))
def test_only_sentence_error_escapes_from_any_fields(kind, fields):
    with contextlib.suppress(SentenceError):
        read_message(Sentence(kind, tuple(fields)))


def test_clock_status_bits():
    assert clock_is_synchronous(2 | 3 << 2)
    assert clock_is_synchronous(3 | 4 << 2)
    assert not clock_is_synchronous(2 | 1 << 2)  # held by its own RTC
    assert not clock_is_synchronous(1 | 3 << 2)  # never set


def test_duration_of_the_usual_packet_is_about_two_seconds():
    assert packet_duration_s(4, 252) == pytest.approx(0.45 + 252 * 8 / 1300)
    assert 1.9 < packet_duration_s(4, 252) < 2.1
