"""The worked example of docs/extending/adding-a-topic.md: message, value and row, added to a copy of the packages."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "extending" / "adding-a-topic.md"

#: Records two messages, and looks at recorder, replay and reference page.
CHECK = """
from pathlib import Path

from auv_lse_common.topics.records import MeanRisk
from auv_lse_common.topics.table import VEHICLE_TOPICS, full_name, recorded_topics
from auv_lse_record.bag_writer import BagWriter
from auv_lse_record.message_types import make_message, project_types
from auv_lse_record.recording import Recording, recording_in
from auv_lse_shore.reference_pages import tables
from auv_lse_shore.replay.pace import select_topics

topic, types = VEHICLE_TOPICS["mean_risk"], project_types()
name = full_name(topic, 2)
assert name in recorded_topics(2), "the recorder subscribes to it"
writer = BagWriter(Path("bag"), types, {})
writer.add_topic(name, topic.kind, topic.latched)
for stamp_s, risk in ((1.5, 0.25), (2.5, 0.125)):
    fields = topic.encode(MeanRisk(stamp_s=stamp_s, mean_risk=risk, cells=4), 2)
    data = types.serialize_cdr(make_message(types, topic.kind, fields), topic.kind)
    writer.write(name, round(stamp_s * 1e9), bytes(data))
writer.close()
with Recording(recording_in(Path("bag"))) as recording:
    assert [found.name for found in select_topics(recording.topics).played] == [name], "replays play it"
assert "| `mean_risk` | `MeanRisk` | mean risk of the map | `gp_node` |" in tables.topics()
"""


def test_a_topic_is_a_row_a_message_and_a_value(tmp_path: Path) -> None:
    for package in ("common", "record", "msgs"):
        name = f"auv_lse_{package}"
        source = ROOT / name / ("msg" if package == "msgs" else name)
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(source, tmp_path / name / source.name, ignore=ignored)
    text = PAGE.read_text()
    (message,) = re.findall(r"```text\n(.*?)```", text, re.DOTALL)
    value, row, program = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    (tmp_path / "auv_lse_msgs" / "msg" / "MeanRisk.msg").write_text(message)
    topics = tmp_path / "auv_lse_common" / "auv_lse_common" / "topics"
    with (topics / "records.py").open("a") as file:
        file.write(f"\n\n{value}")
    table = (topics / "table.py").read_text()
    table = table.replace("records import (", "records import (\n    MeanRisk,", 1)
    table = table.replace("records import BoundReport", "records import MeanRisk, BoundReport", 1)
    assert table.count("\n)  # fmt: skip\n\n_VEHICLE_NODES") == 1
    table = table.replace("\n)  # fmt: skip\n\n_VEHICLE_NODES", f"\n{row})  # fmt: skip\n\n_VEHICLE_NODES")
    (topics / "table.py").write_text(table)
    copies = [str(tmp_path / f"auv_lse_{package}") for package in ("common", "record")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([*copies, *sys.path])}

    def run(code: str, *arguments: str) -> str:
        command = [sys.executable, "-c", code, *arguments]
        done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    run(CHECK)
    assert run(program, "bag") == "auv2 at 1.5 s: 0.250\nauv2 at 2.5 s: 0.125\n"
