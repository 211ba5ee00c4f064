"""The campaign file: what is flown, and what is refused."""

import dataclasses
from pathlib import Path

import pytest
from sim_helpers import TINY, spec_of

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.settings import Settings
from auv_lse_shore.campaign import spec as campaign_spec
from auv_lse_shore.campaign.spec import CampaignSpec


def test_grid_times_list_times_seeds(tmp_path):
    spec = spec_of(
        tmp_path,
        grid={"planner.method": ["augmented", "plain"], "sim.channel.packet_loss": [0.0, 0.5]},
        list=[{"label": "one", "mission.vehicles": 1}, {"mission.vehicles": 3}],
        seeds=[5, 9],
    )
    jobs = spec.jobs()
    assert len(jobs) == 2 * 2 * 2 * 2
    assert [j.seed for j in jobs] == [5] * 8 + [9] * 8  # seed by seed
    assert jobs[0].group == "one, method augmented, packet_loss 0.0"
    assert jobs[7].group == "vehicles 3, method plain, packet_loss 0.5"
    assert jobs[7].varied == {"mission.vehicles": 3, "planner.method": "plain", "sim.channel.packet_loss": 0.5}
    common = jobs[7].patterns["/**"]
    assert common["mission"] == {"steps": 2, "seed": 5, "vehicles": 3, "goal": "chart"}
    assert common["planner"]["method"] == "plain"
    assert common["sim"]["channel"]["packet_loss"] == 0.5
    assert len({j.id for j in jobs}) == 16


def test_parameters_of_one_last_name_have_their_full_names_in_labels(tmp_path):
    spec = spec_of(tmp_path, grid={"auv1.planner.method": ["plain"], "auv2.planner.method": ["tour"]})
    assert [label for label, _ in spec.settings] == ["auv1.planner.method plain, auv2.planner.method tour"]


def test_ids_depend_on_the_mission_alone(tmp_path):
    few = {j.id for j in spec_of(tmp_path, grid={"planner.method": ["plain"]}, seeds=2).jobs()}
    more = {j.id for j in spec_of(tmp_path, grid={"planner.method": ["augmented", "plain"]}, seeds=3, name="x").jobs()}
    assert few < more


def test_a_mission_file_beside_the_campaign_is_the_base(tmp_path):
    (tmp_path / "m.yaml").write_text("/**:\n  ros__parameters:\n    level_set: {level_m: 12.0}\n")
    (job,) = spec_of(tmp_path, mission="m.yaml").jobs()
    assert job.patterns["/**"]["level_set"]["level_m"] == 12.0


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"grids": {}}, r"grids: unknown key; use one of name, mission, set"),
        ({"grid": {"planner.method": "plain"}}, r"grid: planner\.method must be a list of values, not 'plain'"),
        ({"grid": {"planner.metod": ["plain"]}}, r"planner\.metod: unknown parameter .* did you mean 'method'"),
        ({"grid": {"mission.steps": [0]}}, r"mission\.steps must be a whole number from 1 .*, not 0"),
        (
            {"set": {"auv4.vehicle.depth_m": 4.0}, "grid": {"mission.vehicles": [1, 3]}},
            r"auv4\.vehicle\.depth_m: the mission has no auv4; its vehicles are auv1 to auv3",
        ),
        ({"grid": {"mission.steps": [2, 0]}}, r"test\.yaml: setting 'steps 0': mission\.steps must be"),
        ({"seeds": [1, 1]}, r"seeds must be .*, not \[1, 1\]"),
        ({"seeds": 0}, "seeds must be .*, not 0"),
        ({"seeds": 99999999999}, "seeds: 99999999999 are more than 100000 seeds"),
        ({"seeds": {"first": 2**63 - 1, "count": 2}}, f"seeds: {2**63} does not fit 64 bits"),
        ({"seeds": [1, 2**70]}, f"seeds: {2**70} does not fit 64 bits"),
        ({"seeds": {"first": 1, "count": 100001}}, "seeds: .* are more than 100000 seeds"),
        ({"list": [{"label": "a"}, {"label": "a"}]}, "two settings are called 'a'"),
        ({"list": [{"label": "a"}, {"label": "b"}]}, "the same mission as another"),
        ({"list": [{"planner.method": "plain"}], "grid": {"planner.method": ["plain"]}}, "in grid and in list"),
        ({"set": ["x"]}, r"set must hold parameters by dotted name.*, not \['x'\]"),
        ({"seeds": {"first": -5, "count": 3}}, r"seeds must be a number of seeds"),
        ({"seeds": {"first": 1, "count": 0}}, r"seeds must be a number of seeds"),
        ({"seeds": {"first": 1.9, "count": 2}}, r"seeds must be a number of seeds"),
        ({"seeds": {"first": "a", "count": 2}}, r"seeds must be a number of seeds"),
        ({"seeds": [True, 2]}, r"seeds must be a number of seeds"),
        ({"set": {**TINY, "mission.seed": 9}}, r"setting 'all' sets mission\.seed; list seeds under `seeds`"),
        ({"set": {**TINY, "sim.bathymetry.file": "nope.csv"}}, r"'all'.*bathymetry\.file: nope\.csv: No such file"),
    ],
)
def test_a_wrong_campaign_is_refused_before_anything_flies(tmp_path, content, message):
    with pytest.raises(ParameterError, match=message):
        CampaignSpec.from_mapping({"set": TINY, **content}, "test.yaml", tmp_path).jobs()


def test_vehicles_of_a_larger_team_have_depths_of_their_own(tmp_path):
    (job,) = CampaignSpec.from_mapping({"set": {"mission.vehicles": 5}}, "test.yaml", tmp_path).jobs()
    settings = Settings.from_patterns(job.patterns, "job")
    assert [own.vehicle.depth_m for own in settings.vehicles] == [3.0, 4.0, 5.0, 3.0, 4.0]


def test_a_parameter_may_be_for_the_larger_teams_alone(tmp_path):
    spec = spec_of(tmp_path, set={"auv3.vehicle.depth_m": 9.0}, grid={"mission.vehicles": [1, 3]})
    assert len(spec.jobs()) == 2


@pytest.mark.parametrize("uses", [{"sim.bathymetry.file": ""}, {"gp.mean": "survey", "gp.survey_file": ""}])
def test_another_survey_under_the_same_name_is_another_mission(tmp_path, uses):
    survey = tmp_path / "survey.csv"
    survey_is_used = {name: value or str(survey) for name, value in uses.items()}

    def ids():
        campaign_spec._digest.cache_clear()  # a new process
        return {j.id for j in spec_of(tmp_path, set={**TINY, **survey_is_used}).jobs()}

    survey.write_text("east_m,north_m,depth_m\n0,0,10\n")
    before = ids()
    assert before == ids()
    survey.write_text("east_m,north_m,depth_m\n0,0,11\n")
    assert before != ids()


@pytest.mark.parametrize(
    "path", sorted(Path(__file__).parents[3].glob("config/campaigns/*.yaml")), ids=lambda p: p.stem
)
def test_the_campaigns_of_the_project_can_be_flown(path):
    """Their missions have no method or parameter that is gone."""
    spec = CampaignSpec.load(path)
    assert len(dataclasses.replace(spec, seeds=spec.seeds[:1]).jobs()) > 1


def test_in_the_positions_campaign_vehicles_surface_only_if_requested():
    path = Path(__file__).parents[3] / "config/campaigns/positions.yaml"
    spec = CampaignSpec.load(path)
    for job in dataclasses.replace(spec, seeds=spec.seeds[:1]).jobs():
        settings = Settings.from_patterns(job.patterns, "")
        wanted = 2 if "surfacing where it pays" in job.group else 0
        team = len(settings.vehicles)
        assert [own.vehicle.surfacings for own in settings.vehicles] == [wanted] * team
        corrects = [settings.positions_in_force(v).correct for v in range(1, team + 1)]
        assert corrects == ["dead-reckoned" not in job.group] * team
        assert settings.sim.gps.surface_every_s == 0.0
