"""Learns the Gaussian process' parameters from soundings, and writes them as a ROS 2 parameter file.

Takes a table (CSV) with north_m, east_m, depth_m, or with lat, lon, depth_m (elevation_m, positive up, in place of
depth_m); an npz grid with north_m, east_m, depth_m; or a recorded run (its folder, or its bag): then the soundings of
all vehicles are used.
"""

import argparse
import dataclasses
import math
from pathlib import Path

import numpy as np

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.sections.gp import KERNELS
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.atomic_files import check_file, write_whole
from auv_lse_common.support.option_types import whole_from
from auv_lse_common.support.plurals import counted
from auv_lse_gp.covariance.likelihood import Fit, fit
from auv_lse_gp.covariance.prior_mean import MAX_LEVEL_SIGMAS, excluded_level
from auv_lse_gp.soundings import read_soundings_and_origin
from auv_lse_gp.thinning import soundings_to_fit
from auv_lse_record.recording import Recording, recording_in

_UNITS = {"mean_slope_north": "m/m", "mean_slope_east": "m/m", "rotation_deg": "deg"}

ERRORS = (OSError, ValueError)


def recorded_soundings(path: Path) -> Array:
    """Soundings (n, 3): north, east, depth (m) of all vehicles of a recorded run, in the order of the recording.

    Args:
        path: A run folder (with the recording in `bag`), or a rosbag2 directory.

    Raises:
        ValueError: if there is no recording, it cannot be read, or holds no sounding.
    """
    with Recording(recording_in(path)) as recording:
        rows = [found.value[1:4] for found in recording.values({"sounding"})]
    if not rows:
        raise ValueError(f"{path} holds no sounding (topics /auv1/sounding, /auv2/sounding, ...)")
    soundings = np.array(rows, dtype=float)
    finite: Array = soundings[np.isfinite(soundings).all(axis=1)]
    return finite


def read(path: Path, notes: list[str] | None = None) -> tuple[Array, tuple[float, float] | None]:
    """Soundings (n, 3) of a table, a grid, or a recorded run; and, if the source has lat, lon, the local origin (deg).

    Raises:
        OSError: if it cannot be read.
        ValueError: naming what was expected.
    """
    return (recorded_soundings(path), None) if path.is_dir() else read_soundings_and_origin(path, notes)


def report(result: Fit) -> str:
    """The parameters with their standard errors, one a line, the levels that suit them, and the warnings."""
    reach = MAX_LEVEL_SIGMAS * result.config.signal_std_m
    lines = [
        f"log marginal likelihood {result.log_likelihood:.3f} of {counted(result.soundings, 'sounding')} "
        f"({counted(result.evaluations, 'evaluation')}; {counted(len(result.restarts), 'start')} led to "
        + ", ".join(f"{value:.3f}" for value in result.restarts)
        + ")",
        f"  kernel            {result.config.kernel}",
        f"  mean              {result.config.mean}",
    ]
    for name, error in result.standard_errors.items():
        value = getattr(result.config, name)
        lines.append(f"  {name:17} {value:10.4g} {_UNITS.get(name, 'm'):4} {_error(name, value, error)}")
    config = result.config
    mean = (
        "" if config.mean == "plane" else f", {config.mean_depth_m - reach:.1f} to {config.mean_depth_m + reach:.1f} m"
    )
    lines.append(
        f"This prior nearly excludes isobaths more than {reach:.1f} m from its mean{mean}. For another "
        "level_set.level_m give --level, which proposes a wider prior"
    )
    return "\n".join([*lines, *(f"warning: {warning}" for warning in result.warnings)])


def _error(name: str, value: float, error: float) -> str:
    if name.startswith("mean_") or name == "rotation_deg":
        return f"+- {error:.2g}"
    if not math.isfinite(error) or error > 20.0:
        return "(any value fits)"
    return f"({value * math.exp(-error):.4g} to {value * math.exp(error):.4g})"


def _widened(result: Fit, level_m: float, locations_m: Array) -> Fit:
    """The fit with a standard deviation that does not exclude a level (m), and a warning; unchanged if it suits."""
    found = excluded_level(result.config, level_m, locations_m)
    if found is None:
        return result
    try:
        config = dataclasses.replace(result.config, signal_std_m=found.wide_enough_m)
    except ParameterError as error:
        raise ValueError(
            f"--level: {level_m:g} m is too far from the prior mean of these soundings, {found.nearest_m:.3g} m"
        ) from error
    warning = (
        f"signal_std_m: {found.signal_std_m:.3g} m fits the soundings best, but nearly excludes the {level_m:g} m "
        f"isobath, {found.sigmas:.1f} standard deviations from the prior mean, {found.nearest_m:.3g} m. Proposed: "
        f"{found.wide_enough_m:g} m"
    )
    return dataclasses.replace(
        result,
        config=config,
        standard_errors={name: error for name, error in result.standard_errors.items() if name != "signal_std_m"},
        warnings=[*result.warnings, warning],
    )


def parameter_file(result: Fit, source: str, origin: str = "") -> str:
    """A ROS 2 parameter file with the section `gp`, ready for a mission; `origin`: a comment on the local origin."""
    defaults = type(result.config)()
    learned = {"kernel", "mean", "signal_std_m", "length_scale_m", "noise_std_m", "mean_depth_m"}
    values = {
        field.name: getattr(result.config, field.name)
        for field in dataclasses.fields(result.config)
        if field.name in learned or getattr(result.config, field.name) != getattr(defaults, field.name)
    }
    lines = [
        f"# Learned by auv_lse fit from {counted(result.soundings, 'sounding')} of {source};",
        f"# log marginal likelihood {result.log_likelihood:.3f}.",
        *([f"# {origin}"] if origin else []),
        *(f"# Warning: {warning}" for warning in result.warnings),
        "/**:",
        "  ros__parameters:",
        "    gp:",
    ]
    for name, value in values.items():
        if isinstance(value, str):
            lines.append(f"      {name}: {value}")
            continue
        error = result.standard_errors.get(name)
        note = f"  # {_error(name, value, error)}" if error is not None else ""
        text = repr(float(f"{value:.5g}"))
        lines.append(f"      {name}: {_plain_exponent(text)}{note}")
    return "\n".join(lines) + "\n"


def _plain_exponent(text: str) -> str:
    """A number as YAML 1.1 reads it as one: "1e-05" needs a point."""
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse fit."""
    p = argparse.ArgumentParser(
        prog="auv_lse fit",
        description=__doc__,
        epilog="Exit codes: 0 success; 2 soundings that cannot be read or fitted, or wrong command line; 130 Ctrl-C.",
    )
    p.add_argument("source", type=Path, metavar="SOUNDINGS|RUN", help="table (CSV), npz grid, run folder or bag")
    p.add_argument("--kernel", choices=(*KERNELS, "best"), default="matern52",
                   help="covariance function; best: the likeliest of all (default: %(default)s)")  # fmt: skip
    p.add_argument("--mean", choices=("constant", "plane"), default="constant",
                   help="prior mean (default: %(default)s)")  # fmt: skip
    p.add_argument("--two-axes", action="store_true", help="learn two length scales and a rotation")
    p.add_argument("--level", type=float, metavar="M",
                   help="depth of the isobath to search for: if the fitted prior nearly excludes it, a wider one is "
                   "proposed")  # fmt: skip
    p.add_argument("--points", type=whole_from(10), default=5000, metavar="N",
                   help="use N soundings, drawn at random (default: %(default)s)")  # fmt: skip
    p.add_argument("--restarts", type=whole_from(1), default=5, metavar="N",
                   help="starts of the search (default: %(default)s)")  # fmt: skip
    p.add_argument("--seed", type=whole_from(0), default=0, help="seed of the draw (default: %(default)s)")
    p.add_argument("--out", type=Path, metavar="FILE", help="write a ROS 2 parameter file")
    return p


def _fitted(options: argparse.Namespace) -> tuple[list[Fit], Array, str]:
    """The fits of all wanted kernels, the positions (n, 2) that they used, and what was made of lat, lon."""
    notes: list[str] = []
    soundings, origin = read(options.source, notes)
    print(*notes, sep="\n", end="\n" if notes else "")
    where = ""
    if origin is not None:
        where = f"lat, lon taken as metres north and east of their middle, {origin[0]:.6f}, {origin[1]:.6f} deg"
        if options.mean == "plane":  # mean_depth_m is the plane's depth at the origin
            where += "; the plane holds for a mission with that area.origin_lat_deg, area.origin_lon_deg"
        print(where)
    count = len(soundings)
    soundings, apart = soundings_to_fit(soundings, options.points, options.seed)
    if apart < count:
        print(f"{apart} of {count} soundings lie apart; of those at the same place one counts")
    if len(soundings) < apart:
        print(f"using {len(soundings)} of {apart} soundings, drawn at random (--points, --seed)")
    results = [
        fit(
            soundings[:, :2],
            soundings[:, 2],
            kernel=kernel,
            mean=options.mean,
            two_axes=options.two_axes,
            restarts=options.restarts,
        )
        for kernel in (KERNELS if options.kernel == "best" else (options.kernel,))
    ]
    return results, soundings[:, :2], where


def run(options: argparse.Namespace) -> None:
    """Fits a Gaussian process to soundings.

    Raises:
        ValueError: if the soundings cannot be read or fitted.
        OSError: if a file cannot be read or written.
    """
    if options.level is not None and not math.isfinite(options.level):
        raise ValueError(f"--level must be a depth in metres, not {options.level}")
    if options.out is not None:
        check_file(options.out, "--out")
    try:
        results, points_m, where = _fitted(options)
        result = max(results, key=lambda r: r.log_likelihood)
        if options.level is not None:
            result = _widened(result, options.level, points_m)
    except ValueError as error:
        named = str(error).startswith((str(options.source), "--level"))
        raise ValueError(f"{'' if named else f'{options.source}: '}{error}") from error
    if len(results) > 1:
        for other in sorted(results, key=lambda r: -r.log_likelihood):
            print(f"{other.config.kernel:20} {other.log_likelihood:.3f}")
    print(report(result))
    if options.out is not None:
        write_whole(options.out, parameter_file(result, options.source.name, where))
        print(f"written: {options.out}")
