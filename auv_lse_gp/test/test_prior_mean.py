"""Prior means, and the files they and the fit read."""

import numpy as np
import pytest

from auv_lse_common.params import ParameterError
from auv_lse_gp import GpConfig, OnlineGp, read_soundings
from auv_lse_gp.soundings import read_soundings_anywhere


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


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
def test_tables_with_comments_and_other_separators(tmp_path, separator):
    path = tmp_path / "survey.txt"
    rows = [["Line", "East_m", "North_m", "elevation_m"], ["1", "20", "10", "-5.5"], ["2", "21", "11", "-6"]]
    path.write_text("# a survey, of 2020\n\n" + "\n# again\n".join(separator.join(row) for row in rows) + "\n")
    assert read_soundings(path).tolist() == [[10.0, 20.0, 5.5], [11.0, 21.0, 6.0]]


def test_lat_lon_become_metres_about_their_mean_only_where_the_origin_does_not_matter(tmp_path):
    path = tmp_path / "survey.csv"
    path.write_text("lat,lon,depth_m\n45.000,7.001,10\n45.002,7.001,11\n45.001,7.000,12\n45.001,7.002,13\n")
    soundings, origin = read_soundings_anywhere(path)
    assert origin == pytest.approx((45.001, 7.001))
    # a milli-degree at 45 degrees of latitude: 111.13 m north, 78.85 m east
    wanted = [[-111.13, 0, 10], [111.13, 0, 11], [0, -78.85, 12], [0, 78.85, 13]]
    assert soundings == pytest.approx(np.array(wanted), abs=0.02)
    with pytest.raises(ParameterError, match=r"survey\.csv: has columns lat, lon; expected north_m, east_m"):
        OnlineGp(GpConfig(mean="survey", survey_file=str(path)))
    path.write_text("lat,lon,depth_m\n4500.1,7.001,10\n")
    with pytest.raises(ValueError, match=r"line 2: got lat, lon .*expected degrees"):
        read_soundings_anywhere(path)


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04 cut off", b"north_m,east_m,depth_m\n1,2,3\n"])
def test_files_that_are_no_npz_are_named(tmp_path, data):
    path = tmp_path / "bad.npz"
    path.write_bytes(data)
    with pytest.raises(ValueError, match=r"bad\.npz: not a readable npz grid .*expected arrays north_m"):
        read_soundings(path)


def test_a_file_that_is_not_text_is_named(tmp_path):
    path = tmp_path / "bad.csv"
    path.write_bytes("north_m,east_m,depth_m\n1,2,3 # Tiefe gemäß Lot\n".encode("latin-1"))
    with pytest.raises(ValueError, match=r"bad\.csv: byte 40 \(0xe4\) is not UTF-8 text; expected a table"):
        read_soundings(path)


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
