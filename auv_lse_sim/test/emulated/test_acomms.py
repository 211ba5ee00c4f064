"""Independent check: WHOI's own `acomms` drives the emulated modem, and our driver hears it, and the other way round.

`acomms` (LGPL, for tests only) runs in a process of its own: its listening thread cannot be ended.
"""

import json
import subprocess
import sys
import time

import pytest

from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_comms.micromodem.events import PacketReceived, TransmitDone, TransmitFailed, TransmitStarted
from auv_lse_comms.micromodem.port import ModemPort
from auv_lse_comms.micromodem.state import State
from auv_lse_sim.emulated.host_ports import PtyPort
from auv_lse_sim.emulated.modem_rack import ModemRack, perfect_water

pytest.importorskip("acomms", reason="acomms (test only) is not installed")

OURS = bytes(range(251, -1, -1))
THEIRS = bytes((7 * i) % 256 for i in range(252))

SCRIPT = """
import json, os, sys, time
port, folder, ours = sys.argv[1], sys.argv[2], bytes.fromhex(sys.argv[3])
from acomms.micromodem import Micromodem
from acomms.unifiedlog import UnifiedLog
modem = Micromodem(name="peer", unified_log=UnifiedLog(log_path=folder), log_level="DEBUG")
frames, statistics, transmit_statistics, packets = [], [], [], []
modem.rxframe_listeners.append(frames.append)
modem.cst_listeners.append(lambda cst, msg: statistics.append(cst))
modem.xst_listeners.append(lambda xst, msg: transmit_statistics.append(xst))
modem.packetrx_listeners.append(lambda packet: packets.append(packet))
modem.connect_serial(port)
answers = {"first_id": modem.id}
for name, value in (("SRC", 1), ("CST", 1), ("XST", 1)):
    answers[name] = bool(modem.set_config(name, value))
answers["id"] = modem.id
answers["set_time"] = modem.set_time() is not None
seconds, source, pps = modem.get_time_info(timeout=2.0)
answers["clock_source"] = source
answers["unknown"] = modem.set_config("NOPE", 1, response_timeout=0.5) is None
modem.send_packet_data(0, ours, rate_num=4)
until = time.time() + 20.0
while time.time() < until and not (transmit_statistics and frames and statistics):
    time.sleep(0.02)
time.sleep(0.3)
answers["state"] = str(modem.state)
answers["xst"] = [(x["rate_num"], x["src"], x["nbytes"], x["num_frames_sent"]) for x in transmit_statistics]
answers["frames"] = [(f.src, f.dest, bytes(f.data).hex()) for f in frames]
answers["packets"] = len(packets)
names = ("mode", "rate_num", "src", "bad_frames_num", "snr_in", "num_frames")
answers["cst"] = [[c[name] for name in names] for c in statistics]
print("ANSWERS " + json.dumps(answers), flush=True)
os._exit(0)
"""


def test_acomms_and_our_driver_hear_each_other_through_emulated_modems(tmp_path):
    transmit, water = perfect_water(lambda: rack, delay_s=0.1)
    rack = ModemRack({1: PtyPort(), 2: PtyPort()}, transmit, time.time())
    port = ModemPort(ModemConfig(kind="micromodem", port=rack.ports[2]), 2)
    arguments = [sys.executable, "-W", "ignore", "-c", SCRIPT, rack.ports[1], str(tmp_path), OURS.hex()]
    peer = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    events, answered = [], False
    try:
        until = time.monotonic() + 60.0
        while peer.poll() is None:
            assert time.monotonic() < until, "acomms did not end in time"
            now_s = time.time()
            rack.serve(now_s)
            rack.poll(now_s)
            water(now_s)
            events += port.step(now_s, time.monotonic())
            heard = [e for e in events if isinstance(e, PacketReceived)]
            if heard and not answered and port.modem.state is State.IDLE:
                answered = True
                port.send(now_s, THEIRS, 0)
            time.sleep(0.001)
        said = peer.stdout.read()
    finally:
        peer.kill()
        peer.wait()
        peer.stdout.close()
        port.close(time.time(), time.monotonic())
        rack.close()
    lines = [line for line in said.splitlines() if line.startswith("ANSWERS ")]
    assert lines, said
    peer_answers = json.loads(lines[0][8:])

    # acomms -> emulator -> water -> emulator -> our driver
    (packet,) = [e for e in events if isinstance(e, PacketReceived)]
    assert (packet.source, packet.destination, packet.payload, packet.rate) == (1, 0, OURS, 4)
    assert packet.snr_db == 20.0
    # what acomms understood of the emulated modem
    assert peer_answers["first_id"] == 0
    assert peer_answers["id"] == 1
    assert all(peer_answers[name] for name in ("SRC", "CST", "XST", "set_time", "unknown"))
    assert peer_answers["clock_source"] == "USER_CMD"
    assert peer_answers["xst"] == [[4, 1, 252, 1]]
    assert peer_answers["state"] == "Idle"
    # our driver -> emulator -> water -> emulator -> acomms
    assert peer_answers["frames"] == [[2, 0, THEIRS.hex()]]
    assert peer_answers["packets"] == 1
    assert peer_answers["cst"] == [[0, 4, 2, 0, 20.0, 1]]
    assert [type(e) for e in events if isinstance(e, TransmitStarted | TransmitDone | TransmitFailed)] == [
        TransmitStarted,
        TransmitDone,
    ]
