"""auv_lse modem-check with emulated modems: alone, and two in a bucket."""

from __future__ import annotations

import re
import threading
import time

import pytest
from verb_main import verb_main

from auv_lse_comms.modem_check_command import TEST_PACKET
from auv_lse_sim.emulated import modem_bench
from auv_lse_sim.emulated.host_ports import PtyPort, TcpServerPort

main = verb_main("modem-check")


@pytest.fixture
def bucket(tmp_path):
    """Two modems with factory settings, on a pty and on TCP; their addresses, and the rack after `stop`."""
    ports = {1: PtyPort(tmp_path / "modem1"), 2: TcpServerPort()}
    over, racks = threading.Event(), []
    bench = threading.Thread(
        daemon=True, target=lambda: racks.append(modem_bench.run(ports, 0.01, time.time, lambda: not over.is_set()))
    )
    addresses = [port.port for port in ports.values()]
    bench.start()

    def stop():
        over.set()
        bench.join(10.0)
        return racks[0]

    yield addresses, stop
    stop()


def test_a_factory_modem_is_only_asked(bucket, capsys):
    (port, _), stop = bucket
    assert main([port, "--vehicle", "1"]) == 0
    printed = capsys.readouterr().out
    assert "note    SRC = 0, but must be 1: the driver sets it; by hand: $CCCFG,SRC,1*" in printed
    assert re.search(r"ok      clock: (\+0\.0|[+-]0\.[1-9]) s from this computer's", printed)
    assert "note    BND = 1: must be equal on all modems" in printed
    assert printed.endswith("nothing is missing\n")
    rack = stop()
    assert rack.modems[1].settings["SRC"] == "0"
    assert rack.modems[1].counts["boots"] == 1
    assert not rack.transmitted


def test_two_modems_in_a_bucket(bucket, tmp_path, capsys):
    (first, second), stop = bucket
    mission = tmp_path / "mission.yaml"
    mission.write_text("/**:\n  ros__parameters:\n    modem: {rate: 5, port: /dev/absent}\n")
    assert main([second, "--vehicle", "2", "--configure", "--mission", str(mission)]) == 0
    printed = capsys.readouterr().out
    assert "ok      SRC = 2\n" in printed
    assert "ok      firmware: 2.0.27087\n" in printed
    assert "ok      the driver has configured the modem\n" in printed
    codes = []
    listener = threading.Thread(
        daemon=True,
        target=lambda: codes.append(
            main([second, "--vehicle", "2", "--mission", str(mission), "--listen", "60", "--count", "1"])
        ),
    )
    listener.start()
    printed = ""
    until = time.monotonic() + 30.0
    while "listening for 60 s" not in printed:
        assert time.monotonic() < until, printed
        time.sleep(0.01)
        printed += capsys.readouterr().out
    code = main([first, "--mission", str(mission), "--ping", "2", "--send", "2", "--count", "1"])
    listener.join(30.0)
    printed += capsys.readouterr().out
    assert code == 0, printed
    assert "ok      ping: modem 2 answered 1 of 1\n" in printed
    assert "ok      send: 1 of 1 packets of 252 bytes at rate 5, at most " in printed
    assert codes == [0], printed
    assert "heard: test packet of modem 1, rate 5, SNR 20.0 dB\n" in printed
    assert "listen: 1 packet, 1 ping heard" in printed
    assert len(TEST_PACKET) == 252
    rack = stop()
    assert rack.transmitted == {1: 2, 2: 1}  # ping and packet; the answer to the ping


def test_a_modem_that_does_not_answer_pings_is_missing(bucket, capsys, monkeypatch):
    monkeypatch.setattr("auv_lse_comms.micromodem.pinging.ANSWER_TIMEOUT_S", 0.2)
    (first, _), _ = bucket
    assert main([first, "--ping", "7", "--count", "1"]) == 1
    printed = capsys.readouterr().out
    assert "ping to modem 7 (1 of 1): no answer from modem 7\n" in printed
    assert "MISSING ping: modem 7 answered 0 of 1. Is it on, configured, in water?\n1 missing\n" in printed


def test_silence_and_absent_ports_are_missing(tmp_path, capsys):
    mission = tmp_path / "mission.yaml"
    mission.write_text("/**:\n  ros__parameters:\n    modem: {reply_timeout_s: 0.05}\n")
    silent = PtyPort()
    assert main([silent.port, "--mission", str(mission)]) == 1
    silent.close()
    printed = capsys.readouterr().out
    assert "MISSING no answer to $CCCFQ,SRC. Check power" in printed
    assert "trying 9600 Bd\n" in printed
    assert main([str(tmp_path / "absent")]) == 1
    assert "MISSING " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere"], "is not an address; write /dev/NAME"),
        (["/dev/x", "--vehicle", "0"], "--vehicle must be 1 to 127, not 0"),
        (["/dev/x", "--ping", "1"], "is --vehicle's own modem; choose another"),
        (["/dev/x", "--listen", "0"], "--listen must be more than 0 s, not 0"),
        (["/dev/x", "--set", "SRC=3"], "the driver sets SRC"),
        (["/dev/x", "--mission", "/absent.yaml"], "/absent.yaml"),
    ],
)
def test_a_wrong_command_line_is_refused(capsys, arguments, words):
    assert main(arguments) == 2
    assert words in capsys.readouterr().err
