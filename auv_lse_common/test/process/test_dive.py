"""The id of a dive: made once, carried in frames, read back."""

import pytest

from auv_lse_common.process.dive import DIVE_VARIABLE, dive_of, is_simulation, new_dive, own_dive, tagged_frame


@pytest.mark.parametrize("kind", ["sim", "auv2", "auv255"])
def test_an_id_survives_in_a_frame(kind):
    dive = new_dive(kind)
    assert dive.startswith(f"{kind}-")
    assert dive_of(tagged_frame(dive, "auv2/dvl")) == dive
    assert is_simulation(dive) == (kind == "sim")


def test_ids_of_one_second_differ():
    assert len({new_dive("sim") for _ in range(20)}) > 1


@pytest.mark.parametrize("frame", ["", "map", "auv1/dvl", "sim/map", "sim-1/map", "robot-1123-184534-3f2a/map"])
def test_other_frames_have_no_id(frame):
    assert dive_of(frame) == ""
    assert tagged_frame("", frame) == frame


def test_the_environment_names_the_dive(monkeypatch):
    monkeypatch.setenv(DIVE_VARIABLE, "auv1-1123-184534-3f2a")
    assert own_dive() == "auv1-1123-184534-3f2a"
    monkeypatch.delenv(DIVE_VARIABLE)
    assert own_dive() == ""
