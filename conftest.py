"""Imports the packages before pytest does: in importlib mode it would take the folders of the same names for them.

It also keeps ROS on this computer and second copies of state files out of the home, lets SIGHUP end processes under
nohup, too, removes what killed nodes leave in memory, and lets Hypothesis take its time.
"""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

import auv_lse_common
import auv_lse_comms
import auv_lse_gp
import auv_lse_mavlink
import auv_lse_planner
import auv_lse_record
import auv_lse_run
import auv_lse_shore
import auv_lse_sim
from auv_lse_common.node.state_memory import forget_copy
from auv_lse_common.support.confinement import NETWORK_VARIABLES, confine

__all__ = [
    "auv_lse_common",
    "auv_lse_comms",
    "auv_lse_gp",
    "auv_lse_mavlink",
    "auv_lse_planner",
    "auv_lse_record",
    "auv_lse_run",
    "auv_lse_shore",
    "auv_lse_sim",
]

# Tests stay on this computer, whatever network the shell names.
for _name in NETWORK_VARIABLES:
    os.environ.pop(_name, None)
confine()

# Tests send SIGHUP and wait for what it does; nohup has it ignored, in the processes that tests start, too.
if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

#: How long an example takes depends on what else the machine does.
settings.register_profile("any load", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any load")


@pytest.fixture(scope="session", autouse=True)
def no_copies_of_state_files_remain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Removes the copies in memory of the tests' state files, which would stay until the computer reboots."""
    yield
    for path in tmp_path_factory.getbasetemp().rglob("*.state"):
        forget_copy(path)


@pytest.fixture(scope="session", autouse=True)
def second_copies_of_state_files_stay_out_of_the_home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A vehicle of a test must not take the dive of another one for its own that was not ended."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state_home")))
        patch.delenv("STATE_DIRECTORY", raising=False)
        yield


@pytest.fixture(autouse=True)
def no_test_finds_the_dive_of_an_earlier_one(
    second_copies_of_state_files_stay_out_of_the_home: None,
) -> None:
    """A test that kills a vehicle leaves a dive that was not ended; the next one of that name would wait for RESET."""
    for record in Path(os.environ["XDG_STATE_HOME"]).glob("auv_lse/*"):
        record.unlink()


@pytest.fixture(autouse=True)
def ctrl_c_still_ends_the_tests() -> Iterator[None]:
    """A command that has answered Ctrl-C lets no other one interrupt the end of its process, which here goes on."""
    before = signal.getsignal(signal.SIGINT)
    yield
    if before is not None:
        signal.signal(signal.SIGINT, before)
