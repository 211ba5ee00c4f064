"""Prior means, and the files they and the fit read."""

import numpy as np
import pytest

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_gp import GpConfig, OnlineGp


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
