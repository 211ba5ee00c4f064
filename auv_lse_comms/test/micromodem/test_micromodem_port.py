"""The driver on its port, with its line log."""

from __future__ import annotations

from pathlib import Path

import pytest

from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_common.vocabulary.health import Level
from auv_lse_comms.micromodem.events import Problem, TransmitFailed
from auv_lse_comms.micromodem.port import ModemPort, PacketLost


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_closes_the_line_log_and_is_reported_once() -> None:
    port = ModemPort(ModemConfig(kind="micromodem", port="/dev/does-not-exist", log_file="/dev/full"), 2)
    events = [event for i in range(5) for event in port.step(0.1 * i, 0.1 * i)]
    port.send(1.0, b"payload", 0)
    events += port.step(1.0, 1.0) + port.close(2.0, 2.0)
    (problem,) = [event for event in events if isinstance(event, Problem)]
    assert problem.text.startswith("line log /dev/full: closed because it cannot be written: ")
    assert port.modem.counts["asked"] == 1


def test_a_packet_that_never_reached_the_water_is_lost_once() -> None:
    port = ModemPort(ModemConfig(kind="micromodem", port="/dev/does-not-exist"), 2)
    number = port.send(1.0, b"payload", 0)
    events = [event for i in range(100) for event in port.step(1.0 + i, 1.0 + i)]
    assert [event for event in events if isinstance(event, TransmitFailed | PacketLost)][1:] == [
        PacketLost(number=number)
    ]
    assert port.packets_lost == 1
    health = port.health()
    assert (health.level, health.values["state"]) == (Level.ERROR, "closed")
    assert "/dev/does-not-exist" in health.text
