"""Excerpts of a growing recording: joined, they are the messages that were asked for, whatever was lost in between."""

from __future__ import annotations

import json
import shutil
from itertools import pairwise
from pathlib import Path

import pytest

from auv_lse_record import excerpt as excerpts
from auv_lse_record.excerpt import Cursor, excerpt
from auv_lse_record.growing_file import MAGIC, RecordingFile
from auv_lse_record.recording import MISSION_FILE
from auv_lse_record.run_writer import write_run

ODOMETRY, SOUNDING = "/auv2/odometry", "/auv2/sounding"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, synthetic_run) -> Path:
    folder = tmp_path_factory.mktemp("excerpt") / "run"
    write_run(synthetic_run(), folder)
    return folder / "bag" / "bag.mcap"


def joined(dive: Path, topics: dict[str, float], files: list[list[bytes]], values: dict) -> dict:
    """Asks until there is no more, as over a link that forgets everything; returns the cursor."""
    while True:
        before = Cursor.read(json.loads(json.dumps(values)))
        data, cursor, more = excerpt(dive, before, topics)
        assert (data, cursor) == excerpt(dive, before, topics)[:2], "an answer that was lost can be asked for again"
        values = cursor.values()
        if not files or before.file != cursor.file:
            files.append([])
        files[-1].append(data)
        if not more:
            return values


def messages(path: Path, pieces: list[bytes], topics) -> list[tuple[str, int]]:
    path.write_bytes(MAGIC + b"".join(pieces))
    return [(topic, stamp(message)) for topic, message in RecordingFile(path).messages(frozenset(topics))]


def stamp(message) -> int:
    at = getattr(message, "header", None)
    return 0 if at is None else at.stamp.sec * 10**9 + at.stamp.nanosec


def test_the_excerpts_of_a_growing_file_are_its_messages(recorded, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(excerpts, "MOST_BYTES", 20_000)
    topics = {MISSION_FILE: 0.0, SOUNDING: 0.0, "/auv2/plan": 0.0, ODOMETRY: 0.0}
    expected = [(t, stamp(m)) for t, m in RecordingFile(recorded).messages(frozenset(topics))]
    copy, data, files, values = tmp_path / "dive" / "bag" / "bag.mcap", recorded.read_bytes(), [], {}
    copy.parent.mkdir(parents=True)
    for share in (1e-5, 0.3, 0.31, 0.8, 1.0):
        copy.write_bytes(data[: int(share * len(data))])
        values = joined(tmp_path / "dive", topics, files, values)
    assert len(files) == 1
    assert len(files[0]) > 6, "a long backlog comes in pieces"
    assert messages(tmp_path / "joined.mcap", files[0], topics) == expected


def test_a_topic_is_thinned_and_the_rest_is_left_out(recorded, tmp_path) -> None:
    shutil.copytree(recorded.parent, tmp_path / "dive" / "bag")
    files: list[list[bytes]] = []
    joined(tmp_path / "dive", {ODOMETRY: 5.0}, files, {})
    found = messages(tmp_path / "joined.mcap", files[0], [ODOMETRY, SOUNDING])
    assert {topic for topic, _ in found} == {ODOMETRY}
    stamps = [at_ns for _, at_ns in found]
    assert min(b - a for a, b in pairwise(stamps)) >= 5e9
    whole = sum(1 for _ in RecordingFile(recorded).messages(frozenset([ODOMETRY])))
    assert 30 < len(stamps) < whole / 4


def test_a_restarted_recorder_and_a_new_dive_are_followed(recorded, tmp_path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    shutil.copytree(recorded.parent, first / "bag")
    (first / "bag" / "bag.mcap").write_bytes(recorded.read_bytes()[:-3000])  # the recorder was killed
    files: list[list[bytes]] = []
    values = joined(first, {SOUNDING: 0.0}, files, {})
    shutil.copytree(recorded.parent, first / "bag-2")
    values = joined(first, {SOUNDING: 0.0}, files, values)
    assert len(files) == 2
    whole = messages(tmp_path / "second.mcap", files[1], [SOUNDING])
    assert whole == [(t, stamp(m)) for t, m in RecordingFile(recorded).messages(frozenset([SOUNDING]))]
    shutil.copytree(recorded.parent, second / "bag")
    _, cursor, _ = excerpt(second, Cursor.read(values), {SOUNDING: 0.0})
    assert (cursor.dive, cursor.file) == ("second", "bag/bag.mcap")
    assert excerpt(tmp_path, Cursor(), {})[0] == b"", "a dive without a recording"


@pytest.mark.parametrize("values", [{"offset": -1}, {"file": 3}, {"channels": {"1": 2}}, {"kept_ns": {"1": "x"}}])
def test_a_wrong_cursor_is_refused(values) -> None:
    with pytest.raises(TypeError, match="is no cursor"):
        Cursor.read(values)
