"""The true ground of simulated missions."""

from auv_lse_common.mission_file.settings import Settings
from auv_lse_record.run_data import RunData
from auv_lse_shore.judge.evaluation import ground_grid
from auv_lse_sim.ground.ground_source import ground_of


def set_true_ground(run: RunData, where: str) -> None:
    """Sets the true ground of a run whose recording has the simulator's truth; a mission at sea has none.

    Args:
        run: The run; its `ground` is set.

    Raises:
        ParameterError: if its mission file does not fit this version of the software.
    """
    if any(len(vehicle.truth) for vehicle in run.vehicles):
        settings = Settings.from_patterns(run.parameters, where)
        run.ground = ground_grid(settings.planner_settings(1), ground_of(settings))
