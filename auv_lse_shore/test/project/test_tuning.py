"""The parameters that docs/evidence/tuning.md shows: their values can be flown, and the page has them."""

from pathlib import Path

import pytest

from auv_lse_common.mission_file.settings import Settings
from auv_lse_shore.reproduce.study import SMALL, base_mission
from benchmarks.tuning import __main__ as tuning
from benchmarks.tuning.knobs import KNOBS

PAGE = Path(__file__).resolve().parents[3] / "docs" / "evidence" / "tuning.md"


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
    assert tuning.heading(knob) in text


def test_a_row_has_loss_and_error_of_each_value():
    means = [{"loss": 0.1 * k, "isobath_m": float(k), "risk": 9.0} for k in (1, 2, 3)]
    assert tuning.row(KNOBS[0], means) == f"{tuning.heading(KNOBS[0])} 0.10, 0.20, 0.30 | 1.0, 2.0, 3.0 |"


def test_what_cannot_be_shown_is_refused(tmp_path, capsys):
    assert tuning.main(["--seeds", "0", "--out", str(tmp_path)]) == 2
    assert "--seeds 0: expected at least 1" in capsys.readouterr().err
