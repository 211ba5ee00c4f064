"""The live view's page in a real browser: what it shows, its keys, small and large windows, lost connections."""

from __future__ import annotations

import json
import re
import time

import numpy as np
import pytest
from browser import CHROMIUM, ORIGIN, Browser, at, pixels, serving_of, text

from auv_lse_common.vocabulary.frames import geodetic_from_local

pytestmark = pytest.mark.skipif(not CHROMIUM, reason="needs Chromium (Debian, Ubuntu: sudo apt install chromium)")


@pytest.fixture(scope="module")
def serving(tmp_path_factory, synthetic_run):
    serving = serving_of(synthetic_run(), tmp_path_factory.mktemp("page") / "a run")
    yield serving
    serving.stop()


@pytest.fixture(scope="module")
def browser(tmp_path_factory, serving):
    with Browser(tmp_path_factory.mktemp("chromium")) as browser:
        browser.size(1366, 768)
        browser.open(serving.url)
        browser.wait("window.liveView && liveView.store.list('map', 2).length > 10", "the whole recording")
        yield browser


def test_it_shows_the_mission_and_reports_no_error(browser):
    at(browser, 200.0)
    assert text(browser, "title") == "a run"
    assert text(browser, "map-title") == "Map of auv1, 15 m isobath"
    assert text(browser, "risk-title") == "Expected loss of each map (cost per location)"
    assert text(browser, "state") == "recording"
    assert browser.ask("document.querySelectorAll('.vehicle').length") == 2
    assert "12 of 30" in text(browser, "vehicles")
    assert text(browser, "slots-words").startswith("Slot of auv")
    assert browser.ask("[...document.querySelectorAll('#layers button')].map(b => b.textContent)") == [
        "Expected loss",
        "P(deep enough)",
        "Depth",
        "Standard deviation",
    ]
    assert browser.ask("document.getElementById('problem').hidden")
    assert browser.errors == []
    for canvas in ("map", "slots", "reward", "risk"):
        shown = pixels(browser, canvas)
        assert len(np.unique(shown.reshape(-1, 4), axis=0)) > 20, f"{canvas} is blank"


def test_before_a_mission_it_shows_nothing_but_what_it_waits_for(browser):
    shown = (
        "['map-part', 'charts', 'water', 'alarms', 'team-title', 'time', 'waiting'].filter("
        "(id) => document.getElementById(id).checkVisibility({visibilityProperty: true}))"
    )
    assert browser.ask(shown) == ["map-part", "charts", "water", "alarms", "team-title", "time"]
    facts = "liveView.store.facts"
    browser.ask(f"(window.facts = {facts}, {facts} = null, liveView.store.changes++)")
    browser.wait("document.documentElement.hasAttribute('data-waiting')")
    browser.wait("!document.getElementById('waiting').hidden")
    assert browser.ask(shown) == ["waiting"]
    browser.ask(f"({facts} = window.facts, liveView.store.changes++)")
    browser.wait("document.getElementById('waiting').hidden")
    assert browser.errors == []


def test_a_reward_is_shown_with_what_the_terminal_shows(browser):
    at(browser, 200.0)
    assert text(browser, "reward-title") == "Path reward (cost)"
    assert re.match(r"Now: so far \d+", text(browser, "reward-words"))
    browser.ask("(liveView.store.facts.reward_of = 'map', liveView.store.changes++)")
    at(browser, 201.0)
    assert text(browser, "reward-title") == "Map reward (cost)"
    words = text(browser, "reward-words")
    assert re.match(r"Now: so far \d+, expected \d+ \(dashed\)\. Drop of the map", words), "its bound is not known here"
    browser.ask("(liveView.store.facts.reward_of = 'path', liveView.store.changes++)")


def test_the_position_under_the_pointer_has_latitude_and_longitude(browser):
    at(browser, 200.0)
    for x, y, scale in ((150, 120, 0), (400, 330, 0.02)):  # the second is kilometres away
        browser.ask(f"liveView.map.view = {scale} && {{north: 0, east: 0, scale: {scale}}}")
        position = browser.ask(
            f"(liveView.map.probe = {{x: {x}, y: {y}}}, liveView.map.projection().position({x}, {y}))"
        )
        at(browser, 200.0)
        found = re.search(r"(\d+\.\d+)° N, (\d+\.\d+)° W", text(browser, "readout"))
        latitude, longitude = float(found[1]), -float(found[2])
        assert (latitude, longitude) == pytest.approx(
            [float(v) for v in geodetic_from_local(position["north"], position["east"], *ORIGIN)], abs=1e-5
        )
    browser.ask("(liveView.map.probe = null, liveView.map.fit())")


def test_a_packet_is_not_missed_by_a_vehicle_whose_data_are_not_there(browser):
    """As in the recording of one vehicle of a team."""
    lists = "['pose', 'received'].map((kind) => liveView.store.list(kind, 2))"
    sent_s = browser.ask("liveView.store.list('sent', 1).at(-3).t")
    browser.ask(f"(window.kept = {lists}.map((list) => list.splice(0)), liveView.store.changes++)")
    at(browser, sent_s + 9.0)
    assert text(browser, "slots-words").endswith("no data of auv2.")
    browser.ask(f"({lists}.forEach((list, i) => list.push(...kept[i])), liveView.store.changes++)")
    at(browser, sent_s + 9.0)
    assert re.search("(received|missed) by auv2", text(browser, "slots-words"))


def test_twenty_vehicles_are_on_one_screen(browser, serving):
    browser.size(1366, 768)
    browser.ask(
        "(facts => liveView.store.add({...facts, kind: 'mission', vehicles: "
        "[...Array(20)].map((_, i) => ({number: i + 1, depth_m: 3}))}))(liveView.store.facts)"
    )
    browser.wait("document.querySelectorAll('.vehicle').length === 20")
    browser.wait("!!document.querySelector('.vehicle[aria-pressed=true] dl')", "the chosen vehicle's card")
    seen = browser.ask("[...document.querySelectorAll('.vehicle')].map(card => card.getBoundingClientRect().bottom)")
    assert max(seen) < browser.ask("document.querySelector('footer').getBoundingClientRect().top") * 0.6
    assert browser.ask("document.querySelector('.vehicle[aria-pressed=true] dl').getBoundingClientRect().height") > 20
    assert browser.errors == []
    browser.open(serving.url)
    browser.wait("window.liveView && liveView.store.list('map', 2).length > 10", "the whole recording")


def test_the_map_changes_with_the_moment_the_layer_and_the_vehicle(browser):
    at(browser, 60.0)
    early = pixels(browser, "map")
    at(browser, 400.0)
    late = pixels(browser, "map")
    assert (early != late).any(axis=2).mean() > 0.1
    browser.press("d")
    at(browser, 400.0)
    assert browser.ask("document.querySelector('#layers [aria-checked=true]').textContent") == "Depth"
    assert (pixels(browser, "map") != late).any(axis=2).mean() > 0.1
    browser.press("r")
    browser.press("2")
    at(browser, 400.0)
    assert text(browser, "map-title").startswith("Map of auv2,")
    assert browser.ask("document.querySelectorAll('.vehicle[aria-pressed=true]').length") == 1
    browser.press("1")
    browser.press("+")
    at(browser, 400.0)
    assert (pixels(browser, "map") != late).any(axis=2).mean() > 0.1
    browser.press("0")
    at(browser, 400.0)
    assert (pixels(browser, "map") == late).all()


def test_keys_move_through_time(browser):
    at(browser, 100.0)
    browser.press("ArrowRight")
    assert browser.ask("liveView.player.t") == 110.0
    browser.press("ArrowLeft", shift=True)
    assert browser.ask("liveView.player.t") == 50.0
    browser.press("Home")
    assert browser.ask("liveView.player.t") == 0.0
    browser.press(" ")
    browser.wait("liveView.player.t > 2", "it plays")
    browser.press(" ")
    stopped = browser.ask("liveView.player.t")
    time.sleep(0.1)
    assert browser.ask("liveView.player.t") == stopped
    browser.press("End")
    assert browser.ask("liveView.player.t === liveView.store.lastS")
    spoken = "document.getElementById('time').getAttribute('aria-valuetext')"
    browser.wait(
        spoken,
        "the slider says the time",
        good=lambda value: value == f"{value.split(' of ')[1]} of " + value.split(" of ")[1],
    )


def test_everything_can_be_reached_by_keys_and_has_a_name(browser):
    names = browser.ask(
        "[...document.querySelectorAll('button, input, select, canvas:not([aria-hidden])')].map((e) => "
        "e.textContent.trim() || e.getAttribute('aria-label') || e.getAttribute('aria-describedby') || "
        "e.closest('label')?.textContent)"
    )
    assert len(names) > 15
    assert all(names)
    browser.press("?")
    assert browser.ask("document.getElementById('help').open")
    browser.ask("document.getElementById('help').close()")


@pytest.mark.parametrize(
    ("width", "height"), [(1366, 768), (1920, 1080), (1100, 800), (820, 1180), (390, 844), (320, 568)]
)
def test_nothing_is_cut_off_sideways(browser, width, height):
    browser.size(width, height, mobile=width < 900)
    at(browser, 200.0)
    assert browser.ask("document.documentElement.scrollWidth") <= width
    assert browser.ask("document.getElementById('map').clientHeight") > 200
    assert browser.ask("document.getElementById('play').getBoundingClientRect().bottom") <= height + 1
    beyond = browser.ask(
        "[...document.querySelectorAll('.vehicle dd')].filter((dd) => dd.scrollWidth > dd.clientWidth || "
        "dd.getBoundingClientRect().right > dd.closest('.vehicle').getBoundingClientRect().right - 4)"
        ".map((dd) => dd.textContent)"
    )
    assert beyond == [], "a card ends before its text"
    browser.size(1366, 768)


def test_dots_on_one_another_are_drawn_once(browser):
    """The work of a frame is bounded by the screen, not by the mission's samples."""
    at(browser, 200.0)
    added = browser.ask(
        """(() => {
          const { store, map } = liveView, list = store.list("samples", map.vehicle);
          const positions = Array(20000).fill(500);
          const event = { kind: "samples", vehicle: map.vehicle, source: 2, t: 150, positions };
          map.draw(200);
          const before = map.dotCount;
          store.insert(event);
          map.draw(200);
          list.splice(list.indexOf(event), 1);
          return [before, map.dotCount - before];
        })()"""
    )
    assert added[0] > 5, "others are there"
    assert added[1] <= 1


def test_a_line_is_drawn_without_the_points_that_do_not_show(browser):
    drawn = browser.ask(
        """(() => {
          const { Pen } = liveView, thinned = (line) => {
            const kept = [], pen = new Pen({ lineTo: (x, y) => kept.push([x, y]) });
            for (const position of line) pen.to(...position);
            pen.end();
            return kept;
          };
          const away = ([x, y], [ax, ay], [bx, by]) => {
            const long = (bx - ax) ** 2 + (by - ay) ** 2, along = (x - ax) * (bx - ax) + (y - ay) * (by - ay);
            const at = Math.min(1, Math.max(0, along / (long || 1)));
            return Math.hypot(x - ax - at * (bx - ax), y - ay - at * (by - ay));
          };
          const off = (line, kept) => Math.max(...line.map((position) =>
            Math.min(...kept.map((from, i) => away(position, from, kept[i + 1] ?? from)))));
          const steps = [...Array(1000).keys()], straight = steps.map((i) => [i / 3, i / 7]);
          const loop = steps.map((i) => [200 + 90 * Math.cos(i / 40), 200 + 60 * Math.sin(i / 40)]);
          const rough = steps.map((i) => [i / 2, 40 * Math.sin(i / 9) + (i * 7919) % 5]);
          const still = steps.map(() => [5, 5]), back = [...straight, ...straight.toReversed()];
          return Object.fromEntries(Object.entries({ straight, loop, rough, still, back }).map(([name, line]) => {
            const kept = thinned(line);
            return [name, [kept.length, off(line, kept), kept.at(-1).join() === line.at(-1).join()]];
          }));
        })()"""
    )
    assert all(off < 0.26 and ends for _, off, ends in drawn.values()), "a quarter of a pixel does not show"
    counts = {name: count for name, (count, _, _) in drawn.items()}
    assert (counts["straight"], counts["still"], counts["back"]) == (2, 2, 3)
    assert counts["loop"] < 300
    assert counts["rough"] > 300, "it really bends"


def test_a_planners_last_warning_ends_with_the_mission(browser, serving):
    end = browser.ask("liveView.store.lastS + 10")

    def add(kind, t, vehicle, **values):
        browser.ask(f"liveView.store.add({json.dumps({'kind': kind, 't': t, 'vehicle': vehicle, **values})})")

    def card(t):
        at(browser, t)
        return browser.ask("document.querySelectorAll('.vehicle')[1].textContent")

    add("health", end - 5, 2, node="planner_node", level="warning", text="outside")
    for vehicle in (1, 2):
        add("run", end + vehicle, vehicle, state="ended", reason="", limits=[], warnings=[])
        add("pose", end + 5, vehicle, north=0, east=0, heading=0)
    assert "planner_node: outside" in card(end + 1), "vehicle 2 still flies"
    assert "1 active" in text(browser, "alarms")
    assert "planner_node" not in card(end + 3)
    assert "0 active" in text(browser, "alarms")
    add("health", end - 5, 2, node="modem_node", level="warning", text="outside")
    assert "modem_node: outside" in card(end + 3), "other nodes still work"
    browser.open(serving.url)
    browser.wait("window.liveView && liveView.store.list('map', 2).length > 10", "the whole recording")


def test_an_abort_makes_one_alarm_and_an_old_missed_slot_none(browser, serving):
    end = browser.ask("liveView.store.lastS + 10")
    rows = "[...document.querySelectorAll('#alarms tbody td[data-level]')].map(cell => cell.textContent)"

    def add(kind, t, **values):
        browser.ask(f"liveView.store.add({json.dumps({'kind': kind, 't': t, 'vehicle': 2, **values})})")

    def note(t):
        at(browser, t)
        return browser.ask("document.querySelectorAll('.vehicle')[1].querySelector('.note').textContent")

    at(browser, end)
    before = browser.ask(rows)
    run = {"warnings": ["fence: 3 m outside; the margin is 5 m"], "limits": ["depth: 9 m; limit 8 m"]}
    known = "depth: 9 m; limit 8 m (latched until RESET); fence: 4 m outside; the margin is 5 m"
    planner = "not planning: the mission is ABORTED: ABORT by shore; twice"
    for t in range(0, 400, 10):
        add("pose", end + t, north=0, east=0, heading=0)
    add("slots", end, missed=0)
    add("slots", end + 1, missed=1)
    add("run", end + 2, state="aborted", reason="ABORT by shore; twice", limits=[], warnings=[])
    add("health", end + 3, node="safety_node", level="error", text="ABORT by shore; twice")
    add("health", end + 3, node="planner_node", level="warning", text=planner)
    assert note(end + 5) == "1 slot missed in the last 2 min"
    assert browser.ask(rows) == ["✖ aborted: ABORT by shore; twice", *before]
    assert note(end + 200) == "", "an old miss is in the slots' strip"
    add("run", end + 210, state="aborted", reason="ABORT by shore; twice", **run)
    add("health", end + 211, node="safety_node", level="error", text=f"storage: no space; {known}")
    add("health", end + 211, node="planner_node", level="warning", text=f"no map yet; {planner}")
    expected = "safety_node: storage: no space; planner_node: no map yet; limit tripped: depth: 9 m; limit 8 m"
    assert note(end + 212) == expected
    assert set(browser.ask(rows)[:4]) == {
        "⚠ limit exceeded: fence: 3 m outside; the margin is 5 m",
        "✖ limit tripped: depth: 9 m; limit 8 m",
        "✖ safety_node: storage: no space",
        "⚠ planner_node: no map yet",
    }
    browser.open(serving.url)
    browser.wait("window.liveView && liveView.store.list('map', 2).length > 10", "the whole recording")


def test_a_card_has_a_row_of_the_battery_where_its_charge_is_known(browser, serving):
    end = browser.ask("liveView.store.lastS + 10")
    rows = "[...document.querySelectorAll('.vehicle dt:not([hidden])')].filter((e) => e.textContent === 'battery')"
    shown = f"{rows}.map((e) => [e.closest('.vehicle').textContent.slice(0, 4), e.nextSibling.hidden])"
    assert browser.ask(shown) == []
    values = {"legs left by battery": "31"}
    event = {"kind": "health", "t": end, "vehicle": 2, "node": "safety_node", "level": "ok", "text": ""}
    browser.ask(f"liveView.store.add({json.dumps({**event, 'values': values})})")
    at(browser, end + 1)
    assert browser.ask(shown) == [["auv2", False]]
    browser.open(serving.url)
    browser.wait("window.liveView && liveView.store.list('map', 2).length > 10", "the whole recording")


def test_a_vehicles_number_stays_within_the_map(browser, serving):
    browser.ask(
        "window.ends = []; const draw = CanvasRenderingContext2D.prototype.fillText;"
        "CanvasRenderingContext2D.prototype.fillText = function (text, x, ...more) {"
        " if (text === '2' && this.canvas.id === 'map')"
        "  ends.push(this.canvas.clientWidth - x - this.measureText(text).width);"
        " return draw.call(this, text, x, ...more); };"
    )
    end = browser.ask("liveView.store.lastS + 10")
    edge = browser.ask("liveView.map.projection().position(document.getElementById('map').clientWidth - 15, 100)")
    pose = {"kind": "pose", "t": end, "vehicle": 2, **edge, "heading": 0}
    browser.ask(f"liveView.store.add({json.dumps(pose)})")
    at(browser, end + 1)
    assert browser.ask("ends.at(-1)") > 10.0
    browser.open(serving.url)
    browser.wait("window.liveView && liveView.store.list('map', 2).length > 10", "the whole recording")


def test_while_events_arrive_it_draws_seldom(browser, serving):
    serving.timeline.set_state(reading=True)
    browser.wait("document.getElementById('state').textContent === 'loading'")
    drawn, took_ms = browser.ask(
        """new Promise((done) => {
          const { store, map } = liveView, began = performance.now();
          let drawn = 0, frames = 0;
          map.draw = function (t) {
            drawn++;
            Object.getPrototypeOf(this).draw.call(this, t);
          };
          const next = () => {
            store.changes++;
            if (frames++ < 80) return requestAnimationFrame(next);
            delete map.draw;
            done([drawn, performance.now() - began]);
          };
          next();
        })"""
    )
    assert 1 <= drawn <= took_ms / 500.0 + 2.0
    serving.timeline.set_state(reading=False)
    browser.wait("document.getElementById('state').textContent === 'recording'")


def test_a_watched_team_has_a_table_alarms_with_a_sound_and_expected_positions(browser, serving):
    cells = ["RUNNING", "120, 90 expected", "5.0 m", "80 %", "340 s", "under water"]
    rows = [
        {"number": 1, "cells": ["RUNNING", "3, 4", "0.2 m", "80 %", "1 s", "up"], "expected": None},
        {"number": 2, "cells": cells, "expected": [120.0, 90.0]},
    ]
    team = {"columns": ["state", "north, east", "depth", "battery", "age", "link"], "vehicles": rows, "lines": []}
    browser.ask(
        "window.drawnTexts = new Set(); window.tones = 0;"
        "const draw = CanvasRenderingContext2D.prototype.fillText;"
        "CanvasRenderingContext2D.prototype.fillText = function (text, ...more) {"
        " drawnTexts.add(text); return draw.call(this, text, ...more); };"
        "const start = OscillatorNode.prototype.start;"
        "OscillatorNode.prototype.start = function () { tones++; return start.call(this); }"
    )
    assert browser.ask("document.getElementById('team').hidden"), "a single mission has no table"
    serving.timeline.set_state(source="team", growing=True, team=team)
    browser.wait("document.getElementById('team').textContent.includes('under water')")
    assert "auv2RUNNING120, 90 expected" in text(browser, "team").replace(" auv2", "auv2")
    browser.ask("liveView.player.follow()")
    browser.wait("drawnTexts.has('2 expected')", "the vehicle that is away is marked")
    assert not browser.ask("drawnTexts.has('1 expected')")
    browser.ask("document.getElementById('sound').click()")
    before = browser.ask("tones")
    serving.timeline.set_state(team={**team, "lines": ["auv1: ABORTED: leak"]})
    browser.wait("document.querySelector('#team [role=alert]').textContent === 'auv1: ABORTED: leak'")
    assert browser.ask("tones") == before + 1
    serving.timeline.set_state(team={**team, "lines": ["auv1: ABORTED: leak"], "vehicles": rows[::-1]})
    browser.wait("document.querySelector('#team tbody').textContent.trim().startsWith('auv2')")
    assert browser.ask("tones") == before + 1, "an alarm that is known makes no sound"
    serving.timeline.set_state(source="recording", growing=False, team=None)
    browser.wait("document.getElementById('team').hidden")
    at(browser, 200.0)


def test_text_is_legible_in_both_themes(browser):
    def luminance(color):
        parts = [int(color[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
        linear = [p / 12.92 if p <= 0.03928 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
        return float(np.dot(linear, (0.2126, 0.7152, 0.0722)))

    of = "getComputedStyle(document.documentElement).getPropertyValue('--{}').trim()"
    for scheme in ("dark", "light"):
        browser.media(prefers_color_scheme=scheme)
        browser.wait(f"document.documentElement.hasAttribute('data-dark') === {str(scheme == 'dark').lower()}")
        for ink in ("ink", "soft", "accent", "ok", "warn", "bad"):
            for paper in ("paper", "card"):
                pair = sorted(luminance(browser.ask(of.format(name))) for name in (ink, paper))
                contrast = (pair[1] + 0.05) / (pair[0] + 0.05)
                assert contrast >= 4.5, f"{scheme}: {ink} on {paper}: {contrast:.1f}; expected WCAG's 4.5"


def test_connection_lost_mission_complete_new_mission(browser, serving):
    have = browser.ask("liveView.store.list('pose', 1).length")
    serving.stop()
    browser.wait("document.getElementById('state').textContent.includes('connection lost')")
    serving.start()
    browser.wait("document.getElementById('state').textContent === 'recording'", "connected again")
    assert browser.ask("liveView.store.list('pose', 1).length") == have > 0, "it went on where it was"
    serving.timeline.add(
        [{"kind": "status", "t": 1e4, "state": "finished", "text": "", "steps": [30, 30], "speed": 1.0}]
    )
    serving.timeline.set_state(source="mission", growing=False, run="runs/first")
    browser.wait("document.getElementById('state').textContent === 'mission complete'")
    assert browser.ask("document.getElementById('ending').hidden"), "the page is still connected"
    early = "the quality asked for was reached: 80 % found"
    serving.timeline.add(
        [{"kind": "status", "t": 1e4 + 1, "state": "finished", "text": early, "steps": [12, 12], "speed": 1.0}]
    )
    browser.wait(f"document.getElementById('ending').textContent === 'Mission complete: {early}.'")
    assert not browser.ask("document.getElementById('ending').hidden")
    serving.timeline.add(
        [{"kind": "status", "t": 1e4 + 2, "state": "finished", "text": "", "steps": [30, 30], "speed": 1.0}]
    )
    browser.wait("document.getElementById('ending').hidden")
    serving.stop()
    browser.wait("!document.getElementById('ending').hidden", "the live view has ended with the mission")
    assert text(browser, "state") == "mission complete"
    assert "auv_lse live runs/first" in text(browser, "ending")
    serving.start()
    browser.wait("document.getElementById('ending').hidden", "connected again")
    _, _, events = serving.timeline.since("", 0, 1)
    serving.timeline.begin({**events[0], "name": "the next one"})
    browser.wait("document.getElementById('title').textContent === 'the next one'")
    assert browser.ask("liveView.store.list('pose', 1).length") == 0
