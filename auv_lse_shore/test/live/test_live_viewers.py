"""Standard messages for RViz and Foxglove: what they hold, what the layouts name, and who serves them."""

from __future__ import annotations

import asyncio
import importlib.util
import json
import re
import socket
import struct
import threading
from pathlib import Path

import numpy as np
import pytest
import yaml
from rosbags.typesys import Stores, get_typestore
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect

from auv_lse_record.recording import recording_in
from auv_lse_record.run_writer import write_run
from auv_lse_shore.live.sources.follow import RecordingFollower
from auv_lse_shore.live.sources.timeline import Timeline
from auv_lse_shore.live.viewers import foxglove_viewer
from auv_lse_shore.live.viewers.feed import Feed, Playback
from auv_lse_shore.live.viewers.foxglove_viewer import FoxgloveError, FoxgloveViewer
from auv_lse_shore.live.viewers.standard_messages import StandardMessages

ROOT = Path(__file__).resolve().parents[3]
STORE = get_typestore(Stores.ROS2_JAZZY)


@pytest.fixture(scope="module")
def timeline(tmp_path_factory, synthetic_run):
    folder, timeline = tmp_path_factory.mktemp("viewers") / "run", Timeline()
    write_run(synthetic_run(steps=12), folder)
    RecordingFollower(recording_in(folder), timeline).follow(threading.Event())
    return timeline


@pytest.fixture(scope="module")
def told(timeline):
    """Every message of the mission, by topic, read again from its bytes."""
    _, _, events = timeline.since("", 0, 10**6)
    messages, found = StandardMessages(events[0]), {}
    for message in [*messages.first(0.0), *(m for e in events[1:] for m in messages.take(e))]:
        found.setdefault(message.topic, []).append((message.kind, STORE.deserialize_cdr(message.data, message.kind)))
    return events, found


def test_with_an_origin_the_map_panel_gets_area_isobath_and_vehicles_on_earth(timeline, told):
    _, without = told
    assert not [topic for topic in without if "geojson" in topic or "navsat" in topic], "its origin is unknown"
    _, _, (facts, *events) = timeline.since("", 0, 10**6)
    messages = StandardMessages({**facts, "origin_deg": [46.5, 6.6]})
    found = {m.topic: m for m in [*messages.first(0.0), *(m for e in events for m in messages.take(e))]}
    area = json.loads(found["/viz/geojson/area"].data)["features"][0]
    assert area["properties"]["name"] == "operating area"
    (ring,) = area["geometry"]["coordinates"]
    north, east = 0.1 * facts["area"][0], 0.1 * facts["area"][1]
    assert ring[0] == ring[-1] == pytest.approx([6.6 + east / 76_800, 46.5 + north / 111_170], abs=5e-5), "lon, lat"
    isobath = json.loads(found["/viz/geojson/auv1/isobath"].data)["features"]
    assert {"shallow edge", "deep edge"} & {feature["properties"]["name"] for feature in isobath}
    last = [e for e in events if e["kind"] == "pose" and e["vehicle"] == 1][-1]
    navsat = STORE.deserialize_cdr(found["/viz/auv1/navsat"].data, "sensor_msgs/msg/NavSatFix")
    assert navsat.latitude == pytest.approx(46.5 + last["north"] / 111_170, abs=5e-5)
    assert navsat.longitude == pytest.approx(6.6 + last["east"] / 76_800, abs=5e-5)


@pytest.mark.skipif(importlib.util.find_spec("foxglove") is None, reason="needs foxglove-sdk (an optional dependency)")
def test_foxglove_serves_the_geojson_in_its_own_schema(timeline):
    _, _, (facts, *_) = timeline.since("", 0, 10**6)
    messages = StandardMessages({**facts, "origin_deg": [46.5, 6.6]})
    viewer = FoxgloveViewer(free_port(), Playback(1.0))

    async def talk():
        request = HTTPRequest(viewer.url, headers={"Sec-WebSocket-Protocol": "foxglove.sdk.v1"})
        socket_, number = await websocket_connect(request), None
        while True:
            data = await socket_.read_message()
            assert data is not None
            message = json.loads(data) if isinstance(data, str) else {}
            for channel in message.get("channels", []):
                if channel["topic"] == "/viz/geojson/area":
                    assert channel["schemaName"] == "foxglove.GeoJSON"
                    number = channel["id"]
                    subscription = {"id": 7, "channelId": number}
                    await socket_.write_message(json.dumps({"op": "subscribe", "subscriptions": [subscription]}))
            if not isinstance(data, str) and data[0] == 1 and struct.unpack_from("<I", data, 1)[0] == 7:
                socket_.close()
                return data[13:]

    try:
        viewer.begin(messages, 0.0, 0.0)
        for message in messages.first(0.0):
            viewer.show(message)
        payload = asyncio.run(asyncio.wait_for(talk(), 20.0))
    finally:
        viewer.close()
    text = payload[payload.index(b"{") :]  # protobuf: field 1, its length, the text
    assert json.loads(text)["features"][0]["properties"]["name"] == "operating area"


def test_they_hold_what_the_page_shows(told):
    events, found = told
    poses = [e for e in events if e["kind"] == "pose" and e["vehicle"] == 1]
    last = found["/viz/auv1/pose"][-1][1]
    assert (last.pose.position.y, last.pose.position.x) == (poses[-1]["north"], poses[-1]["east"]), "ENU"
    maps = [e for e in events if e["kind"] == "map" and e["vehicle"] == 2]
    grid = found["/viz/auv2/risk_map"][-1][1]
    assert (grid.info.width, grid.info.height) == (maps[-1]["columns"], maps[-1]["rows"])
    inside = grid.data[grid.data >= 0]
    assert inside.max() <= 100
    percent = 100.0 * maps[-1]["expected_loss"] / events[0]["largest_risk"]
    assert np.mean(inside) == pytest.approx(percent, abs=0.5), "rounded to whole percent"
    actions, rest = found["/viz/auv1/plan/actions"][0][1], found["/viz/auv1/plan/continuation"][0][1]
    per = events[0]["points_per_leg"]
    assert (len(actions.poses), len(rest.poses)) == (3 * per + 1, 9 * per + 1)
    assert actions.poses[-1].pose.position == rest.poses[0].pose.position
    heard = [m for _, array in found["/viz/packets"] for m in array.markers if m.ns.startswith("received")]
    assert len(heard) == len([e for e in events if e["kind"] == "received"])
    assert all(m.lifetime.sec == 10 for m in heard)


def test_the_layouts_name_topics_that_there_are(told):
    _, found = told
    layout = (ROOT / "config" / "foxglove" / "mission.json").read_text()
    json.loads(layout)
    rviz = yaml.safe_load((ROOT / "config" / "rviz" / "mission.rviz").read_text())
    displays = {d["Topic"]["Value"]: d["Class"] for d in rviz["Visualization Manager"]["Displays"] if "Topic" in d}
    named = set(displays) | {name.removesuffix(".data") for name in re.findall(r'"(/viz/[\w/]+(?:\.data)?)"', layout)}
    known = set(found) | {"/viz/diagnostics"}  # a recording of the fleet engine has none
    known |= {f"/viz/auv{k}/navsat" for k in (1, 2)}  # its origin is unknown
    assert {re.sub("auv3", "auv1", name) for name in named} <= known
    kinds = {"Map": "OccupancyGrid", "Path": "Path", "MarkerArray": "MarkerArray", "Polygon": "PolygonStamped"}
    for topic, display in displays.items():
        kind = found[re.sub("auv3", "auv1", topic)][0][0]
        assert kind.endswith("/" + kinds[display.split("/")[1]]), topic


def test_without_foxglove_the_command_that_installs_it_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "foxglove", None)
    with pytest.raises(FoxgloveError, match="pip install foxglove-sdk"):
        FoxgloveViewer(0, Playback(1.0))


@pytest.mark.skipif(importlib.util.find_spec("foxglove") is None, reason="needs foxglove-sdk (an optional dependency)")
def test_foxglove_gets_every_topic_and_its_time_bar_moves_the_recording(timeline):
    playback, stop = Playback(1.0), threading.Event()
    viewer = FoxgloveViewer(free_port(), playback)
    feed = threading.Thread(target=Feed(timeline, [viewer], playback).run, args=(stop,))

    async def talk():
        request = HTTPRequest(viewer.url, headers={"Sec-WebSocket-Protocol": "foxglove.sdk.v1"})
        socket_ = await websocket_connect(request)
        channels, topics, state = {}, set(), None
        wanted_topics = {"/viz/auv1/risk_map", "/viz/auv2/track", "/viz/vehicles", "/viz/true_isobath"}
        await socket_.write_message(
            b"\x03" + struct.pack("<Bf?q", 0, 500.0, True, 100_000_000_000) + struct.pack("<I", 1) + b"x", binary=True
        )
        while not wanted_topics <= topics or state is None:
            data = await socket_.read_message()
            assert data is not None, (topics, state)
            if isinstance(data, str):
                message = json.loads(data)
                if message.get("op") == "serverInfo":
                    assert set(message["capabilities"]) <= {"playbackControl", "time"}, "read-only"
                    assert "playbackControl" in message["capabilities"]
                if message.get("op") == "advertise":
                    new = {c["id"]: c["topic"] for c in message["channels"]}
                    channels |= new
                    wanted = [{"id": number, "channelId": number} for number in new]
                    await socket_.write_message(json.dumps({"op": "subscribe", "subscriptions": wanted}))
            elif data[0] == 1:
                topics.add(channels[struct.unpack_from("<I", data, 1)[0]])
            elif data[0] == 5:
                state = data
        socket_.close()

    try:
        feed.start()
        for _ in range(100):
            if viewer._server is not None:
                break
            stop.wait(0.1)
        for origin in ("https://evil.example", "null", "file://", "http://localhost.evil.example"):
            foreign = HTTPRequest(viewer.url, headers={"Origin": origin})
            with pytest.raises(HTTPClientError, match="403"):
                asyncio.run(asyncio.wait_for(connect(foreign), 30))
        asyncio.run(asyncio.wait_for(talk(), 30))
        assert playback.t >= 100.0
        with pytest.raises(FoxgloveError, match=r"--foxglove \d+: cannot listen .* Choose another port: --foxglove N"):
            FoxgloveViewer(int(viewer.url.rsplit(":", 1)[1]), playback)
    finally:
        stop.set()
        feed.join(10)


async def connect(request):
    return await websocket_connect(request)


def free_port():
    with socket.create_server((foxglove_viewer.ADDRESS, 0)) as probe:
        return probe.getsockname()[1]
