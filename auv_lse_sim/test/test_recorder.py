"""Recordings made without ROS: what is written is read back, also after a power cut."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader

from auv_lse_sim.record.recorder import BagWriter, RecorderError, message_types

MESSAGES = Path(__file__).resolve().parents[2] / "auv_lse_msgs" / "msg"


@pytest.fixture(scope="module")
def types(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("share") / "auv_lse_msgs" / "msg"
    folder.parent.mkdir()
    folder.symlink_to(MESSAGES)
    return message_types([folder])


def written(folder: Path, types: Any, messages: int, close: bool = True) -> BagWriter:
    bag = BagWriter(folder, types, {"seed": "7"}, flush_s=1.0)
    bag.add_topic("/clock", "rosgraph_msgs/msg/Clock")
    bag.add_topic("/auv1/plan", "auv_lse_msgs/msg/Plan", latched=True)
    clock = types.types["rosgraph_msgs/msg/Clock"]
    time = types.types["builtin_interfaces/msg/Time"]
    for i in range(messages):
        data = types.serialize_cdr(clock(clock=time(sec=i, nanosec=0)), "rosgraph_msgs/msg/Clock")
        bag.write("/clock", i * 10**9, bytes(data))
    if close:
        bag.close()
    return bag


def test_a_recording_is_read_back_with_its_snapshot(tmp_path: Path, types: Any) -> None:
    written(tmp_path / "bag", types, 10)
    with AnyReader([tmp_path / "bag"]) as reader:
        stamps = [stamp for _, stamp, _ in reader.messages()]
        seconds = [reader.deserialize(data, c.msgtype).clock.sec for c, _, data in reader.messages()]
    assert stamps == [i * 10**9 for i in range(10)]
    assert seconds == list(range(10))
    text = (tmp_path / "bag" / "metadata.yaml").read_text()
    assert "seed" in text
    assert "transient_local" in text, "playback latches what was latched"
    with (tmp_path / "bag" / "bag.mcap").open("rb") as file:
        header = make_reader(file).get_header()
    assert header.profile == "ros2"


def test_a_power_cut_costs_no_more_than_the_flush_time(tmp_path: Path, types: Any) -> None:
    bag = written(tmp_path / "bag", types, 20, close=False)  # never closed: no index, no metadata
    with (tmp_path / "bag" / "bag.mcap").open("rb") as file:
        found = []
        with contextlib.suppress(EndOfFile):  # it ends without its footer
            for record in StreamReader(file).records:
                if isinstance(record, Message):
                    found.append(record.log_time)
    assert len(found) >= 18
    bag.close()


def test_what_cannot_be_recorded_is_said(tmp_path: Path, types: Any) -> None:
    written(tmp_path / "bag", types, 1)
    with pytest.raises(RecorderError, match="exists already"):
        BagWriter(tmp_path / "bag", types, {})
    bag = BagWriter(tmp_path / "other", types, {})
    with pytest.raises(RecorderError, match="no_such_msgs"):
        bag.add_topic("/x", "no_such_msgs/msg/Thing")
    bag.close()
