import signal
import subprocess
import sys
import time

from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_comms.micromodem.events import PacketReceived
from auv_lse_comms.micromodem.port import ModemPort
from auv_lse_comms.micromodem.state import State
from auv_lse_sim.emulated import modem_bench
from auv_lse_sim.emulated.host_ports import PtyPort


def test_two_drivers_talk_over_the_desk_and_ctrl_c_takes_it_away(tmp_path):
    command = [sys.executable, "-m", "auv_lse_sim.emulated.modem_bench", "--folder", str(tmp_path), "--delay", "0.05"]
    environment = {"PYTHONPATH": ":".join(sys.path)}
    bench = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        assert bench.stdout.readline() == f"modem 1: {tmp_path}/modem1\n"
        assert bench.stdout.readline() == f"modem 2: {tmp_path}/modem2\n"
        ports = [ModemPort(ModemConfig(kind="micromodem", port=f"{tmp_path}/modem{v}"), v) for v in (1, 2)]
        until = time.monotonic() + 20.0
        events, asked = [], False
        while not any(isinstance(event, PacketReceived) for event in events):
            assert time.monotonic() < until
            for port in ports:
                events += port.step(time.time(), time.monotonic())
            if not asked and all(port.modem.state is State.IDLE for port in ports):
                asked = True
                ports[0].send(time.time(), bytes(range(252)), 0)
            time.sleep(0.005)
        (packet,) = [event for event in events if isinstance(event, PacketReceived)]
        assert (packet.source, packet.payload) == (1, bytes(range(252)))
        for port in ports:
            port.close(time.time(), time.monotonic())
        bench.send_signal(signal.SIGINT)
        assert bench.wait(10.0) == 0
        assert "packets sent 1, received 1" in bench.stdout.read()
        assert list(tmp_path.iterdir()) == []
    finally:
        bench.kill()
        bench.wait()
        bench.stdout.close()


def test_a_port_in_use_is_named(capsys):
    from auv_lse_sim.emulated.host_ports import TcpServerPort

    taken = TcpServerPort()
    number = int(taken.port.rsplit(":", 1)[1])
    assert modem_bench.main(["--tcp", str(number)]) == 2
    assert "port of modem 1 cannot be opened" in capsys.readouterr().err
    taken.close()


def test_it_ends_on_request():
    left = iter((True, True, False))
    rack = modem_bench.run({1: PtyPort()}, 1.0, lambda: 5.0, lambda: next(left))
    assert rack.modems[1].counts["boots"] == 1
