"""Emulated modems and drivers on ptys and on TCP."""

import os
import random
import stat
import time

import pytest

from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_comms.micromodem.events import (
    ModemLost,
    PacketReceived,
)
from auv_lse_comms.micromodem.port import ModemPort
from auv_lse_comms.micromodem.state import State
from auv_lse_sim.emulated.host_ports import MAX_UNREAD_BYTES, PtyPort, TcpServerPort
from auv_lse_sim.emulated.modem_packets import HeardPacket
from auv_lse_sim.emulated.modem_rack import ModemRack, perfect_water

NOW_S = 5000.0
PAYLOAD = bytes(range(252))


def serve_until(condition, rack, ports, now_s=NOW_S, patience_s=10.0):
    """Carries bytes over the real ports, with simulated time standing still, until `condition`."""
    events = []
    until = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < until, "did not happen in time"
        rack.serve(now_s)
        for port in ports:
            events += port.step(now_s, time.monotonic())
        time.sleep(0.0005)
    return events


def host_ports(kind, vehicles, folder):
    if kind == "tcp":
        return {v: TcpServerPort() for v in vehicles}
    return {v: PtyPort(folder / "modems" / f"auv{v}") for v in vehicles}


@pytest.mark.parametrize("kind", ["pty", "tcp"])
def test_a_team_talks_through_real_ports_while_simulated_time_stands_still(kind, tmp_path):
    team = (1, 2, 3)
    transmit, water = perfect_water(lambda: rack, delay_s=0.5)
    rack = ModemRack(host_ports(kind, team, tmp_path), transmit, NOW_S)
    try:
        configs = {v: ModemConfig(kind="micromodem", port=rack.ports[v]) for v in team}
        ports = [ModemPort(configs[v], v) for v in team]
        serve_until(lambda: all(p.modem.state is State.IDLE for p in ports), rack, ports)
        assert [m.address for m in rack.modems.values()] == [1, 2, 3]
        now_s = NOW_S
        heard = []
        for slot, (v, port) in enumerate([*zip(team, ports, strict=True)] * 2):
            now_s = NOW_S + 10.0 * (slot + 1)
            payload = random.Random(slot).randbytes(252)
            port.send(now_s, payload, 0)
            serve_until(lambda slot=slot: sum(rack.transmitted.values()) > slot, rack, ports, now_s)
            rack.poll(now_s + 3.0)
            water(now_s + 3.0)
            want = len(heard) + 2
            while len(heard) < want:
                events = serve_until(lambda: True, rack, ports, now_s + 3.0)
                for p in ports:
                    events += [(p.modem.address, e) for e in p.step(now_s + 3.0, time.monotonic())]
                heard += [e for e in events if isinstance(e, tuple) and isinstance(e[1], PacketReceived)]
            assert {address for address, _ in heard[-2:]} == set(team) - {v}
            assert all(e.payload == payload and e.source == v for _, e in heard[-2:])
            serve_until(lambda: all(p.modem.state is State.IDLE for p in ports), rack, ports, now_s + 3.0)
        assert rack.delivered == {1: 4, 2: 4, 3: 4}
        for port in ports:
            port.close(now_s, time.monotonic())
    finally:
        rack.close()


@pytest.mark.parametrize("kind", ["pty", "tcp"])
def test_a_port_that_goes_away_and_comes_back_is_found_again(kind, tmp_path):
    first = host_ports(kind, (1,), tmp_path)[1]
    position = first.port
    rack = ModemRack({1: first}, lambda v, t: None, NOW_S)
    config = ModemConfig(kind="micromodem", port=position, backoff_min_s=0.01, backoff_max_s=0.05)
    port = ModemPort(config, 1)
    serve_until(lambda: port.modem.state is State.IDLE, rack, [port])
    rack.close()
    events = []
    until = time.monotonic() + 10.0
    while port.modem.state is not State.CLOSED:
        assert time.monotonic() < until
        events += port.step(NOW_S, time.monotonic())
    assert any(isinstance(e, ModemLost) for e in events)
    for _ in range(50):
        port.step(NOW_S, time.monotonic())
        time.sleep(0.002)
    assert port.connection.failures > 1
    again = PtyPort(tmp_path / "modems" / "auv1") if kind == "pty" else TcpServerPort(int(position.rsplit(":", 1)[1]))
    rack = ModemRack({1: again}, lambda v, t: None, NOW_S)
    serve_until(lambda: port.modem.state is State.IDLE, rack, [port])
    port.close(NOW_S, time.monotonic())
    rack.close()


def test_a_line_log_of_a_real_port_replays(tmp_path):
    from auv_lse_comms.micromodem.log import read_entries, replay_log

    log = tmp_path / "logs" / "modem.log"
    rack = ModemRack({1: PtyPort()}, lambda v, t: None, NOW_S)
    config = ModemConfig(kind="micromodem", port=rack.ports[1], log_file=str(log))
    port = ModemPort(config, 1)
    serve_until(lambda: port.modem.state is State.IDLE, rack, [port])
    port.send(NOW_S + 1.0, PAYLOAD, 0)
    events = serve_until(lambda: rack.transmitted[1] == 1, rack, [port], NOW_S + 1.0)
    rack.arrive(NOW_S, 1, HeardPacket(start_s=NOW_S, source=2, destination=0, payload=PAYLOAD, snr_db=3.0))
    events += serve_until(lambda: port.modem.counts["received"] == 1, rack, [port], NOW_S + 1.0)
    events += port.close(NOW_S + 2.0, time.monotonic())
    rack.close()
    with log.open() as lines:
        again = replay_log(read_entries(lines), config)
    assert again.written == again.logged
    received = [repr(e) for e in events if isinstance(e, PacketReceived)]  # with NaN
    assert [repr(e) for _, e in again.events if isinstance(e, PacketReceived)] == received


def test_a_pty_is_a_serial_device_and_its_link_goes_with_it(tmp_path):
    link = tmp_path / "auv1"
    shell = PtyPort(link)
    assert stat.S_ISCHR(os.stat(shell.port).st_mode)
    assert shell.port == str(link)
    other = PtyPort(link)  # takes the place of the first
    shell.close()
    assert link.exists()
    other.close()
    other.close()
    assert not link.is_symlink()


def test_a_host_that_does_not_read_loses_old_lines_not_the_simulator():
    shell = PtyPort()
    for _ in range(400):
        shell.write(b"$CATXF,252*51\r\n" * 100)
    assert shell._unread.dropped > 0
    assert len(shell._unread._data) <= MAX_UNREAD_BYTES
    shell.close()


def test_a_new_tcp_host_takes_the_position_of_the_old():
    rack = ModemRack({1: TcpServerPort()}, lambda v, t: None, NOW_S)
    ports = [ModemPort(ModemConfig(kind="micromodem", port=rack.ports[1]), 1) for _ in range(2)]
    serve_until(lambda: ports[0].modem.state is State.IDLE, rack, ports[:1])
    serve_until(lambda: ports[1].modem.state is State.IDLE, rack, ports[1:])
    until = time.monotonic() + 5.0
    while ports[0].modem.state is not State.CLOSED:
        assert time.monotonic() < until
        ports[0].connection.read(time.monotonic())
        if ports[0].connection.transport is None:
            break
    for port in ports:
        port.close(NOW_S, time.monotonic())
    rack.close()


class EndlessPort:
    """A host that never stops writing."""

    port, reads = "none", 0

    def filenos(self):
        return ()

    def read(self):
        self.reads += 1
        assert self.reads < 100, "serve does not return while a host writes"
        return b"$CCCFQ,SRC*36\r\n" * 100

    def write(self, data):
        pass

    def close(self):
        pass


def test_a_host_that_never_stops_writing_blocks_no_other_modem():
    rack = ModemRack({1: EndlessPort(), 2: EndlessPort()}, lambda vehicle, packet: None, NOW_S)
    assert rack.serve(NOW_S) > 0
    assert [rack._ports[v].reads for v in (1, 2)] == [1, 1]
    rack.close()
