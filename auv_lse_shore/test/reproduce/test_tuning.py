"""The parameters that docs/tuning.md shows: their values can be flown, and the page has them."""

from pathlib import Path

import pytest

from auv_lse_common.mission_file.settings import Settings
from auv_lse_shore.reproduce import tuning
from auv_lse_shore.reproduce.knobs import KNOBS, shown
from auv_lse_shore.reproduce.study import SMALL, base_mission

PAGE = Path(__file__).resolve().parents[3] / "docs" / "tuning.md"


def value_in(settings, knob):
    name, key = knob.parameter.split(".")
    own = settings.vehicle(1)
    planner = own.planner.complete()
    return getattr({"planner": planner, "gp": own.gp, "tdma": settings.tdma}[name], key)


@pytest.mark.parametrize("knob", KNOBS, ids=[knob.name for knob in KNOBS])
def test_each_value_can_be_flown(knob):
    method = {**SMALL, "planner.method": knob.method}
    assert sorted(knob.values) == list(knob.values)
    for value in knob.values:
        assert value_in(Settings.load(base_mission(), {**method, knob.parameter: value}), knob) == value


@pytest.mark.parametrize("knob", KNOBS, ids=[knob.name for knob in KNOBS])
def test_the_page_shows_each_picture_and_value(knob):
    text = PAGE.read_text()
    assert f"figures/tuning_{knob.name}.png" in text
    for value in knob.values:
        assert f"| `{knob.parameter}` ({knob.method}) | {shown(knob, value)} |" in text


def test_what_cannot_be_shown_is_refused(tmp_path, capsys):
    assert tuning.main(["--seeds", "0", "--out", str(tmp_path)]) == 2
    assert "--seeds 0: expected at least 1" in capsys.readouterr().err
