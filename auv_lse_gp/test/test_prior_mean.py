"""Prior means, and the files they and the fit read."""

import numpy as np
import pytest

from auv_lse_common.params import ParameterError
from auv_lse_gp import GpConfig, OnlineGp, read_soundings


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


def test_grid_survey(tmp_path):
    path = tmp_path / "grid.npz"
    depth = np.array([[1.0, 2.0, np.nan], [3.0, 4.0, 5.0]])
    np.savez(path, north_m=[0.0, 10.0], east_m=[0.0, 10.0, 20.0], depth_m=depth)
    assert read_soundings(path).tolist() == [[0, 0, 1], [0, 10, 2], [10, 0, 3], [10, 10, 4], [10, 20, 5]]
    np.savez(path, north_m=[0.0, 10.0], east_m=[0.0, 10.0], depth_m=depth)
    with pytest.raises(ValueError, match=r"depth_m has shape \(2, 3\); expected \(north, east\) = \(2, 2\)"):
        read_soundings(path)
    np.savez(path, north_m=[0.0, 10.0])
    with pytest.raises(ValueError, match="has north_m; expected also east_m, depth_m"):
        read_soundings(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("north_m,east_m\n1,2\n", "has columns north_m, east_m; expected also depth_m"),
        ("north_m,east_m,depth_m\n1,2,x\n", "line 2: .*expected numbers in north_m, east_m, depth_m"),
        ("north_m,east_m,depth_m\n1,2,3\n1,2\n", "line 3: .*expected numbers"),
        ("north_m,east_m,depth_m\n1,2,nan\n", "line 2: .*expected finite numbers"),
        ("north_m,east_m,depth_m\n", "holds no sounding"),
        ("", "has columns none; expected also north_m, east_m, depth_m"),
    ],
)
def test_bad_files_are_named(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_soundings(path)
    with pytest.raises(ParameterError, match=r"gp\.survey_file: .*bad\.csv"):
        OnlineGp(GpConfig(mean="survey", survey_file=str(path)))


def test_surveys_that_do_not_span_an_area(tmp_path):
    path = tmp_path / "line.csv"
    path.write_text("north_m,east_m,depth_m\n" + "".join(f"{i},{2 * i},5\n" for i in range(9)))
    with pytest.raises(ParameterError, match="lie on one line"):
        OnlineGp(GpConfig(mean="survey", survey_file=str(path)))
    with pytest.raises(ParameterError, match=r"absent\.csv"):
        OnlineGp(GpConfig(mean="survey", survey_file=str(tmp_path / "absent.csv")))
