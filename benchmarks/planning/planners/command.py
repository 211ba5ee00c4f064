"""auv_lse bench planners: flies planners over grounds and writes one page."""

import argparse
import hashlib
import itertools
import json
import sys
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.atomic_files import check_file, write_whole
from auv_lse_common.support.plurals import counted
from auv_lse_record.software import other_versions, version
from auv_lse_shore.mission_options import check_option
from benchmarks.planning.peer_environment import PEER, environment
from benchmarks.planning.planners.flight import mission
from benchmarks.planning.planners.grounds import Ground, read
from benchmarks.planning.planners.interface import entry_point, loaded, source_of
from benchmarks.planning.planners.options import AGAINST, HINDSIGHT, OURS, PEER_NAMES, RIVAL_NAMES
from benchmarks.planning.planners.page import page
from benchmarks.results_file import fly
from benchmarks.results_file import read as read_lines


def run(options: argparse.Namespace) -> int:
    """Flies the missions that the results file lacks, and writes the page; returns 1 if missions failed.

    Raises:
        ValueError: for an unknown planner or ground, a file that is not the one listed, a folder that is missing, a
            planner without its environment, or nothing to fly.
        SystemExit: if that environment cannot be made.
    """
    for name in options.planners:
        if name not in (*OURS, *RIVAL_NAMES, HINDSIGHT):
            loaded(name)
        elif point := entry_point(name):
            raise ValueError(f"--planners {name}: the entry point {point.value} has that name, too. Rename it.")
    for vehicles in options.vehicles:
        check_option(f"--vehicles {vehicles}", "mission.vehicles", vehicles)
    check_option(f"--legs {options.legs}", "mission.steps", options.legs)
    absent = [name for name in options.against or () if name not in options.planners]
    if absent:
        raise ValueError(
            f"--against {', '.join(absent)}: not flown. Add {'them' if absent[1:] else 'it'} to --planners."
        )
    if options.data and not options.data.is_dir():
        raise ValueError(f"--data {options.data}: there is no such folder.")
    if options.page:
        check_file(options.page, "--page")
    if options.out.is_dir():
        check_file(options.out, "--out")
    grounds = read(options.grounds, options.data, options.role, options.only or (), _say)
    if not grounds:
        raise ValueError(f"{options.grounds} has no {options.role} ground to fly; name another --role or --grounds.")
    for ground in grounds:
        _check_parameters(ground, options)
    asked = [
        _line(ground, planner, vehicles, seed, options)
        for ground, vehicles, seed, planner in itertools.product(
            grounds, dict.fromkeys(options.vehicles), range(1, options.seeds + 1), dict.fromkeys(options.planners)
        )
    ]
    peers = sorted({*options.planners} & {*PEER_NAMES})
    if peers and options.environment is None:
        raise ValueError(
            f"{', '.join(peers)}: {PEER} runs in an environment of its own. Name a folder for it: --environment FOLDER "
            "(3 GB, installed once)."
        )
    python = environment(options.environment.absolute()) if peers else None
    failures = _fly_missing(asked, grounds, python, options)
    wanted = {_id(line) for line in asked}
    lines = {_id(line): line for line in read_lines(options.out)}  # two commands at once may fly a mission twice
    flown_lines = [line for known, line in lines.items() if known in wanted]
    if not flown_lines:
        _say("every mission failed; there is no page")
        return 1
    text = page(flown_lines, options.against or AGAINST)
    if options.page:
        write_whole(options.page, text)
    else:
        print(text, end="")
    if failures:
        _say(f"{counted(len(failures), 'mission')} failed; the page has the others")
    return 1 if failures else 0


def _fly_missing(
    asked: list[dict[str, Any]], grounds: list[Ground], python: Path | None, options: argparse.Namespace
) -> list[ValueError]:
    """Flies the missions that the results file lacks; the errors of those that fail."""
    done = {_id(line): line for line in read_lines(options.out)}
    jobs = [(line, ground_of(grounds, line).parameters, python) for line in asked if _id(line) not in done]
    _say(f"{counted(len(jobs), 'mission')} to fly, {len(asked) - len(jobs)} in {options.out}")
    if others := other_versions(done[_id(line)] for line in asked if _id(line) in done):
        _say(f"missions in {options.out} come from version {others}; this is {version()}")
        _say("to fly all again, give another --out")
    failures: list[ValueError] = []

    def failed(error: ValueError) -> None:
        failures.append(error)
        _say(f"failed: {error}")

    for line in fly(flown, jobs, options.out, options.processes, failed):
        _say(f"{line['ground']} {line['vehicles']} {line['planner']} found {line['found'][-1]:.2f}")
    return failures


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _check_parameters(ground: Ground, options: argparse.Namespace) -> None:
    """Refuses a ground whose mission no team of these sizes can fly, before the first one flies.

    Raises:
        ValueError: naming the manifest, the ground and the parameter.
    """
    for vehicles in options.vehicles:
        overrides = {**ground.parameters, "mission.vehicles": vehicles}
        Settings.from_patterns({"/**": {}}, f"{options.grounds}: {ground.name}", overrides)


def ground_of(grounds: list[Ground], line: dict[str, Any]) -> Ground:
    """The ground of a line."""
    return next(ground for ground in grounds if ground.name == line["ground"])


def flown(line: dict[str, Any], parameters: dict[str, Any], python: Path | None) -> dict[str, Any]:
    """A mission's line with its figures."""
    whole = line["simulation"] == "whole"
    try:
        found = mission(line["planner"], parameters, line["vehicles"], line["seed"], line["legs"], python, whole)
    except ValueError as error:
        raise ValueError(f"{line['planner']} on {line['ground']}, seed {line['seed']}: {error}") from error
    return {**line, "version": version(), **found}


def _line(ground: Ground, planner: str, vehicles: int, seed: int, options: argparse.Namespace) -> dict[str, Any]:
    return {
        "ground": ground.name,
        "role": ground.role,
        "planner": planner,
        "vehicles": vehicles,
        "seed": seed,
        "legs": options.legs,
        "simulation": "whole" if options.whole else "light",
        "inputs": _inputs(ground, planner),
    }


def _inputs(ground: Ground, planner: str) -> str:
    """Digest of the ground's parameters and data, and of a planner's source: a change of either is another mission."""
    source = b"" if planner in (*OURS, *RIVAL_NAMES, HINDSIGHT) else source_of(planner)
    text = json.dumps([ground.mission, ground.sha256, hashlib.sha256(source).hexdigest()], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _id(line: dict[str, Any]) -> tuple[Any, ...]:
    keys = ("ground", "role", "planner", "vehicles", "seed", "legs", "simulation", "inputs")
    return tuple(line.get(key) for key in keys)
