"""Grounds of the benchmark, from a manifest: parameters of a mission file each, and where real data come from.

grounds:
  - name: Lake Tzibana
    role: tuning                     # tuning, choosing or reporting
    file: tzibana_grid10m.npz        # beside the manifest, or in --data; made-up grounds have none
    sha256: 3f2a...
    source: https://doi.org/10.5281/zenodo.3782402
    licence: CC-BY 4.0
    projection: azimuthal equidistant about 17.1221, -91.6281
    mission: {level_set.level_m: 15.0, gp.map_resolution_m: 10.0}
"""

import dataclasses
import hashlib
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

import yaml

from benchmarks.planning.planners.options import MANIFEST, ROLES

#: Keys of a ground; those of `REAL` belong to grounds with a file.
KEYS = {"name", "role", "mission", "file", "sha256", "source", "licence", "projection"}
REAL = ("sha256", "source", "licence", "projection")


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """A ground.

    Attributes:
        mission: Parameters of the mission file, dotted.
        file: Its data; None for made-up ground.
        source: Where the data come from, under which licence, and how they are projected; "" for made-up ground.
        sha256: Digest of the file; "" for made-up ground.
    """

    name: str
    role: str
    mission: Mapping[str, Any]
    file: Path | None = None
    source: str = ""
    sha256: str = ""

    @property
    def parameters(self) -> dict[str, Any]:
        """The mission's parameters, with the file."""
        if self.file is None:
            return dict(self.mission)
        return {"sim.bathymetry.file": str(self.file), **self.mission}


class MissingFileError(ValueError):
    """A ground's file is not there."""


def read(
    manifest: Path,
    data: Path | None = None,
    role: str | None = None,
    only: Collection[str] = (),
    leave_out: Callable[[str], None] | None = None,
) -> list[Ground]:
    """The grounds of a manifest.

    Args:
        manifest: A YAML file.
        data: Folder of the files; None: that of the manifest.
        role: Only grounds of this role; None: all.
        only: Only these, by name; empty: all.
        leave_out: Takes a sentence about each ground whose file is missing, and that is not among `only`; None: such a
            ground is an error, too.

    Raises:
        ValueError: naming what is wrong in the manifest, a ground that it does not have, or a file that is missing or
            not the one listed.
    """
    listed = _listed(manifest)
    wanted = [entry for entry in listed if role is None or entry.get("role") == role]
    names = [str(entry.get("name")) for entry in wanted]
    unknown = sorted(set(only) - set(names))
    if unknown:
        kind = f"{role} ground" if role else "ground"
        roles = {str(entry.get("role")) for entry in listed if str(entry.get("name")) in unknown}
        cure = f" Add --role {roles.pop()}." if len(roles) == 1 else ""
        raise ValueError(f"{manifest} has no {kind} {', '.join(unknown)}; it has {', '.join(names) or 'none'}.{cure}")
    found = []
    for entry in wanted:
        if only and str(entry.get("name")) not in only:
            continue
        try:
            found.append(_ground(entry, manifest, data or manifest.parent))
        except MissingFileError as error:
            if only or leave_out is None:
                raise
            leave_out(f"not flown: {error}")
    return found


def _listed(manifest: Path) -> list[Mapping[str, Any]]:
    """The entries of a manifest, each with a name of its own: results are found by it."""
    try:
        body = yaml.safe_load(manifest.read_text())
    except OSError as error:
        raise ValueError(f"{manifest}: cannot be read: {error.strerror or error}.") from error
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise ValueError(f"{manifest} is not a manifest of grounds ({' '.join(str(error).split())}).") from error
    if not isinstance(body, Mapping) or "grounds" not in body:
        raise ValueError(f"{manifest} is not a manifest of grounds: it lacks the list grounds, as in {MANIFEST.name}.")
    listed = body["grounds"]
    if not isinstance(listed, list) or not all(isinstance(entry, Mapping) for entry in listed):
        raise ValueError(f"{manifest}: grounds must be a list of mappings, not {repr(listed)[:60]}.")
    for entry in listed:
        _check_keys(entry, _where(entry, manifest))
    names = [str(entry["name"]) for entry in listed]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"{manifest}: several grounds are called {', '.join(twice)}; give each a name of its own.")
    return listed


def _where(entry: Mapping[str, Any], manifest: Path) -> str:
    return f"{manifest}: {entry.get('name', 'a ground without a name')}"


def _check_keys(entry: Mapping[str, Any], where: str) -> None:
    """Refuses keys and roles that do not exist: a ground of a mistyped role would be left out."""
    unknown = sorted({str(key) for key in entry} - KEYS)
    if unknown:
        raise ValueError(f"{where}: unknown key {', '.join(unknown)}; use {', '.join(sorted(KEYS))}.")
    if "name" not in entry or entry.get("role") not in ROLES:
        raise ValueError(
            f"{where}: role is {entry.get('role')!r}; a ground has a name, a role ({', '.join(ROLES[:-1])} or "
            f"{ROLES[-1]}), and parameters."
        )


def _ground(entry: Mapping[str, Any], manifest: Path, folder: Path) -> Ground:
    where = _where(entry, manifest)
    parameters = entry.get("mission", {})
    if not isinstance(parameters, Mapping):
        raise ValueError(f"{where}: mission must hold parameters by dotted name, not {parameters!r}.")
    common: dict[str, Any] = {"name": str(entry["name"]), "role": str(entry["role"]), "mission": dict(parameters)}
    if "file" not in entry:
        return Ground(**common)
    missing = [key for key in REAL if not entry.get(key)]
    if missing:
        raise ValueError(f"{where}: a ground with a file also has {', '.join(missing)}.")
    file = folder / str(entry["file"])
    if not file.is_file():
        raise MissingFileError(
            f"{where}: there is no file {file}. Download it from {entry['source']}, or name its folder (--data)."
        )
    found = hashlib.sha256(file.read_bytes()).hexdigest()
    if found != str(entry["sha256"]).lower():
        raise ValueError(f"{where}: {file} has the SHA-256 {found}, not the one listed. Download it again.")
    source = f"{entry['source']}, {entry['licence']}, {entry['projection']}"
    return Ground(**common, file=file.resolve(), source=source, sha256=found)
