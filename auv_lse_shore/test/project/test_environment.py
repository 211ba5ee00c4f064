"""scripts/environment.sh in a person's shell and in a script."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parents[3] / "scripts"


def shell(folder: Path, script: str, set_up: int = 0, **environment: str) -> subprocess.CompletedProcess[str]:
    """Runs bash lines in a project whose scripts/setup ends with `set_up`."""
    (folder / "scripts").mkdir(parents=True)
    shutil.copy(SCRIPTS / "environment.sh", folder / "scripts")
    (folder / "scripts" / "setup").write_text(f"#!/bin/sh\nexit {set_up}\n")
    (folder / "scripts" / "setup").chmod(0o755)
    (folder / "ros_ws" / "install").mkdir(parents=True)
    (folder / "ros_ws" / "install" / "local_setup.bash").write_text("export BUILT=yes$A_VARIABLE_THAT_IS_NOT_SET\n")
    (folder / ".venv" / "lib" / "python3.12" / "site-packages").mkdir(parents=True)
    plain = {k: v for k, v in os.environ.items() if k not in ("ROS_DISTRO", "AMENT_PREFIX_PATH", "PYTHONPATH")}
    return subprocess.run(
        ["bash", "-c", script],
        capture_output=True,
        text=True,
        cwd=folder,
        env={**plain, **environment},
        timeout=30,
        check=False,
    )


@pytest.mark.parametrize("flag", ["-u", "+u"])
def test_the_shells_flag_stays_as_it_was(tmp_path: Path, flag: str) -> None:
    process = shell(tmp_path / "p", f'set {flag}; . scripts/environment.sh && use_environment; echo "$BUILT $-"')
    built, flags = process.stdout.split()
    assert built == "yes", process.stderr
    assert ("u" in flags) == (flag == "-u")


def test_a_failed_set_up_leaves_a_persons_shell_open_and_stops_a_script(tmp_path: Path) -> None:
    process = shell(tmp_path / "p", ". scripts/environment.sh && use_environment; echo still here $?", set_up=3)
    assert (process.stdout, process.returncode) == ("still here 3\n", 0)
    script = ". scripts/environment.sh && use_environment || exit $?; echo still here"
    process = shell(tmp_path / "q", script, set_up=3)
    assert (process.stdout, process.returncode) == ("", 3)


def test_the_home_of_another_python_is_forgotten(tmp_path: Path) -> None:
    process = shell(tmp_path / "p", '. scripts/environment.sh; echo "[${PYTHONHOME:-}]"', PYTHONHOME="/nonexistent")
    assert process.stdout == "[]\n"


def test_where_ros_is_sourced_its_own_python_finds_our_packages_last(tmp_path: Path) -> None:
    script = '. scripts/environment.sh && use_environment && use_environment; echo "$PYTHONPATH"'
    ros = {"ROS_DISTRO": "jazzy", "AMENT_PREFIX_PATH": "/opt/ros/jazzy", "PYTHONPATH": "/opt/ros/jazzy/lib"}
    process = shell(tmp_path / "p", script, **ros)
    assert process.stdout.strip() == f"/opt/ros/jazzy/lib:{tmp_path}/p/.venv/lib/python3.12/site-packages"
    assert shell(tmp_path / "q", script).stdout.strip() == "", "without ROS our own Python has them anyway"


def test_ctrl_c_while_the_environment_is_entered_is_answered_by_the_command(tmp_path: Path) -> None:
    """A terminal sends it to every process: the Python of colcon's own script would print a traceback."""
    (tmp_path / "scripts").mkdir()
    for name in ("environment.sh", "auv_lse"):
        shutil.copy(SCRIPTS / name, tmp_path / "scripts")
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    (tmp_path / ".venv" / "bin" / "python").symlink_to(sys.executable)
    (tmp_path / "ros_ws" / "install").mkdir(parents=True)
    (tmp_path / "ros_ws" / "install" / "local_setup.bash").write_text(
        f"echo there; python -c 'import time; time.sleep(0.5)'; export PYTHONPATH={tmp_path}\n"
    )
    (tmp_path / "auv_lse_run.py").write_text(
        "import signal, sys\ntry:\n    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})\n"
        "except KeyboardInterrupt:\n    sys.exit(f'answered: {sys.argv[1:]}')\n"
    )
    plain = {k: v for k, v in os.environ.items() if k not in ("ROS_DISTRO", "AMENT_PREFIX_PATH", "PYTHONPATH")}
    made = ". scripts/environment.sh; environment_fingerprint > .venv/setup.done"
    subprocess.run(["bash", "-c", made], cwd=tmp_path, env=plain, check=True, timeout=30)
    with subprocess.Popen(
        [tmp_path / "scripts" / "auv_lse", "a word", "b"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=plain,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "there\n"
        os.killpg(process.pid, signal.SIGINT)
        output, errors = process.communicate(timeout=30)
    assert (process.returncode, output, errors) == (1, "", "answered: ['a word', 'b']\n")


def set_up_checkout(project: Path, python: str) -> dict[str, str]:
    """Makes a checkout that counts as set up, with this script as its Python; returns its environment."""
    for folder in ("scripts", ".venv/bin", "ros_ws/install"):
        (project / folder).mkdir(parents=True)
    for name in ("environment.sh", "setup"):
        shutil.copy(SCRIPTS / name, project / "scripts")
    for name in ("setup.bash", "local_setup.bash"):
        (project / "ros_ws" / "install" / name).touch()
    (project / ".venv" / "bin" / "python").write_text(python)
    (project / ".venv" / "bin" / "python").chmod(0o755)
    plain = {k: v for k, v in os.environ.items() if k not in ("ROS_DISTRO", "AMENT_PREFIX_PATH")}
    made = ". scripts/environment.sh; environment_fingerprint > .venv/setup.done"
    subprocess.run(["bash", "-c", made], cwd=project, env=plain, check=True, timeout=30)
    return plain


@pytest.mark.parametrize("of_vehicle", [False, True])
def test_inner_loops_are_compiled_again_when_their_code_has_changed(tmp_path: Path, of_vehicle: bool) -> None:
    """As after a pull: otherwise every node of the next mission would compile them, and be late."""
    project = tmp_path / "p"
    if not of_vehicle:
        (project / "ros_ws" / "src" / "auv_lse_shore").mkdir(parents=True)
    plain = set_up_checkout(project, f'#!/bin/sh\necho "$*" >> {tmp_path}/calls\n')
    (project / "auv_lse_a" / "auv_lse_a").mkdir(parents=True)
    loops = project / "auv_lse_a" / "auv_lse_a" / "inner.py"
    loops.write_text("@compiled\ndef one(): ...\n")

    def words() -> str:
        command = [project / "scripts" / "setup", "--quiet"]
        process = subprocess.run(command, capture_output=True, text=True, env=plain, timeout=30, check=False)
        assert process.returncode == 0, process.stderr
        return process.stderr

    assert "the code of the inner loops has changed" in words()
    assert words() == ""
    loops.write_text("@compiled\ndef another(): ...\n")
    assert "the code of the inner loops has changed" in words()
    assert words() == ""
    module = "auv_lse_run.vehicle.warm_up" if of_vehicle else "auv_lse_shore.mission.warm_up"
    assert (tmp_path / "calls").read_text().splitlines() == [f"-m {module}"] * 2


def test_ctrl_c_during_set_up_does_not_read_like_a_failure(tmp_path: Path) -> None:
    plain = set_up_checkout(tmp_path, f"#!/bin/sh\ntouch {tmp_path}/there\nexec sleep 60\n")
    with subprocess.Popen(
        [tmp_path / "scripts" / "setup", "--quiet"],
        stderr=subprocess.PIPE,
        text=True,
        env=plain,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        end_s = time.monotonic() + 20.0
        while not (tmp_path / "there").exists() and time.monotonic() < end_s:
            time.sleep(0.05)
        assert (tmp_path / "there").exists()
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=30)
    assert (process.returncode, errors.count("\n")) == (130, 1), errors


def test_a_machine_that_the_wheels_are_not_for_is_named(tmp_path: Path) -> None:
    """Their hashes are those of x86-64: pip alone would say that it finds no version, as without a network."""
    project, programs = tmp_path / "p", tmp_path / "bin"
    (project / "scripts").mkdir(parents=True)
    programs.mkdir()
    for name in ("environment.sh", "setup"):
        shutil.copy(SCRIPTS / name, project / "scripts")
    uname = programs / "uname"
    uname.write_text('#!/bin/sh\n[ "$1" = -s ] && echo Linux || echo aarch64\n')
    uname.chmod(0o755)
    plain = {k: v for k, v in os.environ.items() if k not in ("ROS_DISTRO", "AMENT_PREFIX_PATH")}
    process = subprocess.run(
        [project / "scripts" / "setup"],
        capture_output=True,
        text=True,
        env={**plain, "PATH": f"{programs}:{os.environ['PATH']}"},
        timeout=30,
        check=False,
    )
    assert process.returncode == 1
    assert "this machine is Linux on aarch64; ROS 2 from PyPI is for Linux on x86_64 alone" in process.stderr
    assert "install ROS 2 Jazzy" in process.stderr
    assert not (project / ".venv").exists()


@pytest.mark.parametrize("file", [".setup.lock", "build/setup.log"])
def test_a_checkout_of_another_user_is_refused_before_anything_is_removed(tmp_path: Path, file: str) -> None:
    """A folder in place of the file: root, too, cannot write it."""
    for folder in ("scripts", ".venv", file):
        (tmp_path / folder).mkdir(parents=True)
    for name in ("environment.sh", "setup"):
        shutil.copy(SCRIPTS / name, tmp_path / "scripts")
    command = [tmp_path / "scripts" / "setup"]
    process = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert process.returncode == 1
    first, cure = process.stderr.splitlines()
    assert first == f"setup: error: cannot write {tmp_path / file}"
    assert "chown" in cure
    assert (tmp_path / ".venv").is_dir()


def test_too_old_a_python_is_refused_with_a_package_that_helps(tmp_path: Path) -> None:
    """Ubuntu 22.04's python3 is 3.10: installing python3 there would change nothing."""
    (tmp_path / "scripts").mkdir()
    for name in ("environment.sh", "setup"):
        shutil.copy(SCRIPTS / name, tmp_path / "scripts")
    python = tmp_path / "python3"
    python.write_text("#!/bin/sh\necho 3.10\n")
    python.chmod(0o755)
    process = subprocess.run(
        [tmp_path / "scripts" / "setup"],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHON": str(python)},
        timeout=30,
        check=False,
    )
    assert process.returncode == 1
    assert f"found: {python}=3.10" in process.stderr
    assert "sudo apt install python3.11 python3.11-venv python3.11-dev" in process.stderr


def test_another_sourced_ros_is_accepted_and_reported_as_untested(tmp_path: Path) -> None:
    """The fake Python 3.14 of Lyrical has no headers, so setup stops there, after all checks of the ROS version."""
    project = tmp_path / "p"
    (project / "scripts").mkdir(parents=True)
    for name in ("environment.sh", "setup"):
        shutil.copy(SCRIPTS / name, project / "scripts")
    python = tmp_path / "python3"
    python.write_text(f'#!/bin/sh\ncase "$2" in *version_info*) echo 3.14;; *) echo {tmp_path}/no_headers;; esac\n')
    python.chmod(0o755)
    ros = {"ROS_DISTRO": "lyrical", "AMENT_PREFIX_PATH": str(tmp_path), "PYTHON": str(python)}
    process = subprocess.run(
        [project / "scripts" / "setup"],
        capture_output=True,
        text=True,
        env={**os.environ, **ros},
        timeout=30,
        check=False,
    )
    assert "this stack was tested with jazzy, not with lyrical" in process.stderr
    assert process.stderr.count("error:") == 1
    assert f"{tmp_path}/no_headers/Python.h is missing" in process.stderr


@pytest.mark.parametrize("script", ["docs", "setup", "test"])
def test_the_help_of_shell_scripts_lists_their_exit_codes(script: str) -> None:
    process = subprocess.run([SCRIPTS / script, "--help"], capture_output=True, text=True, timeout=30, check=False)
    assert process.returncode == 0
    assert "Exit codes: 0" in process.stdout
