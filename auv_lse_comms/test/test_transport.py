import itertools
import os
import pty
import socket
import sys
import threading
import time
from collections import Counter

import pytest

from auv_lse_comms.transport import (
    Address,
    AddressError,
    Connection,
    PortWatcher,
    TransportError,
    UdpPort,
    open_transport,
    read_address,
)

BY_PATH = "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0"


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("/dev/ttyUSB0", Address(kind="serial", position="/dev/ttyUSB0", number=19200)),
        ("serial:///dev/ttyACM0:115200", Address(kind="serial", position="/dev/ttyACM0", number=115200)),
        *(
            (f"{prefix}{BY_PATH}{suffix}", Address(kind="serial", position=BY_PATH, number=number))
            for prefix in ("", "serial://")
            for suffix, number in (("", 19200), (":57600", 57600))
        ),
        ("/dev/ttyS0:0115200", Address(kind="serial", position="/dev/ttyS0:0115200", number=19200)),
        ("/tmp/lake é 1/modem", Address(kind="serial", position="/tmp/lake é 1/modem", number=19200)),
        ("tcp://127.0.0.1:4001", Address(kind="tcp", position="127.0.0.1", number=4001)),
        ("udpin://0.0.0.0:14550", Address(kind="udpin", position="0.0.0.0", number=14550)),
        ("udpout://[::1]:14550", Address(kind="udpout", position="::1", number=14550)),
    ],
)
def test_addresses(text, address):
    assert read_address(text) == address


@pytest.mark.parametrize(
    "text", ["", "ttyUSB0", "tcp://host", "tcp://host:99999", "http://host:80", "/dev/tty USB", "/x:y:1200"]
)
def test_an_invalid_address_is_refused_with_the_allowed_forms(text):
    with pytest.raises(AddressError, match="is not an address; write /dev/NAME"):
        read_address(text)


def wait_for(condition, patience_s=5.0):
    until = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < until, "did not happen in time"
        time.sleep(0.002)


def gather(transport, count):
    data = b""

    def enough():
        nonlocal data
        data += transport.read()
        return len(data) >= count

    wait_for(enough)
    return data


def test_serial_port_both_ways_and_its_end():
    master, slave = pty.openpty()
    port = open_transport(read_address(os.ttyname(slave)))
    assert port.read() == b""
    everything = bytes(range(256))
    port.write(everything)
    got = b""
    while len(got) < 256:
        got += os.read(master, 256)
    assert got == everything  # no echo, no line editing, no CR and LF changed
    os.write(master, everything)
    assert gather(port, 256) == everything
    with pytest.raises(TransportError, match="cannot be opened"):
        open_transport(read_address(os.ttyname(slave)))  # one owner at a time
    os.close(slave)
    os.close(master)
    with pytest.raises(TransportError, match="/dev/pts"):
        wait_for(lambda: port.read() and False)
    port.close()
    port.close()


@pytest.mark.parametrize("position", ["/dev/does-not-exist", "/dev/null"])
def test_what_is_no_serial_device_is_named(position):
    with pytest.raises(TransportError, match=position):
        open_transport(read_address(position))


@pytest.mark.parametrize("address", ["/dev/does-not-exist", "/dev/null", "udpin://127.0.0.1:{}", "tcp://127.0.0.1:1"])
def test_an_error_names_its_port_once_and_the_cure(address):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        address = address.format(other.getsockname()[1])
        with pytest.raises(TransportError) as found:
            open_transport(read_address(address))
    text = str(found.value)
    assert text.startswith(f"{address}: cannot "), text
    assert text.count(address) == 1, text
    assert "Errno" not in text
    if address != "/dev/null":  # no cure for what is no serial device
        assert any(cure in text for cure in ("connect the device", "another program listens", "nothing listens"))


def test_rts_and_dtr_of_a_modem_are_low_before_its_port_is_opened(monkeypatch):
    serial = pytest.importorskip("serial", reason="pyserial is not installed")
    levels = []
    opened = serial.Serial.open
    monkeypatch.setattr(serial.Serial, "open", lambda port: (levels.append((port.rts, port.dtr)), opened(port)))
    for lines_low in (True, False):
        _, slave = pty.openpty()
        open_transport(read_address(os.ttyname(slave)), lines_low=lines_low).close()
    assert levels == [(False, False), (True, True)]


def test_a_missing_pyserial_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "serial", None)  # makes its import fail
    with pytest.raises(TransportError, match=r"/dev/ttyUSB0 cannot be opened: .* pyserial is not installed"):
        open_transport(read_address("/dev/ttyUSB0"))


def test_tcp_both_ways_and_its_end():
    with socket.create_server(("127.0.0.1", 0)) as server:
        number = server.getsockname()[1]
        port = open_transport(read_address(f"tcp://127.0.0.1:{number}"))
        peer, _ = server.accept()
        assert port.read() == b""
        port.write(b"out")
        assert peer.recv(10) == b"out"
        peer.sendall(b"in")
        assert gather(port, 2) == b"in"
        peer.close()
        with pytest.raises(TransportError, match=f"tcp://127.0.0.1:{number}: the other side has closed"):
            wait_for(lambda: port.read() and False)
        port.close()
    with pytest.raises(TransportError, match="cannot connect"):
        open_transport(read_address(f"tcp://127.0.0.1:{number}"))


@pytest.mark.parametrize("kind", ["tcp", "udpin", "udpout"])
def test_a_name_that_no_host_can_have_is_named(kind):
    host = "a" * 64
    with pytest.raises(TransportError, match=f"{kind}://{host}:1"):
        open_transport(read_address(f"{kind}://{host}:1"))


def test_udp_answers_the_last_speaker():
    a = UdpPort("udpin", "127.0.0.1", 0)
    b = UdpPort("udpout", "127.0.0.1", a.local_port)
    a.write(b"nobody has spoken: goes nowhere")
    assert b.read() == b""
    b.write(b"hello")
    assert gather(a, 5) == b"hello"
    a.write(b"one")
    a.write(b"two")
    assert gather(b, 6) == b"onetwo"
    a.close()
    b.write(b"into the void")
    b.write(b"and again")  # the refusal of the first must not be an error
    assert b.read() == b""
    b.close()


def test_a_udp_port_that_is_taken_is_named():
    a = UdpPort("udpin", "127.0.0.1", 0)
    with pytest.raises(TransportError, match=str(a.local_port)):
        UdpPort("udpin", "127.0.0.1", a.local_port)
    a.close()


class FakePort:
    def __init__(self):
        self.fails = False
        self.closed = False
        self.data = b""
        self.counts = Counter()

    def fileno(self):
        return -1

    def read(self):
        if self.fails:
            raise TransportError("fake: broken")
        data, self.data = self.data, b""
        return data

    def write(self, data):
        if self.fails:
            raise TransportError("fake: broken")

    def close(self):
        self.closed = True


def test_a_connection_retries_with_growing_waits():
    tried = []
    now = 0.0

    def refuse():
        tried.append(now)
        raise TransportError("fake: not there")

    connection = Connection(refuse, 0.5, 8.0)
    while now < 200.0:
        assert not connection.poll(now)
        now += 0.125
    waits = [b - a for a, b in itertools.pairwise(tried)]
    assert waits[:6] == [0.5, 1.0, 2.0, 4.0, 8.0, 8.0]
    assert set(waits[4:]) == {8.0}
    assert connection.problem == "fake: not there"


def test_received_bytes_reset_the_wait():
    ports = []

    def make():
        ports.append(FakePort())
        return ports[-1]

    connection = Connection(make, 0.5, 8.0)
    assert connection.poll(0.0)
    assert not connection.poll(0.0)  # it is open
    for number in range(4):  # opens, and breaks without a byte: the waits grow
        ports[-1].fails = True
        assert connection.read(100.0 * number) == b""
        assert ports[-1].closed
        assert connection.wait_s == 0.5 * 2**number
        assert connection.poll(100.0 * number + 50.0)
    ports[-1].data = b"x"
    assert connection.read(400.0) == b"x"
    ports[-1].fails = True
    connection.write(b"y", 400.0)
    assert connection.transport is None
    assert connection.wait_s == 0.5


def test_watcher_wakes_once_per_arrival_and_stops():
    a = UdpPort("udpin", "127.0.0.1", 0)
    b = UdpPort("udpout", "127.0.0.1", a.local_port)
    woken = threading.Semaphore(0)
    watcher = PortWatcher(a, woken.release)
    assert not woken.acquire(timeout=0.05)
    for _ in range(3):
        b.write(b"x")
        assert woken.acquire(timeout=5.0)
        assert not woken.acquire(timeout=0.02)  # it does not spin while the bytes wait to be read
        assert gather(a, 1) == b"x"
        watcher.handled()
    threads = threading.active_count()
    watcher.stop()
    watcher.stop()
    assert threading.active_count() == threads - 1
    a.close()
    b.close()


def test_a_watcher_stopped_between_its_bytes_and_its_wait_ends():
    a = UdpPort("udpin", "127.0.0.1", 0)
    b = UdpPort("udpout", "127.0.0.1", a.local_port)
    stopping = threading.Event()

    class LateClear(threading.Event):
        def set(self):
            super().set()
            stopping.set()

        def clear(self):  # select has returned; `stop` sets the event before it is cleared
            selected.set()
            assert stopping.wait(5.0)
            super().clear()

    selected = threading.Event()
    watcher = PortWatcher(a, lambda: None)
    watcher._handled = LateClear()
    b.write(b"x")
    assert selected.wait(5.0)
    stopper = threading.Thread(target=watcher.stop, daemon=True)
    stopper.start()
    stopper.join(5.0)
    assert not stopper.is_alive()
    a.close()
    b.close()


def test_only_an_expected_datagram_changes_the_peer_of_udpin():
    port = open_transport(
        Address(kind="udpin", position="127.0.0.1", number=0), lambda data: data.startswith(b"friend")
    )
    there = ("127.0.0.1", port.local_port)
    friend, stranger, moved = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3))
    try:
        for one in (friend, stranger, moved):
            one.settimeout(0.2)
        stranger.sendto(b"x", there)
        friend.sendto(b"friend 1", there)
        assert gather(port, 8) == b"friend 1"  # nothing of the stranger's gets in between
        stranger.sendto(b"y", there)
        friend.sendto(b"more", there)  # the peer may speak as it likes
        assert gather(port, 4) == b"more"
        port.write(b"answer")
        assert friend.recv(100) == b"answer"
        with pytest.raises(TimeoutError):
            stranger.recv(100)
        moved.sendto(b"friend 2", there)
        assert gather(port, 8) == b"friend 2"
        port.write(b"answer")
        assert moved.recv(100) == b"answer"
    finally:
        port.close()
        for one in (friend, stranger, moved):
            one.close()
