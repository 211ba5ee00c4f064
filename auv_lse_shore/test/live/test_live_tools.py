"""The live page's tools in a real browser: commands, measuring, graticule, alarms, keyboard, color vision."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from browser import CHROMIUM, ORIGIN, Browser, at, pixels, seen, serving_of, text

from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_shore.live.sources.command_queue import CommandQueue

pytestmark = pytest.mark.skipif(not CHROMIUM, reason="needs Chromium (Debian, Ubuntu: sudo apt install chromium)")

SIZES = [(360, 740), (768, 1024), (1400, 900)]


@pytest.fixture(scope="module")
def serving(tmp_path_factory, synthetic_run):
    serving = serving_of(synthetic_run(), tmp_path_factory.mktemp("tools") / "a run", CommandQueue())
    health = {"kind": "health", "vehicle": 1, "node": "gp_node"}
    state = {"kind": "run", "vehicle": 2, "reason": "", "state": "running", "limits": [], "warnings": []}
    serving.timeline.add(
        [
            {**health, "t": 40.0, "level": "warning", "text": "few soundings"},
            {**health, "t": 50.0, "level": "error", "text": "no soundings for 12 s"},
            {**health, "t": 60.0, "level": "error", "text": "no soundings for 22 s"},
            {**health, "t": 90.0, "level": "ok", "text": ""},
            {**state, "t": 1.0},
            {**state, "t": 100.0, "state": "holding", "reason": "depth", "limits": ["depth: 9.1 m; limit 8 m"]},
            {**state, "t": 130.0, "warnings": ["altitude: 1.4 m"]},
        ]
    )
    yield serving
    serving.stop()


@pytest.fixture(scope="module")
def browser(tmp_path_factory, serving):
    with Browser(tmp_path_factory.mktemp("chromium")) as browser:
        browser.size(1400, 900)
        browser.open(serving.url)
        browser.wait("window.liveView && liveView.store.list('map', 2).length > 10", "the whole recording")
        yield browser
        assert browser.errors == []


@pytest.fixture
def mission(browser, serving):
    """The recording, shown as if it were a running mission that takes commands."""
    serving.commands.open(2)
    serving.timeline.set_state(source="mission", control=True)
    browser.wait(
        "!document.querySelector('#commands .bar').hidden && !document.querySelector('#commands button').disabled"
    )
    yield
    serving.commands.close()
    serving.timeline.set_state(source="recording", control=False)
    browser.wait("document.querySelector('#commands .bar').hidden")


def answer(browser, serving, outcomes):
    """Waits for one command, answers it, and returns what was sent."""
    browser.wait("!!document.querySelector('#commands li')", "the command is sent")
    for _ in range(200):
        if orders := serving.commands.take():
            break
        at(browser, 200.0)
    orders[0].outcomes.set_result(outcomes)
    return orders[0].command.name, orders[0].vehicles


def test_a_recording_has_no_command_buttons(browser):
    at(browser, 200.0)
    assert browser.ask("document.getElementById('commands').getBoundingClientRect().height") == 0


def test_a_command_is_sent_after_confirmation_and_its_outcomes_are_shown(browser, serving, mission):
    browser.ask("document.querySelector('[data-command=abort]').focus()")
    browser.press("Enter")
    browser.wait("document.getElementById('confirm').open")
    assert text(browser, "confirm-title") == "Abort auv1?"
    assert browser.ask("document.activeElement.textContent") == "Cancel", "Enter alone does not abort"
    browser.press("Enter")
    browser.wait("!document.getElementById('confirm').open")
    browser.press("Enter")
    browser.wait("document.getElementById('confirm').open")
    browser.press("Escape")
    browser.wait("!document.getElementById('confirm').open")
    at(browser, 200.0)
    assert serving.commands.take() == []

    browser.ask("document.querySelector('#commands select').value = 'all'")
    browser.press("Enter")
    browser.wait("document.getElementById('confirm').open")
    assert text(browser, "confirm-title") == "Abort all 2 vehicles?"
    browser.press("Tab")
    browser.press("Enter")
    assert answer(browser, serving, {1: ("accepted", "ABORTED"), 2: ("not heard", "no answer within 5 s")}) == (
        "ABORT",
        (1, 2),
    )
    log = "document.querySelector('#commands ol').textContent"
    browser.wait(f"{log}.includes('auv2')", "the outcomes")
    assert "✓ auv1: accepted (ABORTED)✖ auv2: not heard (no answer within 5 s)" in browser.ask(log)


def test_without_the_token_the_page_tells_where_it_is(browser, serving, mission):
    plain = serving.url.split("#")[0]
    browser.open(plain + "?")
    browser.wait("window.liveView && liveView.store.list('map', 2).length > 10", "the whole recording")
    browser.wait("document.querySelector('#commands .bar').hidden && !document.getElementById('commands').hidden")
    assert "open the address that auv_lse live --control printed" in text(browser, "commands")
    browser.open(serving.url)
    browser.wait("window.liveView && liveView.store.list('map', 2).length > 10", "the whole recording")
    browser.wait("!document.querySelector('#commands .bar').hidden", "the token is back")


def test_distances_and_bearings_are_measured_with_keys_and_pointer(browser):
    at(browser, 200.0)
    browser.press("m")
    assert browser.ask("document.activeElement.id") == "map"
    browser.press("Enter")
    for _ in range(3):
        browser.press("ArrowRight")
    browser.press("Enter")
    scale = browser.ask("liveView.map.projection().scale")
    assert text(browser, "measured").startswith(f"{120 / scale:.0f} m, 090°. Click the next position")
    position = browser.ask(
        "(({left, top}) => ({x: left + 200, y: top + 150}))(liveView.map.canvas.getBoundingClientRect())"
    )
    for kind in ("mousePressed", "mouseReleased"):
        browser.call("Input.dispatchMouseEvent", type=kind, button="left", clickCount=1, **position)
    points = browser.ask("liveView.map.measure.points")
    meant = browser.ask("liveView.map.projection().position(200, 150)")
    assert (points[2]["north"], points[2]["east"]) == pytest.approx((meant["north"], meant["east"]), abs=1.0 / scale)
    legs = np.diff([(p["north"], p["east"]) for p in points], axis=0)
    assert f"{np.hypot(*legs.T).sum():.0f} m in all" in text(browser, "measured")
    assert f"{np.degrees(np.arctan2(legs[1][1], legs[1][0])) % 360:03.0f}°" in text(browser, "measured")
    browser.press("Escape")
    assert (text(browser, "measured"), browser.ask("liveView.map.measure.points.length")) == ("", 0)
    browser.press("0")


def test_the_graticule_is_where_latitude_and_longitude_are(browser):
    for north, east in ((0.0, 0.0), (350.0, -420.0), (-4000.0, 9000.0)):
        lat, lon = (float(v) for v in geodetic_from_local(north, east, *ORIGIN))
        found = browser.ask(f"liveView.fromGeodetic({lat}, {lon}, liveView.store.facts.origin_deg)")
        assert (found["north"], found["east"]) == pytest.approx((north, east), abs=0.25)
    at(browser, 200.0)
    shown = pixels(browser, "map")
    browser.ask("(liveView.map.shown.graticule = false, liveView.map.move(0, 0))")
    at(browser, 200.0)
    changed = (pixels(browser, "map") != shown).any(axis=2)
    assert changed.all(axis=0).any() or (changed.mean(axis=0) > 0.7).any(), "a meridian"
    assert (changed.mean(axis=1) > 0.7).any(), "a parallel"
    browser.ask("(liveView.map.shown.graticule = true, liveView.map.fit())")


def test_the_alarm_history_says_what_and_when_and_goes_there(browser):
    rows = "[...document.querySelectorAll('#alarms tbody tr')].map(r => [...r.cells].map(c => c.textContent.trim()))"
    at(browser, 95.0)
    assert browser.ask(rows) == [["0:40", "auv1", "✖ gp_node: no soundings for 12 s", "1:30"]]
    at(browser, 70.0)
    assert browser.ask(rows)[0][3] == "active"
    assert text(browser, "alarms").startswith("Alarm history: 1, 1 active")
    at(browser, 300.0)
    found = browser.ask(rows)
    assert [row[:1] + row[3:] for row in found] == [
        ["2:10", "active"],
        ["1:40", "2:10"],
        ["1:40", "2:10"],
        ["0:40", "1:30"],
    ]
    assert {row[2] for row in found[:3]} == {
        "⚠ limit exceeded: altitude: 1.4 m",
        "✖ limit tripped: depth: 9.1 m; limit 8 m",
        "⚠ holding: depth",
    }
    browser.ask("document.getElementById('alarms').open = true")
    browser.ask("document.querySelector('#alarms tbody tr:last-child button').click()")
    assert browser.ask("liveView.player.t") == 40.0


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_every_control_is_reached_by_tab_and_shows_its_focus(browser, mission, width, height):
    browser.size(width, height, mobile=width < 900)
    browser.ask("document.getElementById('alarms').open = true")
    at(browser, 200.0)
    assert browser.ask("document.documentElement.scrollWidth") <= width
    wanted = set(
        browser.ask(
            "[...document.querySelectorAll('button, input, select, summary, canvas[tabindex]')].filter(e => "
            "e.checkVisibility() && e.tabIndex >= 0 && !e.disabled).map((e, i) => e.dataset.probe = String(i))"
        )
    )
    assert len(wanted) > 15
    browser.ask("document.activeElement.blur()")
    reached, unmarked = set(), []
    for _ in range(len(wanted) + 10):
        browser.press("Tab")
        found = browser.ask(
            "(e => [e.dataset.probe ?? '', parseFloat(getComputedStyle(e).outlineWidth), getComputedStyle(e)"
            ".outlineStyle, e.id || e.textContent])(document.activeElement)"
        )
        reached.add(found[0])
        if found[0] and (found[1] < 2 or found[2] == "none"):
            unmarked.append(found)
    assert wanted <= reached
    assert unmarked == []
    small = browser.ask(
        "[...document.querySelectorAll('#commands button, #commands select, #measure, footer button')].filter(e => "
        "e.checkVisibility() && e.getBoundingClientRect().height < 28).map(e => e.textContent)"
    )
    assert small == []
    browser.size(1400, 900)


@pytest.mark.parametrize("deficiency", ["protanopia", "deuteranopia", "tritanopia", "achromatopsia"])
def test_alarm_levels_and_vehicles_differ_with_a_color_vision_deficiency(browser, deficiency):
    at(browser, 300.0)
    signs = browser.ask(
        "[...document.querySelectorAll('#alarms td[data-level]')].map(e => [e.dataset.level, e.textContent[0]])"
    )
    by_level = {level: {sign for other, sign in signs if other == level} for level, _ in signs}
    assert all(a.isdisjoint(b) for a, b in combinations(by_level.values(), 2)), "levels differ by their sign"
    assert len(by_level) == 2
    browser.call("Emulation.setEmulatedVisionDeficiency", type=deficiency)
    try:
        assert np.abs(seen(browser, "#00ff00") - (0, 255, 0)).max() > 40, "the deficiency is emulated"
        colors = np.array([seen(browser, color) for color in browser.ask("[1, 2, 3].map(liveView.vehicleColor)")])
        ground = [seen(browser, f"var(--{name})") for name in ("paper", "card")]
        bad, ok = (seen(browser, f"var(--{name})") for name in ("bad", "ok"))
    finally:
        browser.call("Emulation.setEmulatedVisionDeficiency", type="none")
    if deficiency != "achromatopsia":  # vehicles have numbers beside their color
        assert min(np.abs(a - b).max() for a, b in combinations(colors, 2)) > 40
    for shown in ground:
        assert np.abs(bad - shown).max() > 60
        assert np.abs(ok - shown).max() > 60
