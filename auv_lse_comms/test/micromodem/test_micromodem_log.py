import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_comms.micromodem.__main__ import main
from auv_lse_comms.micromodem.driver import Micromodem
from auv_lse_comms.micromodem.events import PacketReceived, TransmitDone, TransmitFailed
from auv_lse_comms.micromodem.log import (
    LogEntry,
    LogError,
    escape,
    format_entry,
    read_entries,
    replay_log,
    unescape,
)
from auv_lse_comms.micromodem.sentences.wire import Sentence

CONFIG = ModemConfig(kind="micromodem", port="/dev/null", clock_period_s=20.0)


def says(*texts: str) -> bytes:
    return b"".join(Sentence(*_parts(text)).encode() for text in texts)


def _parts(text):
    kind, *fields = text.split(",")
    return kind, tuple(fields)


def a_day_at_sea(modem) -> list:
    """Configuration, a packet out, noise, a packet in, a timeout, a lost port: by the driver's calls."""
    told = []

    def hear(now_s, data):
        modem.receive(now_s, data)
        told.extend(modem.events())
        return modem.outgoing()

    def until(start_s, end_s):
        for tenth in range(round((end_s - start_s) * 10)):
            modem.poll(start_s + tenth / 10)
            told.extend(modem.events())
            modem.outgoing()

    modem.opened(1000.0)
    modem.receive(1000.0, says("CAREV,001640,AUV,2.0.27087"))
    said = modem.outgoing()
    for step in range(20):
        if not said.startswith(b"$CCCFG"):
            break
        answer = said.split(b"*")[0].replace(b"$CC", b"CA").decode()
        said = hear(1000.0 + step / 100, says(answer))
    hear(1000.5, says("CATMQ,1970-01-01T00:16:40Z,USER_CMD,RTC"))
    modem.send(1010.0, bytes(range(252)))
    modem.outgoing()
    hear(1010.1, says("CACYC,0,3,0,4,0,1", "CADRQ,001650,3,0,0,256,1"))
    hear(1010.2, says("CATXD,3,0,0,252", "CATXP,252")[:-7])  # the line comes in two parts
    hear(1010.3, says("CATXD,3,0,0,252", "CATXP,252")[-7:] + b"\xff\x00noise\\\r\n" + says("CATXF,252"))
    hear(1015.0, says("CACYC,0,2,0,4,0,1", "CARXD,2,0,0,1,AABB"))
    until(1015.0, 1045.0)  # its statistics never come, and the clock check is not answered
    modem.send(1046.0, b"late", 7)
    until(1046.0, 1050.0)
    modem.closed(1051.0, "unplugged")
    told.extend(modem.events())
    return told


def test_a_replay_writes_and_reports_the_same_again():
    log: list[LogEntry] = []
    told = a_day_at_sea(Micromodem(CONFIG, 3, lambda *entry: log.append(LogEntry(*entry))))
    assert {type(event) for event in told} >= {PacketReceived, TransmitDone, TransmitFailed}
    text = "".join(format_entry(entry) + "\n" for entry in log)
    again = replay_log(read_entries(io.StringIO(text)), CONFIG)
    assert [repr(event) for _, event in again.events] == [repr(event) for event in told]  # with NaN, as below
    assert again.written == again.logged
    assert again.written.startswith(b"$CCCFG,SRC,3*")
    assert again.modem.address == 3


def test_logging_does_not_change_what_the_driver_does():
    logged, silent = a_day_at_sea(Micromodem(CONFIG, 3, lambda *entry: None)), a_day_at_sea(Micromodem(CONFIG, 3))
    assert [repr(event) for event in logged] == [repr(event) for event in silent]


def test_a_log_shows_that_the_driver_has_changed():
    log: list[LogEntry] = []
    a_day_at_sea(Micromodem(CONFIG, 3, lambda *entry: log.append(LogEntry(*entry))))
    other = ModemConfig(kind="micromodem", port="/dev/null", rate=5)
    again = replay_log(log, other)
    assert again.written != again.logged


@given(st.binary(max_size=200))
def test_any_bytes_survive_the_log(data):
    line = format_entry(LogEntry(1.5, "<", data))
    assert line.isascii()
    assert line.isprintable()
    assert list(read_entries([line + "\n"])) == [LogEntry(1.5, "<", data)]


def test_format_by_hand():
    assert format_entry(LogEntry(1575255779.25, "<", b"$CATXF,252*51\r\n")) == r"1575255779.250000 < $CATXF,252*51\r\n"
    assert escape(b"\x00\\\xff") == r"\x00\\\xff"
    assert unescape(r"\x00\\\xff") == b"\x00\\\xff"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nonsense\n", "log.txt:1: 'nonsense"),
        ("1.000000 ? x\n", "is not '<seconds>"),
        ("1.000000 < a\\qb\n", "escape"),
    ],
)
def test_a_bad_line_is_reported(text, words):
    with pytest.raises(LogError, match=words.replace("\\", "\\\\").replace("?", "\\?")):
        list(read_entries([text], "log.txt"))


def test_a_last_line_cut_short_by_a_crash_is_left_out():
    assert list(read_entries(["1.000000 < a\n", "2.000000 < $CAT"])) == [LogEntry(1.0, "<", b"a")]


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ([], "no entries to replay"),
        ([LogEntry(1.0, "=", b"opened")], "no '= address N' before the first entry"),
        ([LogEntry(1.0, "=", b"address 3"), LogEntry(1.0, "=", b"jumped")], "jumped"),
    ],
)
def test_a_recording_that_cannot_be_recomputed_is_refused(entries, words):
    with pytest.raises(LogError, match=words):
        replay_log(entries, CONFIG)


def test_the_command_line_prints_the_events_and_fails_when_the_driver_differs(tmp_path, capsys):
    log: list[LogEntry] = []
    a_day_at_sea(Micromodem(CONFIG, 3, lambda *entry: log.append(LogEntry(*entry))))
    file = tmp_path / "modem.log"
    file.write_text("".join(format_entry(entry) + "\n" for entry in log))
    assert main([str(file), "--set", "clock_period_s=20.0"]) == 0
    said = capsys.readouterr().out
    assert "ModemReady" in said
    assert "PacketReceived" in said
    assert "sentences" in said
    assert main([str(file), "--set", "rate=5"]) == 1
    assert main([str(file), "--set", "rates=5"]) == 2
    assert "did you mean 'rate'" in capsys.readouterr().err
    file.write_text("nonsense\n")
    assert main([str(file)]) == 2
    assert f"{file}:1" in capsys.readouterr().err
