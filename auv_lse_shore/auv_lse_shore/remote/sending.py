"""auv_lse fleet send: all vehicles get the same mission and key, or the command names who has not."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from auv_lse_run.remote.dive_process import MISSION
from auv_lse_shore.remote.contacts import repeated, with_each
from auv_lse_shore.remote.fleet_file import FleetFile, RemoteVehicle
from auv_lse_shore.remote.ledger_file import LedgerFile
from auv_lse_shore.remote.outgoing import hashes_of, outgoing_files
from auv_lse_shore.remote.ssh import RemoteSession, VehicleError

_ANSWER_S = 60.0


def send(fleet: FleetFile, vehicles: Sequence[RemoteVehicle], mission: Path, wait_s: float) -> int:
    """Sends a mission; returns the exit code: 0 if every vehicle has it.

    Args:
        wait_s: How long to repeat (s).

    Raises:
        ParameterError: if the mission file is wrong.
    """
    files = outgoing_files(mission)
    hashes = hashes_of(files)
    staged = with_each(vehicles, lambda v: repeated(fleet, v, wait_s, lambda s: _stage(s, files, hashes)))
    if failed := {name: text for name, text in staged.items() if text}:
        for name, text in failed.items():
            print(f"{name}: {text}", file=sys.stderr)
        print("Nothing was changed on any vehicle.", file=sys.stderr)
        return 1
    installed = with_each(vehicles, lambda v: repeated(fleet, v, wait_s, lambda s: _install(s, hashes)))
    with LedgerFile(fleet.path).changed() as ledger:
        ledger.sent = {MISSION: hashes[MISSION]}
        for name in installed:
            ledger.checked.pop(name, None)
    others = ", ".join(sorted(set(files) - {MISSION}))
    what = f"{MISSION} {hashes[MISSION][:8]}{f', {others}' if others else ''}"
    for name, text in installed.items():
        print(f"{name}: {text or f'has {what}'}", file=sys.stderr if text else sys.stdout)
    return int(any(installed.values()))


def _stage(found: RemoteSession, files: Mapping[str, bytes], hashes: Mapping[str, str]) -> str:
    if found.ask("state", _ANSWER_S)["running"]:
        raise VehicleError("a dive is running; its files are not replaced. End it first: auv_lse fleet FILE stop")
    for name, data in files.items():
        found.ask("put", _ANSWER_S, data, name=name, sha256=hashes[name])
    return ""


def _install(found: RemoteSession, hashes: Mapping[str, str]) -> str:
    has = found.ask("install", _ANSWER_S, files=dict(hashes))["hashes"]
    wrong = sorted(name for name in hashes if has.get(name) != hashes[name])
    if wrong:
        raise VehicleError(f"has not {', '.join(wrong)}. Send it again.")
    return ""
