"""Prior means, and the files they and the fit read."""

import numpy as np
import pytest

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_gp import GpConfig, OnlineGp, soundings
from auv_lse_gp.covariance.prior_mean import prior_mean
from auv_lse_gp.soundings import read_soundings


def test_plane():
    gp = OnlineGp(GpConfig(mean="plane", mean_depth_m=10.0, mean_slope_north=0.1, mean_slope_east=-0.02))
    assert gp.predict(np.array([[0.0, 0.0], [100.0, 50.0]]))[0].tolist() == [10.0, 19.0]


def survey(tmp_path, name="survey.csv"):
    path = tmp_path / name
    rows = [(n, e, 10.0 + 0.1 * n) for n in (0.0, 100.0) for e in (0.0, 100.0)]
    path.write_text("line, north_m, east_m, depth_m\n" + "".join(f"1,{n},{e},{d}\n" for n, e, d in rows))
    return path


def test_survey_is_linear_inside_and_nearest_outside(tmp_path):
    gp = OnlineGp(GpConfig(mean="survey", survey_file=str(survey(tmp_path))))
    mean, std = gp.predict(np.array([[50.0, 30.0], [25.0, 70.0], [180.0, 120.0], [-70.0, 20.0]]))
    assert mean == pytest.approx([15.0, 12.5, 20.0, 10.0])
    assert std.tolist() == [8.0] * 4
    gp.add(50.0, 50.0, 17.0)
    assert gp.predict(np.array([[50.0, 50.0]]))[0][0] == pytest.approx(17.0, abs=0.01)


def test_surveys_on_a_line_are_rejected(tmp_path):
    path = tmp_path / "line.csv"
    path.write_text("north_m,east_m,depth_m\n" + "".join(f"{i},{2 * i},5\n" for i in range(9)))
    with pytest.raises(ParameterError, match="soundings on one line"):
        OnlineGp(GpConfig(mean="survey", survey_file=str(path)))
    with pytest.raises(ParameterError, match=r"absent\.csv"):
        OnlineGp(GpConfig(mean="survey", survey_file=str(tmp_path / "absent.csv")))


def test_a_survey_is_read_again_only_if_its_file_has_changed(tmp_path, monkeypatch):
    """43,000 soundings take .6 s, and the map's quality asks for their mean again and again under way."""
    path = tmp_path / "survey.csv"
    config = GpConfig(mean="survey", survey_file=str(path))
    read = []
    monkeypatch.setattr(soundings, "read_soundings", lambda path: read.append(path) or read_soundings(path))

    def depth_m(deeper_m):
        path.write_text(f"north_m,east_m,depth_m\n0,0,{10 + deeper_m}\n9,0,{12 + deeper_m}\n0,9,{14 + deeper_m}\n")
        return [prior_mean(config)(np.zeros((1, 2)))[0] for _ in range(3)]

    assert depth_m(0) == [10.0] * 3
    assert len(read) == 1
    assert depth_m(100) == [110.0] * 3
    assert len(read) == 2
    path.unlink()  # as from a broken disk
    assert prior_mean(config)(np.zeros((1, 2)))[0] == 110.0
    with pytest.raises(ParameterError, match=r"gp\.survey_file: .*other\.csv"):
        prior_mean(GpConfig(mean="survey", survey_file=str(tmp_path / "other.csv")))
