"""The writer through rosbag2_py, against a stand-in with the signatures of Jazzy's: none is installed here."""

from __future__ import annotations

import sys
import types
from pathlib import Path
from typing import Any

import pytest
import yaml

from auv_lse_record.bag_writer import BagWriter, RecorderError
from auv_lse_record.rosbag2_writer import Rosbag2Writer, make_writer


class Calls(list[Any]):
    """What was asked of rosbag2_py."""


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Calls:
    """rosbag2_py with the names and arguments that its Jazzy sources declare."""
    found = Calls()

    class StorageOptions:
        def __init__(
            self, uri: str, storage_id: str = "", storage_config_uri: str = "", custom_data: Any = None
        ) -> None:
            storage = yaml.safe_load(Path(storage_config_uri).read_text())
            found.append(("options", uri, storage_id, storage, custom_data))
            self.uri = uri

    class TopicMetadata:
        def __init__(
            self, id: int, name: str, type: str, serialization_format: str, offered_qos_profiles: list[Any]
        ) -> None:
            self.row = (id, name, type, serialization_format, offered_qos_profiles)

    class SequentialWriter:
        def open(self, options: StorageOptions, converter: tuple[str, str]) -> None:
            if "forbidden" in options.uri:
                raise RuntimeError("no space")
            found.append(("open", converter))

        def create_topic(self, topic: TopicMetadata) -> None:
            if "unknown" in topic.row[2]:
                raise RuntimeError("no such type")
            found.append(("topic", *topic.row))

        def write(self, topic: str, data: bytes, stamp_ns: int) -> None:
            assert type(data) is bytes
            found.append(("write", topic, data, stamp_ns))

        def close(self) -> None:
            found.append(("close",))

    stand_in: Any = types.ModuleType("rosbag2_py")
    stand_in.StorageOptions, stand_in.TopicMetadata, stand_in.SequentialWriter = (
        StorageOptions, TopicMetadata, SequentialWriter
    )  # fmt: skip
    stand_in.ConverterOptions = lambda a, b: (a, b)
    stand_in.to_rclcpp_qos_vector = lambda text, version: (version, yaml.safe_load(text))
    monkeypatch.setitem(sys.modules, "rosbag2_py", stand_in)
    return found


def test_recording_by_rosbag2(tmp_path: Path, calls: Calls) -> None:
    bag = make_writer(tmp_path / "dive" / "bag", [], {"seed": "7"}, 5.0)
    assert isinstance(bag, Rosbag2Writer), "where rosbag2_py is there, it writes"
    bag.add_topic("/clock", "rosgraph_msgs/msg/Clock")
    bag.add_topic("/auv1/plan", "auv_lse_msgs/msg/Plan", latched=True)
    bag.use_definitions([])
    bag.write("/clock", 17, bytearray(b"abc"))
    bag.close()
    options, opened, clock, plan, write, close = calls
    storage = {"chunkSize": 65536, "compression": "Zstd"}
    assert options == ("options", str(tmp_path / "dive" / "bag"), "mcap", storage, {"seed": "7"})
    assert opened == ("open", ("cdr", "cdr"))
    assert clock[1:5] == (0, "/clock", "rosgraph_msgs/msg/Clock", "cdr")
    (version, (profile,)) = plan[5]
    assert version == 9
    assert (profile["depth"], profile["durability"], profile["reliability"]) == (1, "transient_local", "reliable")
    assert profile["deadline"] == {"sec": 9223372036, "nsec": 854775807}
    assert clock[5][1][0]["durability"] == "volatile"
    assert write == ("write", "/clock", b"abc", 17)
    assert close == ("close",)
    assert bag.count == 1


def test_rosbag2_errors_are_named(tmp_path: Path, calls: Calls) -> None:
    (tmp_path / "bag").mkdir()
    with pytest.raises(RecorderError, match=r"bag'? exists. Name a new folder"):
        Rosbag2Writer(tmp_path / "bag", {})
    with pytest.raises(RecorderError, match="cannot start a recording there: no space"):
        Rosbag2Writer(tmp_path / "forbidden", {})
    bag = Rosbag2Writer(tmp_path / "new", {})
    with pytest.raises(RecorderError, match="topic /x: type unknown/msg/X cannot be recorded: no such type"):
        bag.add_topic("/x", "unknown/msg/X")


def test_without_rosbag2_the_project_writer_is_used(tmp_path: Path) -> None:
    bag = make_writer(tmp_path / "bag", [], {}, 5.0)
    assert isinstance(bag, BagWriter)
    bag.close()
