"""A flood of datagrams on the autopilot's port: the work of a step is bounded, and the autopilot is still heard."""

import itertools
import random
import socket
from collections import Counter

import pytest
from pymavlink.dialects.v20 import common as mavlink

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_comms.transport.ports import MAX_BYTES, MAX_DATAGRAMS
from auv_lse_mavlink import check_command
from auv_lse_mavlink.link import LinkState
from auv_lse_mavlink.messages.events import AutopilotEstimate
from auv_lse_mavlink.messages.sender_filter import EXAMINED_BYTES
from auv_lse_mavlink.messages.wire import MavlinkCodec
from auv_lse_mavlink.port import AutopilotPort

NOW_S = 1_700_000_000.0
KEY = bytes(range(32))
FRIEND, STRANGER = ("127.0.0.1", 1), ("127.0.0.1", 2)
#: Every so many datagrams one is the autopilot's: 10,000 a second of strangers, 100 of its own.
SHARE = 100


def speaker(system=2, key=None):
    mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
    if key is not None:
        mav.signing.secret_key, mav.signing.sign_outgoing = key, True
        mav.signing.timestamp = round((NOW_S - 1_420_070_400.0) * 1e5)
    return mav


def position(mav, number=0):
    return mavlink.MAVLink_local_position_ned_message(5000 + number, number, 2.0, 3.0, 0.5, 0.0, 0.0).pack(mav)


def autopilot_messages(key, nonce):
    """An autopilot's datagrams without end: the answer to TIMESYNC, heartbeat, attitude, then positions."""
    mav = speaker(key=key)
    yield mavlink.MAVLink_timesync_message(1, nonce or 0).pack(mav)
    yield mavlink.MAVLink_heartbeat_message(12, 3, 0, 4, mavlink.MAV_STATE_ACTIVE, 3).pack(mav)
    yield mavlink.MAVLink_attitude_message(5000, 0, 0, 0, 0, 0, 0).pack(mav)
    for number in itertools.count():
        mav.seq = (mav.seq + 1) % 256
        yield position(mav, number)


FLOODS = {
    "garbage": random.Random(1).randbytes(1400).replace(b"\x02\x01", b"xx"),
    "foreign": position(speaker(system=77)),
    "foreign, signed": position(speaker(system=77, key=KEY)),
    "bad signature": position(speaker(key=bytes(32))),
    "almost messages": b"\xfd\x00\x00\x00\x00\x02\x01" * 100,
}


class EndlessSocket:
    """A socket on which a flood never ends; the autopilot's datagrams are the first and in between."""

    def __init__(self, flood, friend, address=STRANGER):
        self.flood, self.friend, self.address = flood, friend, address
        self.calls = self.friendly = 0

    def recvfrom(self, size):
        self.calls += 1
        assert self.calls < 6_000, "the reader does not return while datagrams arrive"
        if self.calls % SHARE == 1:
            self.friendly += 1
            return next(self.friend), FRIEND
        return self.flood[:size], self.address

    def sendto(self, data, address):
        assert address == FRIEND

    def close(self):
        pass


def flooded(flood, key, address=STRANGER):
    pilot = AutopilotPort(LinkConfig(kind="mavlink", endpoint="udpin://127.0.0.1:0"), 2, None, key=key)
    pilot.step(NOW_S, 0.0)
    pilot.transport.close()
    pilot.transport._socket = EndlessSocket(flood, autopilot_messages(key, pilot.link._codec._mav.nonce), address)
    return pilot, pilot.transport._socket


@pytest.fixture
def parsed(monkeypatch):
    """Lengths of the data that were parsed: of the autopilot, and of strangers in order to recognize them."""
    lengths = {"decode": 0, "senders": 0}
    decode, senders = MavlinkCodec.decode, MavlinkCodec.senders

    def counted(codec, data):
        lengths["decode"] += len(data)
        return decode(codec, data)

    def examined(codec, data):
        lengths["senders"] += len(data)
        return senders(codec, data)

    monkeypatch.setattr(MavlinkCodec, "decode", counted)
    monkeypatch.setattr(MavlinkCodec, "senders", examined)
    return lengths


@pytest.mark.parametrize(
    ("kind", "key"),
    # without a key any signature is as good as none
    [(kind, key) for kind in FLOODS for key in (KEY, None) if key or kind != "bad signature"],
)
def test_a_step_in_a_flood_is_bounded_and_handles_every_message_of_the_autopilot(kind, key, parsed):
    pilot, sock = flooded(FLOODS[kind], key)
    estimates = named = 0
    for number in range(1, 6):
        calls, before = sock.calls, dict(parsed)
        found = pilot.step(NOW_S + 0.05 * number, 0.05 * number)
        estimates += sum(isinstance(event, AutopilotEstimate) for event in found)
        assert 0 < sock.calls - calls <= MAX_DATAGRAMS
        examined = parsed["senders"] - before["senders"]
        assert examined <= EXAMINED_BYTES * (1 if named else 2), "the first step also names others"
        named = named or parsed["senders"]
        assert parsed["decode"] - before["decode"] - examined <= MAX_BYTES
    assert pilot.link.state is LinkState.UP
    assert sock.friendly > 10
    assert estimates == sock.friendly - 3, "all but TIMESYNC, the heartbeat and the attitude"
    values = pilot.health().values
    assert values["other_senders"] == sock.calls - sock.friendly
    assert values["port full_reads"] == 5
    if kind in ("garbage", "foreign", "foreign, signed"):
        assert parsed["senders"] == named, "once the autopilot is heard, other senders' datagrams are not parsed"
    else:
        assert 0 < values["other_senders_unread"] <= values["other_senders"]


@pytest.mark.parametrize("kind", FLOODS)
def test_a_flood_does_not_slow_the_check_of_a_silent_autopilot(kind, parsed, monkeypatch, capsys):
    class Flooded(EndlessSocket):
        """A transport that reads a flood without the autopilot."""

        def __init__(self, expected):
            self.expected, self.counts = expected, Counter()

        def read(self):
            before = parsed["senders"]
            for _ in range(1000):
                self.expected(FLOODS[kind])
            assert parsed["senders"] - before <= 2 * EXAMINED_BYTES
            return b""

        def write(self, data):
            pass

    monkeypatch.setattr(check_command, "open_transport", lambda address, expected: Flooded(expected))
    monkeypatch.setattr(check_command, "_HEARD_S", 0.1)
    options = check_command.parser().parse_args(["udpin://127.0.0.1:0", "--vehicle", "2"])
    assert check_command.run(options) == 1
    assert ("heard instead: 77 (component 1)" in capsys.readouterr().out) == kind.startswith("foreign")


def test_when_the_autopilots_own_port_floods_the_oldest_datagrams_are_dropped(parsed):
    pilot, sock = flooded(position(speaker(system=77)) * 30, None, FRIEND)
    for _ in range(3):  # TIMESYNC, heartbeat and attitude
        pilot.link.receive(NOW_S, next(sock.friend))
    pilot.transport._peer = FRIEND
    for number in range(1, 4):
        calls, before = sock.calls, parsed["decode"]
        found = pilot.step(NOW_S + number, float(number))
        assert 0 < sock.calls - calls <= MAX_DATAGRAMS
        assert parsed["decode"] - before <= MAX_BYTES
        if sock.calls % SHARE < 50:  # one of the newest 50 datagrams, which are kept
            assert [e.north_m for e in found if isinstance(e, AutopilotEstimate)][-1] == sock.friendly - 1
    values = pilot.health().values
    assert values["port datagrams_dropped"] > 0
    assert values["from_others"] > 0


def test_one_step_reads_at_most_the_bound_from_a_real_socket(monkeypatch):
    monkeypatch.setattr("auv_lse_comms.transport.ports.MAX_DATAGRAMS", 50)
    pilot = AutopilotPort(LinkConfig(kind="mavlink", endpoint="udpin://127.0.0.1:0"), 2, None)
    pilot.step(NOW_S, 0.0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for _ in range(120):
            stranger.sendto(FLOODS["foreign"], ("127.0.0.1", pilot.transport.local_port))
    for step, read in enumerate((50, 100, 120, 120), 1):
        pilot.step(NOW_S + step, float(step))
        assert pilot.link.counts["other_senders"] == read
    assert pilot.health().values["port full_reads"] == 2
    pilot.connection.close(5.0, "test")
    assert pilot.health().values["port full_reads"] == 2, "counts survive the port"


def test_a_stream_that_always_ends_within_a_message_takes_no_memory():
    codec, data = MavlinkCodec(1, 1), position(speaker())
    codec.decode(data[:5])
    for _ in range(100):
        assert len(codec.decode(data[5:] + data[:5])) == 1
    assert len(codec._mav.buf) < len(data)
