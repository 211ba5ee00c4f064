"""What several of the simulator's tests are made from."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer

from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.extent import Extent
from auv_lse_record.recording import MISSION_FILE, SOFTWARE
from auv_lse_shore.campaign.spec import CampaignSpec

#: Parameters of a mission that takes a moment.
TINY = {
    "mission.steps": 2,
    "mission.vehicles": 2,
    "planner.iterations": 10,
    "gp.map_resolution_m": 20.0,
    "area.polygon_m": [-50.0, -50.0, 200.0, -50.0, 200.0, 200.0, -50.0, 200.0],
    "area.raster_m": 5.0,
    "sim.ideal": True,
}


def spec_of(tmp_path: Path, **content: Any) -> CampaignSpec:
    """A campaign of tiny missions."""
    return CampaignSpec.from_mapping({"set": TINY, **content}, "test.yaml", tmp_path, "test")


class FunctionGround:
    """Ground given by a function of north and east (m).

    Args:
        function: Depth (m) of arrays of north and east of the same shape.
        extent: Where it holds; NaN outside.
        name: What to call it.
    """

    def __init__(self, function: Callable[[Array, Array], Array], extent: Extent, name: str = "function") -> None:
        """Takes the function as it is."""
        self._function = function
        self._extent = extent
        self._name = name

    @property
    def extent(self) -> Extent:
        """Where the function holds."""
        return self._extent

    @property
    def origin(self) -> None:
        """Nowhere on Earth."""
        return None

    def depth_m(self, north_m: Any, east_m: Any) -> Array:
        """The function's value inside the extent, NaN outside."""
        north, east = np.broadcast_arrays(np.asarray(north_m, float), np.asarray(east_m, float))
        e = self._extent
        inside = (north >= e.north_min_m) & (north <= e.north_max_m) & (east >= e.east_min_m) & (east <= e.east_max_m)
        return np.where(inside, self._function(north, east), np.nan)

    def describe(self) -> str:
        """Its name and extent."""
        return f"{self._name} over {self._extent.height_m:g} m x {self._extent.width_m:g} m"


def other_bag(source: Path, to: Path, plugin: StoragePlugin) -> None:
    """The same messages as `ros2 bag record` would leave them: other storage, log times of a wall clock, no texts."""
    with AnyReader([source]) as reader, Writer(to, version=9, storage_plugin=plugin) as writer:
        connections = {}
        for number, (c, _, data) in enumerate(reader.messages()):
            if c.topic in (MISSION_FILE, SOFTWARE):
                continue
            if c.topic not in connections:
                connections[c.topic] = writer.add_connection(c.topic, c.msgtype, typestore=reader.typestore)
            writer.write(connections[c.topic], 1_700_000_000 * 10**9 + number * 10**6, data)
