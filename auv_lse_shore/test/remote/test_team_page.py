"""The team's page shows what is known, to this computer only."""

from __future__ import annotations

import json
import urllib.error
import urllib.request

import pytest

from auv_lse_shore.remote.picture import VehicleView
from auv_lse_shore.remote.team_page import team_page
from auv_lse_shore.remote.watching import cells


def test_the_page_and_its_data_are_for_this_computer_only() -> None:
    shown = {"vehicles": [], "lines": ["auv2: <b>silent</b>"]}
    with team_page(lambda: shown, 0) as address:
        with urllib.request.urlopen(address) as page:
            assert b"does not answer" in page.read()
            assert "default-src 'none'" in page.headers["Content-Security-Policy"]
        with urllib.request.urlopen(f"{address}team.json") as data:
            assert json.load(data) == shown
        for request in (
            urllib.request.Request(f"{address}team.json", headers={"Host": "evil.example"}),
            urllib.request.Request(f"{address}../secret"),
            urllib.request.Request(address, data=b"go", method="POST"),
        ):
            with pytest.raises(urllib.error.HTTPError):
                urllib.request.urlopen(request)


def test_a_row_says_how_old_it_is_and_what_is_expected() -> None:
    position = {"north_m": 0.0, "east_m": 0.0, "depth_m": 5.0, "speed_mps": 1.0, "age_s": 0.0}
    state = {
        "mission": {"state": "RUNNING", "age_s": 1.0},
        "position": position,
        "path": {"north_east_m": [[0.0, 0.0], [50.0, 0.0]]},
    }
    view = VehicleView("auv1", {"running": True, "state": state}, 100.0, "out of reach", "one")
    assert cells(view, 110.0) == ["RUNNING", "10, 0 expected", "5.0 m", "", "11 s", "under water"]
    assert cells(VehicleView("auv1"), 0.0) == ["no answer", "", "", "", "", "asking"]
