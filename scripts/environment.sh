# Sourced by the scripts, not run: finds the project's root and, after `use_environment`, the environment that
# scripts/setup made (python, the built workspace, DDS bound to this machine).

ROOT="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
VENV="$ROOT/.venv"
INSTALL="$ROOT/ros_ws/install"
unset PYTHONHOME # another Python's library: that of the environment would not start with it

# True where a ROS 2 of the machine's own is sourced (not the wheels of our venv).
ros_is_sourced() { [ -n "${ROS_DISTRO:-}" ] && [ -n "${AMENT_PREFIX_PATH:-}" ]; }

# Text that changes when the environment has to be made or built again.
environment_fingerprint() {
    {
        cat "$ROOT"/config/{requirements,constraints,locked}*.txt "$ROOT"/scripts/setup
        cat "$ROOT"/auv_lse_*/package.xml "$ROOT"/auv_lse_*/setup.py "$ROOT"/auv_lse_*/setup.cfg
        cat "$ROOT"/auv_lse_msgs/CMakeLists.txt "$ROOT"/auv_lse_msgs/msg/*.msg "$ROOT"/auv_lse_msgs/srv/*.srv
        echo "$ROOT" "$ROOT"/auv_lse_*/launch/*
        if ros_is_sourced; then echo "ros $ROS_DISTRO ${AMENT_PREFIX_PATH##*:}"; else echo pypi; fi
    } 2>/dev/null | sha256sum
}

# Text that changes when inner loops have to be compiled again: numba goes by size and time of their files.
loops_fingerprint() {
    grep -rl --include='*.py' '^@compiled' "$ROOT"/auv_lse_*/auv_lse_* 2> /dev/null | LC_ALL=C sort |
        xargs -r -d '\n' stat -c '%n %s %Y' | sha256sum
}

# Sets up when needed (quiet when there is nothing to do), then puts the environment into this shell. Returns what
# scripts/setup returned if that failed. Leaves the shell's own settings as they were.
use_environment() {
    set_up || return $?
    enter_environment
}

# Sets up when needed.
set_up() {
    source_ros
    "$ROOT/scripts/setup" --quiet
}

# Puts the environment into this shell as scripts/setup left it: nothing is downloaded, built or compiled.
use_environment_as_it_is() {
    if [ ! -x "$VENV/bin/python" ] || [ ! -f "$INSTALL/local_setup.bash" ]; then
        echo "error: scripts/$(basename "$0") needs the environment of this checkout. Make it: $ROOT/scripts/setup" >&2
        return 2
    fi
    source_ros
    [ "$(cat "$VENV/setup.done" 2> /dev/null)" = "$(environment_fingerprint)" ] ||
        echo "warning: the environment is older than its sources; renew it: $ROOT/scripts/setup" >&2
    enter_environment
}

# Sources the ROS 2 with which scripts/setup was called, if this shell has none: at boot nobody has sourced it.
source_ros() {
    local strict=
    ! ros_is_sourced && grep -qs '^include-system-site-packages = true' "$VENV/pyvenv.cfg" || return 0
    case $- in *u*) strict=1 ;; esac
    set +u # colcon's own script reads unset variables
    [ ! -f "$INSTALL/setup.bash" ] || . "$INSTALL/setup.bash"
    [ -z "$strict" ] || set -u
}

# Puts the environment that scripts/setup made into this shell.
enter_environment() {
    local site strict=
    export PATH="$VENV/bin:$PATH"
    if ! ros_is_sourced; then
        export AMENT_PREFIX_PATH="$VENV" RMW_IMPLEMENTATION=rmw_fastrtps_cpp
        unset PYTHONPATH
    fi
    case $- in *u*) strict=1 ;; esac
    set +u # colcon's own script reads unset variables
    . "$INSTALL/local_setup.bash"
    [ -z "$strict" ] || set -u
    if ros_is_sourced; then
        # The system's ros2 launch runs on the system's Python: it finds our packages here, after all of its own.
        for site in "$VENV"/lib/python3.*/site-packages; do
            case ":${PYTHONPATH:-}:" in
                *":$site:"*) ;;
                *) export PYTHONPATH="${PYTHONPATH:+$PYTHONPATH:}$site" ;;
            esac
        done
    fi
    export AUV_LSE_ROOT="$ROOT"
    # One thread per process: a mission is many processes on few cores.
    export OMP_NUM_THREADS="${OMP_NUM_THREADS:-1}" OPENBLAS_NUM_THREADS="${OPENBLAS_NUM_THREADS:-1}"
}
