"""A dive whose recorder was restarted, as after a reboot, has several recordings: bag, bag-2, ... They are one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from verb_main import verb_main

from auv_lse_record.bag_writer import BagWriter
from auv_lse_record.message_types import project_types
from auv_lse_record.recording import MISSION_FILE, Recording, RecordingError, parts_of, recording_in
from auv_lse_record.run_data import RunData
from auv_lse_record.run_reader import read_run
from auv_lse_record.run_writer import write_run

recover = verb_main("recover")


@pytest.fixture
def dive(tmp_path: Path, synthetic_run: Callable[..., RunData]) -> tuple[RunData, Path]:
    """A run, and its recording cut into bag, bag-2 and bag-10; each begins with the mission file."""
    run, whole = synthetic_run(steps=6), tmp_path / "whole"
    write_run(run, whole)
    folder = tmp_path / "a dive"
    with Recording(recording_in(whole)) as recording:
        messages = list(recording.raw(recording.topics))
        kinds = {name: topic.kind for name, topic in recording.topics.items()}
    mission = [message for message in messages if message[0] == MISSION_FILE]
    third = len(messages) // 3
    for name, part in (
        ("bag", messages[:third]),
        ("bag-2", mission + messages[third : 2 * third]),
        ("bag-10", mission + messages[2 * third :]),
    ):
        bag = BagWriter(folder / name, project_types(), {})
        for topic in dict.fromkeys(message[0] for message in part):
            bag.add_topic(topic, kinds[topic])
        for topic, stamp_ns, data in sorted(part, key=lambda message: message[1]):
            bag.write(topic, stamp_ns, data)
        bag.close()
    return run, folder


def test_all_recordings_of_a_dive_are_read(dive: tuple[RunData, Path]) -> None:
    run, folder = dive
    assert [part.name for part in parts_of(recording_in(folder))] == ["bag", "bag-2", "bag-10"]
    back = read_run(folder)
    for a, b in zip(run.vehicles, back.vehicles, strict=True):
        np.testing.assert_allclose(a.soundings.rows, b.soundings.rows, rtol=0.0, atol=1e-8)
        assert [d.step for d in a.decisions] == [d.step for d in b.decisions]
    one = read_run(folder / "bag-2")
    assert 0 < len(one.vehicles[0].soundings) < len(run.vehicles[0].soundings), "a recording that is named is one"
    assert parts_of(recording_in(folder / "bag-2")) == [folder / "bag-2"]


def test_a_dive_with_a_torn_and_an_empty_recording_is_recovered(
    dive: tuple[RunData, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    run, folder = dive
    first, second = folder / "bag" / "bag.mcap", folder / "bag-2" / "bag-2.mcap"
    first.write_bytes(first.read_bytes()[:-2000])
    second.write_bytes(second.read_bytes()[:20])
    (folder / "bag-3").mkdir()
    (folder / "bag-3" / "bag-3.mcap").touch()
    for torn in (first, second):
        (torn.parent / "metadata.yaml").unlink()
    with pytest.raises(RecordingError, match=r"auv_lse recover '.*a dive'"):
        read_run(folder)
    assert recover([str(folder)]) == 0
    text = capsys.readouterr().out
    assert f"{first}: " in text
    assert f"{second}: no message can be read; put aside as {second}.torn" in text
    back = read_run(folder)
    assert 0 < len(back.vehicles[0].soundings) < len(run.vehicles[0].soundings)
    assert recover([str(folder)]) == 0, "a second time"


def test_a_folder_of_dives_names_them(dive: tuple[RunData, Path]) -> None:
    _, folder = dive
    with pytest.raises(RecordingError, match=f"has the recordings of 2 run folders; name one, such as {folder}"):
        recording_in(folder.parent)
