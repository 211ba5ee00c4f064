"""Whatever a modem says, in whatever order, the driver neither fails nor loses count of its packets."""

from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_comms.micromodem.driver import Micromodem
from auv_lse_comms.micromodem.events import (
    PacketReceived,
    PingAnswered,
    PingFailed,
    TransmitDone,
    TransmitFailed,
    TransmitStarted,
)
from auv_lse_comms.micromodem.log import LogEntry, format_entry, read_entries, replay_log
from auv_lse_comms.micromodem.sentences.wire import Sentence
from auv_lse_comms.micromodem.state import TRANSITIONS, Cause, State

CONFIG = ModemConfig(kind="micromodem", port="/dev/x", clock_period_s=20.0)
ADDRESS = 3

address = st.sampled_from(["0", "2", "3", "9", "127"])
small = st.sampled_from(["0", "1", "2", "3", "5"])
time_of_day = st.just("030259")
iso = st.sampled_from(["1970-01-01T00:16:40Z", "2030-01-01T00:00:00Z", "never"])
frame = st.sampled_from(["", "00", "AABB", "FF" * 252, "00" * 256])
REST = ",19700101001640.5000,14,1,1,1,1,0,0,0,0,0,4,2,0,0,3,1,0,1,1.0,1.0,1.0,1.0,0,0.0"
statistics = st.sampled_from(["0", "1", "2", "7"]).map(lambda mode: sentence(f"CACST,6,{mode}{REST}"))


def sentence(text):
    kind, *fields = text.split(",")
    return Sentence(kind, tuple(fields)).encode()


def any_sentence(kind, *fields):
    return st.tuples(*fields).map(lambda values: Sentence(kind, values).encode())


modem_sends = st.one_of(
    any_sentence("CAREV", time_of_day, st.sampled_from(["INIT", "AUV", "COPROC"]), st.just("2.0.27087")),
    any_sentence("CACFG", st.sampled_from(["SRC", "CST", "RXP", "REV", "XST", "MFD", "ASD", "SNV"]), small),
    any_sentence("CATMQ", iso, st.just("RTC"), st.just("RTC")),
    any_sentence("CATMS", small, iso),
    any_sentence("CACYC", st.just("0"), address, address, small, st.just("0"), small),
    any_sentence("CADRQ", time_of_day, address, address, st.just("0"), st.sampled_from(["0", "64", "256"]), small),
    any_sentence("CATXD", address, address, st.just("0"), st.sampled_from(["0", "4", "252"])),
    any_sentence("CATXP", st.just("252")),
    any_sentence("CATXF", st.just("252")),
    any_sentence(
        "CAXST", st.just("6"), st.just("19700101"), st.just("001640.0"), st.just("0"), st.sampled_from(["4", "0"])
    ),
    any_sentence("CAMPC", address, address),
    any_sentence("CAMPA", address, address),
    any_sentence("CAMPR", address, address, st.sampled_from(["0.25", "", "1"])),
    any_sentence("CARXP", small),
    any_sentence("CARXD", address, address, st.just("0"), small, frame),
    statistics,
    any_sentence("CAMSG", st.sampled_from(["BAD_CRC", "PACKET_TIMEOUT", "Packet Timeout", "WHATEVER"]), small),
    any_sentence("CAERR", time_of_day, st.sampled_from(["NMEA", "DATA_TIMEOUT", "PSK", "NEW"]), small, st.just("text")),
    st.binary(max_size=20),
)
#: "answer": what a modem in order would say to what the driver last wrote.
chunk = st.one_of(
    modem_sends.map(lambda data: [data]),
    st.just(["answer"]),
    st.just(["send"]),
    st.just(["send", "answer"]),
    st.just(["send", "answer", sentence("CATXP,252")]),
    st.just(["send", "answer", "answer"]),
    st.just(["ping"]),
    st.just(["ping", "answer"]),
    st.just([sentence("CACYC,0,2,0,4,0,1"), sentence("CARXD,2,0,0,1,AABB")]),
    st.just([sentence("CARXP,1"), sentence("CARXD,2,0,0,1,AABB"), sentence(f"CACST,6,0{REST}")]),
    st.just(["close"] + ["answer"] * 13),
    st.floats(-5.0, 30.0).map(lambda seconds: [("wait", seconds)]),
)
stories = st.lists(chunk, max_size=30).map(lambda chunks: [step for steps in chunks for step in steps])


def in_order(line: str) -> list[bytes]:
    """A modem's answer to one line of the driver."""
    kind, *fields = line.split("*")[0].lstrip("$").split(",")
    if kind == "CCCFG":
        return [Sentence("CACFG", tuple(fields)).encode()]
    if kind == "CCTMQ":
        return [Sentence("CATMQ", ("1970-01-01T00:16:40Z", "USER_CMD", "RTC")).encode()]
    if kind == "CCTMS":
        return [Sentence("CATMS", ("0", fields[0])).encode()]
    if kind == "CCCYC":
        asked = ("030259", fields[1], fields[2], "0", "256", "1")
        return [Sentence("CACYC", tuple(fields)).encode(), Sentence("CADRQ", asked).encode()]
    if kind == "CCMPC":
        return [Sentence("CAMPC", tuple(fields)).encode(), Sentence("CAMPR", ("2", fields[0], "0.25")).encode()]
    if kind == "CCTXD":
        return [Sentence("CATXP", ("252",)).encode(), Sentence("CATXF", ("252",)).encode()]
    return []


def run(steps, modem, moved):
    now_s, told, sent, pinged, lines = 1000.0, [], [], [], []

    def take():
        nonlocal lines
        told.extend(modem.events())
        lines += modem.outgoing().decode().split("\r\n")[:-1]
        moved.add(modem.state)

    modem.opened(now_s)
    modem.receive(now_s, sentence("CAREV,001640,AUV,2.0.27087"))
    take()
    for action in [*["answer"] * 13, *steps]:  # configured first: that takes thirteen answers in order
        if action == "answer":
            lines, asked = [], lines
            for line in asked:
                for said_back in in_order(line):
                    modem.receive(now_s, said_back)
                    take()
        elif action == "send":
            sent.append(modem.send(now_s, bytes(range(252))))
        elif action == "ping":
            pinged.append(modem.ping(now_s, 2))
        elif action == "close":
            modem.closed(now_s, "pulled")
            lines = []
            modem.opened(now_s)
        elif isinstance(action, tuple):
            now_s = max(0.0, now_s + action[1])
            modem.poll(now_s)
        else:
            modem.receive(now_s, action)
        take()
    for _ in range(100):  # and then silence
        now_s += 0.5
        modem.poll(now_s)
        take()
    answers = [e.number for e in told if isinstance(e, PingAnswered | PingFailed)]
    assert Counter(answers) == Counter(pinged)
    return told, sent


@settings(max_examples=400)
@given(stories)
def test_any_sequence_of_events_ends_with_one_outcome_per_packet(steps):
    modem = Micromodem(CONFIG, ADDRESS)
    told, sent = run(steps, modem, set())
    started = Counter(e.number for e in told if isinstance(e, TransmitStarted))
    ended = Counter(e.number for e in told if isinstance(e, TransmitDone | TransmitFailed))
    done = {e.number for e in told if isinstance(e, TransmitDone)}
    assert ended == Counter(sent)
    assert set(started.values()) <= {1}
    assert done <= set(started)
    for event in told:
        if isinstance(event, PacketReceived):
            assert event.destination in (0, ADDRESS)


@settings(max_examples=60)
@given(stories)
def test_any_sequence_of_events_replays_from_its_log(steps):
    log = []
    told, _ = run(steps, Micromodem(CONFIG, ADDRESS, lambda *entry: log.append(LogEntry(*entry))), set())
    text = [format_entry(entry) + "\n" for entry in log]
    again = replay_log(read_entries(text), CONFIG)
    assert [repr(event) for _, event in again.events] == [repr(event) for event in told]  # events with NaN
    assert again.written == again.logged


def test_random_sequences_of_events_reach_every_state():
    """The stories above are worth something: a few of them together go through all states."""
    moved: set[State] = set()
    few = [
        ["send", "answer"],
        ["send", sentence("CACYC,0,3,0,4,0,1")],
        ["answer"] * 13 + ["send", sentence("CADRQ,030259,3,0,0,256,1")] + [sentence("CATXP,252")],
        ["close"],
        ["ping"],
    ]
    for story in few:
        run(story, Micromodem(CONFIG, ADDRESS), moved)
    assert moved >= set(State) - {State.CLOSED}


@pytest.mark.parametrize("cause", list(Cause))
def test_every_cause_moves_something(cause):
    assert any(key[1] is cause for key in TRANSITIONS)
