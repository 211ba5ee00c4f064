"""The run folder and its page."""

import base64
import dataclasses
import html
import json
import re
import struct

import pytest
import yaml
from browser import CHROMIUM, Browser
from jinja2 import UndefinedError

from auv_lse_gp.map.certainty import CLASSES, FOUND
from auv_lse_shore.judge.evaluation import evaluate
from auv_lse_shore.judge.summary import table
from auv_lse_shore.report.figures import save
from auv_lse_shore.report.page import number, page_environment
from auv_lse_shore.report.report import write_report
from auv_lse_shore.report.report_figures import FIGURES

#: What the first screen does without: words of the method, the judge and the acoustic link.
JARGON = re.compile(r"bayes|risk|loss|cost|prior|posterior|packet|seed|method|bound", re.IGNORECASE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, synthetic_run):
    run = synthetic_run(steps=8)
    run.notes.append("start moved by <3 m>")
    run.origin = (46.5, 6.6)
    folder = tmp_path_factory.mktemp("report") / "run"
    write_report(run, folder)
    return folder


def test_the_run_folder_is_complete(folder):
    names = {path.name for path in folder.iterdir()}
    assert {"summary.json", "mission.yaml", "isobath.geojson", "report.html"} <= names
    assert {
        "map.png",
        "risk_maps.png",
        "risk_over_steps.png",
        "reward.png",
        "local_risk_error.png",
        "depth_map.png",
        "navigation.png",
    } <= names
    for image in folder.glob("*.png"):
        data = image.read_bytes()
        assert data[:8] == b"\x89PNG\r\n\x1a\n"
        width, height = struct.unpack(">II", data[16:24])
        assert width >= 1000
        assert height >= 400
    mission = yaml.safe_load((folder / "mission.yaml").read_text())
    assert mission["/**"]["ros__parameters"]["mission"]["seed"] == 7


def test_the_page_needs_nothing_but_itself(folder):
    page = (folder / "report.html").read_text().replace("<wbr>", "")
    assert not re.search(r"(src|href)=[\"'](?!data:)", page)
    assert "http" not in re.sub(r"data:[^\"']*", "", page), "beside the pictures, whose base64 can hold any word"
    assert "<script" not in page
    assert page.count("data:image/png;base64,") == 7
    assert "prefers-color-scheme: dark" in page
    for key, _, _ in table():
        assert f"<code>{key}</code>" in page
    assert "start moved by &lt;3 m&gt;" in page
    assert "<code>length_scale_m</code>" in page  # the parameters are there


def test_the_isobath_file_has_pieces_with_their_class_band_and_truth(folder):
    features = json.loads((folder / "isobath.geojson").read_text())["features"]
    names = [f["properties"]["name"] for f in features]
    assert names[-3:] == ["shallow edge of the 95 % band", "deep edge of the 95 % band", "true isobath"]
    pieces = [f["properties"] for f in features[:-3]]
    assert {p["name"] for p in pieces} == {"estimated isobath"}
    assert [p["class"] for p in pieces] == sorted(
        (p["class"] for p in pieces), key=["found", "likely", "guessed"].index
    )
    assert all((p["class"] == "found") == (p["reason"] == "") for p in pieces)
    assert all(p["std_m"] <= 10.0 for p in pieces if p["class"] == "found")
    summary = json.loads((folder / "summary.json").read_text())
    total = sum(p["length_m"] for p in pieces if p["class"] == "found")
    assert total == pytest.approx(summary["isobath_found_m"], abs=0.1 * len(pieces))
    assert all(f["properties"]["depth_m"] == 15.0 for f in features)


def test_an_existing_mission_file_is_left_alone(tmp_path, synthetic_run):
    (tmp_path / "mission.yaml").write_text("# as flown\n")
    run = synthetic_run(steps=2, with_truth=False)
    run.vehicles = run.vehicles[:1]  # and a lone vehicle, without truth, is reported too
    write_report(run, tmp_path)
    assert (tmp_path / "mission.yaml").read_text() == "# as flown\n"
    assert "true isobath" not in (tmp_path / "isobath.geojson").read_text()
    assert not (tmp_path / "local_risk_error.png").exists(), "its own map is the team's"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (float("nan"), "–"),
        (True, "yes"),
        (3, "3"),
        (0.0, "0"),
        (1234.567, "1235"),
        (0.123456, "0.1235"),
        ((1.0, 2.5), "1.000, 2.500"),
    ],
)
def test_numbers_for_readers(value, text):
    assert number(value) == text


def test_values_of_a_page_are_escaped_and_none_may_be_missing():
    values = {"header": ["a"], "rows": [["<b> & c"]]}
    template = '{% from "parts.html" import table %}{{ table(header, rows, ["n"]) }}'
    environment = page_environment("auv_lse_shore.report", escaped=True)
    assert '<td class="n">&lt;b&gt; &amp; c</td>' in environment.from_string(template).render(**values)
    with pytest.raises(UndefinedError, match="rows"):
        environment.from_string(template).render(header=["a"])


def test_the_first_screen_needs_no_knowledge_of_the_method(folder):
    page = (folder / "report.html").read_text().split("<body>")[1]
    first = re.sub(r"<[^>]*>|data:[^\"]*", " ", html.unescape(page[: page.index("<h2>")]))
    assert not JARGON.search(first), JARGON.search(first)
    assert "the line along which the water is 15 m deep" in first
    assert "of isobath found" in first
    assert "surely shallower than 15 m" in first


def test_stretches_that_were_not_found_have_latitude_and_longitude(folder):
    page = (folder / "report.html").read_text()
    assert re.search(r"near north -?\d+ m, east -?\d+ m \(46\.50\d\d\d° N, 6\.60\d\d\d° E\)", page)


@pytest.mark.skipif(not CHROMIUM, reason="needs Chromium (Debian, Ubuntu: sudo apt install chromium)")
def test_the_tables_are_whole_on_a_phone_on_a_wide_screen_and_in_at_most_6_printed_pages(folder, tmp_path):
    with Browser(tmp_path) as browser:
        for width in (360, 1400):
            browser.size(width, 800, mobile=width < 500)
            browser.open((folder / "report.html").as_uri())
            browser.wait("document.readyState === 'complete' && !!document.querySelector('table.stacked')")
            assert browser.ask("document.documentElement.scrollWidth") == width
            outside = browser.ask(
                "[...document.querySelectorAll('table[class] :is(th, td)')].filter(cell => { const box = "
                "cell.getBoundingClientRect(); return cell.offsetParent && (box.left < 0 || "
                "box.right > cell.closest('.scroll').getBoundingClientRect().right + 1 || (cell.textContent && "
                "box.height < 8) || cell.scrollWidth > cell.clientWidth + 1); }).map(cell => cell.textContent)"
            )
            assert outside == []
        pdf = base64.b64decode(browser.call("Page.printToPDF", preferCSSPageSize=True)["data"])
        assert browser.errors == []
    assert 1 < len(re.findall(rb"/Type\s*/Page\b", pdf)) <= 6


@pytest.mark.parametrize(("kinds", "east_m", "vehicles"), [((), 650, 1), ((FOUND,), 550, 20), (CLASSES, 650, 1)])
def test_nothing_of_a_figure_is_cut_off(synthetic_run, tmp_path, kinds, east_m, vehicles):
    """In areas of the default shape and square; with all classes of the isobath, the legend has a second line."""
    run = synthetic_run(steps=8)
    run.vehicles = [dataclasses.replace(run.vehicles[0], vehicle=number + 1) for number in range(vehicles)]
    run.parameters["/**"]["mission"]["vehicles"] = vehicles
    run.parameters["/**"]["area"] = {"polygon_m": [-50, -50, 550, -50, 550, east_m, -50, east_m]}
    run.ground, run.origin = None, (47.5, 8.5)
    e = evaluate(run)
    piece = e.pieces[0]
    e.truth = [piece.line]
    e.team_map = dataclasses.replace(e.team_map, pieces=[dataclasses.replace(piece, kind=kind) for kind in kinds])
    for name, _, draw in FIGURES:
        if (figure := draw(e)) is None:
            continue
        save(figure, tmp_path / name)
        drawn, (width_in, height_in) = figure.get_tightbbox(), figure.get_size_inches()
        beyond_in = (-drawn.x0, -drawn.y0, drawn.x1 - width_in, drawn.y1 - height_in)
        assert max(beyond_in) < 0.01, (name, "left, bottom, right, top (inches)", beyond_in)
