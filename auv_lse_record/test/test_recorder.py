"""Recordings made without ROS: what is written is read back, also after a power cut."""

from __future__ import annotations

import contextlib
import resource
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from verb_main import verb_main

from auv_lse_record.bag_writer import BagWriter, RecorderError, message_texts, message_types, unused_folder
from auv_lse_record.guard import GuardedWriter
from auv_lse_record.message_types import dive_in, frame_of
from auv_lse_record.recording import Recording, RecordingError, recording_in
from auv_lse_record.recover import recover
from auv_lse_record.salvage import whole_pieces

main = verb_main("recover")

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


def test_recording_is_read_back_with_its_snapshot(tmp_path: Path, types: Any) -> None:
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


def test_each_start_finds_a_folder_that_does_not_exist(tmp_path: Path) -> None:
    assert unused_folder(tmp_path / "bag") == tmp_path / "bag"
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag-2").symlink_to("nowhere")
    assert unused_folder(tmp_path / "bag") == tmp_path / "bag-3"


def test_definitions_are_complete_and_keep_their_comments(tmp_path: Path, types: Any) -> None:
    """Two independent readers read every message by them; units and meanings are there for a person."""
    bag = BagWriter(tmp_path / "bag", types, {})
    bag.texts = message_texts([MESSAGES])
    bag.add_topic("/auv1/sounding", "auv_lse_msgs/msg/Sounding")
    bag.add_topic("/auv1/odometry", "nav_msgs/msg/Odometry")
    kind = types.types["auv_lse_msgs/msg/Sounding"]
    header = types.types["std_msgs/msg/Header"](
        stamp=types.types["builtin_interfaces/msg/Time"](sec=3, nanosec=4), frame_id="map"
    )
    raw = {"raw_north_m": 1.5, "raw_east_m": 2.5}
    message = kind(header=header, dive="auv1-1", north_m=1.0, east_m=2.0, depth_m=3.0, **raw)
    data = bytes(types.serialize_cdr(message, "auv_lse_msgs/msg/Sounding"))
    assert (frame_of(data), dive_in(data)) == ("map", "auv1-1")
    assert frame_of(bytes(types.serialize_cdr(message, "auv_lse_msgs/msg/Sounding", little_endian=False))) == "map"
    assert frame_of(data[:12]) == ""
    bag.write("/auv1/sounding", 1, data)
    bag.close()
    with (tmp_path / "bag" / "bag.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        ((schema, _, _, by_mcap),) = reader.iter_decoded_messages()
        schemas = {found.name: found.data.decode() for found in reader.get_summary().schemas.values()}
    assert (by_mcap.header.stamp.sec, by_mcap.header.frame_id, by_mcap.depth_m) == (3, "map", 3.0)
    assert "water surface to bottom, positive down" in schema.data.decode()
    for part in (
        "std_msgs/Header",
        "geometry_msgs/PoseWithCovariance",
        "geometry_msgs/Quaternion",
        "geometry_msgs/Twist",
    ):
        assert f"MSG: {part}\n" in schemas["nav_msgs/msg/Odometry"], "the types in it are there"
    with AnyReader([tmp_path / "bag"]) as reader:
        ((connection, _, data),) = reader.messages()
        assert reader.deserialize(data, connection.msgtype).depth_m == 3.0


def test_types_discovered_later_can_be_recorded(tmp_path: Path, types: Any) -> None:
    """It failed: the recorder read the new package's definitions, but the writer went on with the old ones."""
    bag = BagWriter(tmp_path / "bag", types, {})
    folder = tmp_path / "share" / "ctd_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Salinity.msg").write_text("float64 salinity_psu  # practical salinity\n")
    with pytest.raises(RecorderError, match="ctd_msgs"):
        bag.add_topic("/ctd", "ctd_msgs/msg/Salinity")
    bag.types = message_types([folder])
    bag.add_topic("/ctd", "ctd_msgs/msg/Salinity")
    bag.close()


def test_power_failure_loses_at_most_the_flush_time(tmp_path: Path, types: Any) -> None:
    bag = written(tmp_path / "bag", types, 20, close=False)  # never closed: no index, no metadata
    with (tmp_path / "bag" / "bag.mcap").open("rb") as file:
        found = []
        with contextlib.suppress(EndOfFile):  # it ends without its footer
            for record in StreamReader(file).records:
                if isinstance(record, Message):
                    found.append(record.log_time)
    assert len(found) >= 18
    bag.close()


def test_unrecordable_topic_is_reported(tmp_path: Path, types: Any) -> None:
    written(tmp_path / "bag", types, 1)
    with pytest.raises(RecorderError, match="exists already"):
        BagWriter(tmp_path / "bag", types, {})
    bag = BagWriter(tmp_path / "other", types, {})
    with pytest.raises(RecorderError, match="no_such_msgs"):
        bag.add_topic("/x", "no_such_msgs/msg/Thing")
    bag.close()


KILLED = """
import os, sys, time
from pathlib import Path
sys.path[:0] = {path!r}
from auv_lse_record.bag_writer import BagWriter, message_types
types = message_types([])
bag = BagWriter(Path({folder!r}), types, {{}}, flush_s=1.0)
bag.add_topic("/clock", "rosgraph_msgs/msg/Clock")
clock, stamp = types.types["rosgraph_msgs/msg/Clock"], types.types["builtin_interfaces/msg/Time"]
for i in range(300):  # ten messages a second
    data = types.serialize_cdr(clock(clock=stamp(sec=i, nanosec=0)), "rosgraph_msgs/msg/Clock")
    bag.write("/clock", i * 10**8, bytes(data))
os.kill(os.getpid(), 9)
"""


def test_killed_recorder_loses_at_most_two_seconds_and_is_recovered(tmp_path: Path) -> None:
    folder = tmp_path / "a dive" / "bag"
    folder.parent.mkdir()
    done = subprocess.run([sys.executable, "-c", KILLED.format(path=sys.path, folder=str(folder))], check=False)
    assert done.returncode == -9
    with pytest.raises(RecordingError, match=r"auv_lse recover '.*bag\.mcap'"), Recording(recording_in(folder)):
        pass
    found = recover(folder.parent)
    assert found.messages >= 280, "thirty seconds at 10 Hz, less two"
    with Recording(recording_in(folder)) as recording:
        stamps = [stamp for _, stamp, _ in recording.messages({"/clock"})]
    assert stamps == [i * 10**8 for i in range(found.messages)]
    with (folder / "bag.mcap").open("rb") as file:
        assert make_reader(file).get_summary().statistics.message_count == found.messages
    assert main([str(folder)]) == 0, "the second time there is nothing to do"
    assert (folder / "bag.mcap.torn").is_file()


@pytest.mark.parametrize("at", [0.5, 0.9])
def test_truncated_recording_is_recovered_up_to_the_cut(tmp_path: Path, types: Any, at: float) -> None:
    written(tmp_path / "bag", types, 100)
    file = tmp_path / "bag" / "bag.mcap"
    data = file.read_bytes()
    (tmp_path / "bag" / "metadata.yaml").unlink()
    file.write_bytes(data[: int(at * len(data))])
    assert 0 < recover(tmp_path / "bag").messages <= 100
    with (tmp_path / "bag" / "bag.mcap").open("rb") as whole:
        assert make_reader(whole).get_summary() is not None


@pytest.mark.parametrize("flips", [1, 2, 5, 20, 100])
def test_every_whole_chunk_of_a_recording_with_flipped_bits_is_recovered(
    tmp_path: Path, types: Any, flips: int
) -> None:
    written(tmp_path / "bag", types, 300)
    file = tmp_path / "bag" / "bag.mcap"
    data = file.read_bytes()
    with Recording(file) as recording:
        before = [(stamp, clock.clock.sec) for _, stamp, clock in recording.messages({"/clock"})]
    whole = [piece for piece in whole_pieces(data) if data[piece.start] == 6]
    assert len(whole) > 20
    rng = np.random.default_rng(flips)
    for _ in range(8):
        damaged = bytearray(data)
        at = rng.integers(8, len(data) - 8, size=flips)
        for place in at:
            damaged[place] ^= 1 << int(rng.integers(8))
        shutil.rmtree(tmp_path / "damaged", ignore_errors=True)
        (tmp_path / "damaged").mkdir()
        (tmp_path / "damaged" / "bag.mcap").write_bytes(damaged)
        spared = [
            (record.log_time, int.from_bytes(record.data[4:8], "little"))
            for piece in whole
            if not any(piece.start <= place < piece.end for place in at)
            for record in piece.records
            if isinstance(record, Message)
        ]
        code = main([str(tmp_path / "damaged" / "bag.mcap")])
        first = whole[0]
        if any(first.start <= place < first.end for place in at) and (
            code or any(place > whole[-1].end for place in at)
        ):
            continue  # both descriptions of the topic may be damaged
        assert code == 0
        with Recording(tmp_path / "damaged" / "bag.mcap") as recording:
            after = [(stamp, clock.clock.sec) for _, stamp, clock in recording.messages({"/clock"})]
        assert set(spared) <= set(after) <= set(before), "every whole chunk, and no wrong message"


def test_other_files_are_not_recovered(tmp_path: Path, types: Any, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path / "none")]) == 1
    assert "does not exist" in capsys.readouterr().err
    (tmp_path / "x.mcap").write_bytes(b"no recording")
    assert main([str(tmp_path / "x.mcap")]) == 1
    assert "no message can be read" in capsys.readouterr().err
    written(tmp_path / "bag", types, 3)
    assert main([str(tmp_path / "bag")]) == 0, "as its help says"
    assert "nothing to recover" in capsys.readouterr().out


@pytest.mark.parametrize("described", [b"/auv1/plan", b"auv_lse_msgs/msg/Plan", b"rosgraph_msgs/msg/Clock", b"sec\n"])
def test_a_flipped_bit_in_a_repeated_description_is_recovered(tmp_path: Path, types: Any, described: bytes) -> None:
    """Readers take the topics from the end of a file, where no checksum covers them."""
    written(tmp_path / "run" / "bag", types, 200)
    file = tmp_path / "run" / "bag" / "bag.mcap"
    data = bytearray(file.read_bytes())
    data[data.rindex(described) + 1] ^= 1
    file.write_bytes(data)
    assert recover(tmp_path / "run").messages == 200
    with Recording(recording_in(tmp_path / "run")) as recording:
        assert recording.topics["/clock"].kind == "rosgraph_msgs/msg/Clock"
        assert sum(1 for _ in recording.raw({"/clock"})) == 200


def test_a_recording_without_room_for_its_repair_stays_as_it_was(
    tmp_path: Path, types: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    written(tmp_path / "run" / "bag", types, 2000)
    file = tmp_path / "run" / "bag" / "bag.mcap"
    file.write_bytes(torn := file.read_bytes()[:-100])
    most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, most[1]))
    try:
        assert main([str(tmp_path / "run")]) == 1
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, most)
    assert capsys.readouterr().err == (
        f"error: {file}.new: cannot be written: File too large. Free space, or copy the run folder to another disk and "
        "recover it there\n"
    )
    assert sorted(path.name for path in file.parent.iterdir()) == ["bag.mcap", "metadata.yaml"]
    assert file.read_bytes() == torn


@pytest.mark.parametrize("missing", [1, 8, 20, 400])
def test_a_recording_that_was_copied_in_part_is_recovered_although_its_metadata_is_there(
    tmp_path: Path, types: Any, missing: int
) -> None:
    written(tmp_path / "bag", types, 100)
    file = tmp_path / "bag" / "bag.mcap"
    file.write_bytes(file.read_bytes()[:-missing])
    assert 0 < recover(tmp_path / "bag").messages <= 100
    with Recording(recording_in(tmp_path / "bag")) as recording:
        assert len(list(recording.messages({"/clock"}))) > 0
    with pytest.raises(RecordingError, match="nothing to recover"):
        recover(tmp_path / "bag")


@pytest.mark.parametrize("index", ["", "a" * 1000, "a: 1\na: 2\n"])
def test_a_damaged_index_beside_a_whole_file_is_put_aside(tmp_path: Path, types: Any, index: str) -> None:
    written(tmp_path / "bag", types, 100)
    (tmp_path / "bag" / "metadata.yaml").write_text(index)
    with pytest.raises(RecordingError, match=r"auv_lse recover .*bag") as refused, Recording(tmp_path / "bag"):
        pass
    assert "\n" not in str(refused.value)
    assert recover(tmp_path / "bag").messages == 100
    with Recording(recording_in(tmp_path / "bag")) as recording:
        assert len(list(recording.messages({"/clock"}))) == 100
    assert (tmp_path / "bag" / "metadata.yaml.torn").read_text() == index


def test_a_second_recovery_keeps_the_damaged_file_of_the_first(
    tmp_path: Path, types: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    written(tmp_path / "bag", types, 200)
    file, damaged = tmp_path / "bag" / "bag.mcap", []
    for number in ("", "2", "3"):
        damaged.append(file.read_bytes()[:-100])
        file.write_bytes(damaged[-1])
        assert main([str(file)]) == 0
        assert capsys.readouterr().out.splitlines()[-1] == f"damaged file kept as {file}.torn{number}"
    assert [(file.parent / f"bag.mcap.torn{number}").read_bytes() for number in ("", "2", "3")] == damaged


def test_nearly_full_disk_ends_the_recording_completely(tmp_path: Path, types: Any) -> None:
    bag, left = written(tmp_path / "bag", types, 5, close=False), [500.0]
    guarded = GuardedWriter(bag, tmp_path / "bag", 200.0, lambda folder: left[0])
    guarded.check_space()
    assert guarded.problem == ""
    left[0] = 150.0
    guarded.check_space()
    assert "150 MB of free space are left, less than record.least_free_mb (200 MB)" in guarded.problem
    guarded.write("/clock", 6 * 10**9, b"")
    guarded.close()
    assert guarded.dropped == 1
    with AnyReader([tmp_path / "bag"]) as reader:
        assert reader.message_count == 5


class FullDisk:
    """A writer on a disk without room."""

    def fail(self, *arguments: object) -> None:
        raise OSError(28, "No space left on device")

    add_topic = write = close = fail


def test_full_disk_ends_the_recording_without_an_error(tmp_path: Path) -> None:
    guarded = GuardedWriter(FullDisk(), tmp_path, 0.0)
    guarded.write("/clock", 1, b"")
    assert "No space left on device" in guarded.problem
    guarded.write("/clock", 2, b"")
    guarded.close()
    assert guarded.dropped == 1


def test_disk_full_at_the_end_names_the_cure(tmp_path: Path) -> None:
    guarded = GuardedWriter(FullDisk(), tmp_path, 0.0)
    guarded.close()
    assert "No space left on device" in guarded.problem
    assert f"auv_lse recover {tmp_path}" in guarded.problem


def test_disk_full_at_a_new_topic_ends_the_recording(tmp_path: Path) -> None:
    guarded = GuardedWriter(FullDisk(), tmp_path, 0.0)
    guarded.add_topic("/late", "std_msgs/msg/String")
    assert "No space left on device" in guarded.problem
