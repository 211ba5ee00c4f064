"""The shipped layouts of RViz and Foxglove name topics that the nodes publish, with types that these programs show."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from auv_lse_common.topics.table import find_topic
from auv_lse_record.message_types import project_types
from auv_lse_run.shipped_files import shipped_file

#: RViz's display of a type has its name, except for a map.
RVIZ = {"Map": "OccupancyGrid"}
#: Types that Foxglove's 3D panel draws, of those that the stack publishes.
DRAWN = {"OccupancyGrid", "Marker", "Odometry", "Path"}


def kind_of(topic: str) -> str:
    found = find_topic(topic)
    assert found is not None, f"no node publishes {topic}"
    return found.topic.kind


def test_rviz_shows_topics_of_the_nodes_as_they_are_delivered() -> None:
    layout = yaml.safe_load(Path(shipped_file("mission.rviz")).read_text())
    displays = [d for d in layout["Visualization Manager"]["Displays"] if "Topic" in d]
    assert len(displays) == 15
    for display in displays:
        name, shown = display["Topic"]["Value"], display["Class"].split("/")[1]
        assert kind_of(name).endswith("/" + RVIZ.get(shown, shown)), name
        latched = display["Topic"]["Durability Policy"] == "Transient Local"
        assert latched == find_topic(name).topic.latched, name


def test_foxglove_draws_topics_and_plots_fields_of_the_nodes() -> None:
    panels = json.loads(Path(shipped_file("mission.json")).read_text())["configById"]
    for topic in panels["3D!map"]["topics"]:
        assert kind_of(topic).split("/")[-1] in DRAWN, topic
    store, plots = project_types(), [panel for name, panel in panels.items() if name.startswith("Plot!")]
    for path in (path for plot in plots for path in plot["paths"]):
        topic, _, field = path["value"].rpartition(".")
        assert field in {name for name, _ in store.fielddefs[kind_of(topic)][1]}, path["value"]
    assert kind_of(panels["DiagnosticSummary!health"]["topicToRender"]).endswith("/DiagnosticArray")
    assert {kind_of(topic) for topic in panels["map!earth"]["topicColors"]} == {"sensor_msgs/msg/NavSatFix"}


@pytest.mark.parametrize("name", ["mission.rviz", "mission.json"])
def test_every_vehicle_of_three_is_shown(name: str) -> None:
    text = Path(shipped_file(name)).read_text()
    assert all(f"/auv{k}/{topic}" in text for k in (1, 2, 3) for topic in ("risk_map", "isobath", "path", "packets"))
