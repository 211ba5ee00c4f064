"""Recorded signed messages are refused, also by a link that has just started and remembers nothing."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_comms.packet.key import new_nonce
from auv_lse_mavlink.health import link_health
from auv_lse_mavlink.link import LinkState, VehicleLink
from auv_lse_mavlink.messages.sender_filter import SILENT_S

NOW_S = 1_700_000_000.0
KEY = bytes(range(32))


class Autopilot:
    """Vehicle 2's autopilot, written with plain pymavlink: it signs, checks our signatures, and answers TIMESYNC."""

    def __init__(self, ahead_s=0.0, link_id=0):
        self.mav = mavlink.MAVLink(None, srcSystem=2, srcComponent=1)
        self.mav.robust_parsing = True
        signing = self.mav.signing
        signing.secret_key, signing.sign_outgoing, signing.link_id = KEY, True, link_id
        self.ahead_s = ahead_s
        self.said = []
        self.set_time(NOW_S)

    def set_time(self, now_s):
        signed = round((now_s + self.ahead_s - 1_420_070_400.0) * 1e5)
        self.mav.signing.timestamp = max(self.mav.signing.timestamp, signed)

    def say(self, message):
        data = message.pack(self.mav)
        self.mav.seq = (self.mav.seq + 1) % 256
        self.said.append(data)
        return data

    def beat(self, mode=4):
        return self.say(mavlink.MAVLink_heartbeat_message(12, 3, 0, mode, mavlink.MAV_STATE_ACTIVE, 3))

    def answers(self, datagrams):
        for datagram in datagrams:
            for message in self.mav.parse_buffer(datagram) or ():
                if message.get_type() == "TIMESYNC" and message.tc1 == 0:
                    yield self.say(mavlink.MAVLink_timesync_message(123456789, message.ts1))


class Sea:
    """The link, and its autopilot unless it `hears` nothing."""

    def __init__(self, autopilot, now_s=NOW_S, hears=True):
        self.autopilot, self.now_s, self.hears = autopilot, now_s, hears
        self.restart()

    def restart(self):
        self.link = VehicleLink(LinkConfig(kind="mavlink"), 2, None, key=KEY, nonce=new_nonce())

    def live(self, seconds):
        for _ in range(round(seconds)):
            self.now_s += 1.0
            self.autopilot.set_time(self.now_s)
            self.link.receive(self.now_s, self.autopilot.beat())
            self.link.poll(self.now_s)
            sent = self.link.outgoing()
            for answer in self.autopilot.answers(sent if self.hears else ()):
                self.link.receive(self.now_s, answer)
        return self

    def replay(self, datagrams):
        for datagram in datagrams:
            self.link.receive(self.now_s, datagram)
        return self


def test_a_restarted_link_hears_no_recorded_message_and_its_autopilot_at_once():
    sea = Sea(Autopilot()).live(30)
    assert sea.link.state is LinkState.UP
    recorded = [*sea.autopilot.said, sea.autopilot.beat(mode=19)]
    sea.now_s += 2.0
    sea.restart()
    sea.replay(recorded)
    assert sea.link.state is LinkState.DOWN
    assert sea.link.wire["unproven"] == len(recorded)
    sea.link.poll(sea.now_s)
    sea.replay(recorded)
    assert sea.link.state is LinkState.DOWN, "the answers in the recording are to other questions"
    assert "no answer to TIMESYNC: a replay" in link_health(sea.link, "").text
    sea.live(2)
    assert (sea.link.state, sea.link.status.mode) == (LinkState.UP, 4)
    sea.replay(recorded)
    assert sea.link.status.mode == 4
    sea.link.poll(sea.now_s + 1.0)
    reader = mavlink.MAVLink(None)
    sent = [m.get_type() for datagram in sea.link.outgoing() for m in reader.parse_buffer(datagram)]
    assert (sent.count("HEARTBEAT"), sent.count("TIMESYNC")) == (1, 0), "it has its answer"


def test_messages_recorded_on_another_link_of_the_autopilot_are_refused():
    autopilot = Autopilot()
    recorded = [autopilot.beat(mode=19)]
    recorded[0] = Autopilot(link_id=3).beat(mode=19)
    sea = Sea(autopilot).live(2)
    assert sea.replay(recorded).link.status.mode == 4
    autopilot.mav.signing.link_id = 3  # a second cable
    assert sea.replay([autopilot.beat(mode=19)]).link.status.mode == 19


@pytest.mark.parametrize("ahead_s", [-7200.0, -30.0, 0.0, 30.0, 7200.0])
def test_clocks_that_differ_delay_nothing(ahead_s):
    sea = Sea(Autopilot(ahead_s)).live(3)
    assert sea.link.state is LinkState.UP
    sea.now_s -= 600.0  # a computer that starts with a wrong clock
    sea.restart()
    sea.live(3)
    assert sea.link.state is LinkState.UP


def test_an_autopilot_that_hears_nothing_is_not_trusted():
    sea = Sea(Autopilot(), hears=False).live(10)
    assert sea.link.state is LinkState.DOWN


def test_a_replay_cannot_take_the_port_from_the_autopilot():
    sea = Sea(Autopilot()).live(5)
    recorded = list(sea.autopilot.said)
    sea.restart()
    sea.link.poll(sea.now_s)
    assert sea.link.recognizes(recorded[0]), "anybody may call first: it is asked for an answer"
    genuine = sea.autopilot.beat()
    assert sea.link.recognizes(genuine)
    assert not any(sea.link.recognizes(datagram) for datagram in recorded)
    assert sea.link.state is LinkState.DOWN
    sea.live(2)
    assert not any(sea.link.recognizes(datagram) for datagram in [*recorded, genuine])
    sea.link.poll(sea.now_s + SILENT_S)
    assert sea.link.recognizes(sea.autopilot.beat())
