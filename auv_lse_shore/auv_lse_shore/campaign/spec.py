"""A campaign: settings times seeds, from a YAML file.

name: loss                          # the campaign's name, and that of its folder without --out
mission: ../missions/default.yaml   # optional: the mission file to start from (beside this file)
set: {mission.steps: 50}            # optional: parameters of all missions, by dotted name
grid:                               # every combination of these ...
  planner.method: [augmented, plain]
  sim.channel.packet_loss: [0.0, 0.5]
list:                               # ... with each of these: a label, and the parameters that it stands for
  - {label: pair, mission.vehicles: 2}
  - {label: trio, mission.vehicles: 3}
seeds: 50                           # 1 to 50; or a list; or {first: 101, count: 50}
"""

from __future__ import annotations

import functools
import hashlib
import itertools
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.parameter_file import read_parameter_file, read_yaml
from auv_lse_common.mission_file.parameters import INTEGER_LIMIT, ParameterError
from auv_lse_common.mission_file.settings import Patterns, Settings
from auv_lse_shore.areas.area_file import read_area
from auv_lse_shore.mission_options import check_vehicles

KEYS = ("name", "mission", "set", "grid", "list", "seeds")
#: A name for a folder: no path, not hidden, printable; and its largest length (bytes).
_NAME = re.compile(r"[^\W.][^/\x00-\x1f\x7f]*")
_MAX_NAME_BYTES = 100
#: More seeds would take weeks, and the list of missions would exceed the memory.
_MAX_SEEDS = 100_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One mission of a campaign.

    Attributes:
        id: A digest of its complete parameters and of its survey files, so that after a change of the campaign file
            only changed missions are simulated.
        group: Label of its setting; all seeds of one setting share it.
        varied: The parameters in which settings differ, with this mission's values.
        patterns: Its complete mission file.
    """

    id: str
    group: str
    varied: Mapping[str, Any]
    seed: int
    patterns: Patterns


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignSpec:
    """A campaign.

    Attributes:
        settings: Parameters of each setting (dotted names), with its label.
        seeds: Seeds of every setting.
        varied: Names of the parameters in which settings differ, in order.
        base: The mission file that all settings start from, as written: defaults that depend on the number of
            vehicles are filled in per setting.
        where: The campaign file, for error messages.
    """

    name: str
    settings: tuple[tuple[str, Mapping[str, Any]], ...]
    seeds: tuple[int, ...]
    varied: tuple[str, ...]
    base: Patterns
    where: str

    @classmethod
    def load(cls, path: Path) -> CampaignSpec:
        """Reads a campaign file.

        Raises:
            ParameterError: naming the key, the value and what was expected.
        """
        return cls.from_mapping(read_yaml(path), str(path), path.resolve().parent, path.stem)

    @classmethod
    def from_mapping(cls, content: Any, where: str, folder: Path, name: str = "campaign") -> CampaignSpec:
        """The campaign of a mapping (as in the file); the path of its mission file is relative to `folder`.

        Raises:
            ParameterError: naming the key, the value and what was expected.
        """
        if not isinstance(content, Mapping) or not content:
            found = "is empty" if content is None else f"holds {repr(content)[:60]}"
            raise ParameterError(f"{where} {found}; write a mapping with any of {', '.join(KEYS)}")
        for key in content:
            if key not in KEYS:
                raise ParameterError(f"{where}: {key}: unknown key; use one of {', '.join(KEYS)}")
        common = _mapping(content.get("set", {}), f"{where}: set")
        grid = _mapping(content.get("grid", {}), f"{where}: grid")
        for parameter, values in grid.items():
            if not isinstance(values, list) or not values:
                raise ParameterError(f"{where}: grid: {parameter} must be a list of values, not {values!r}")
        listed = content.get("list", [{}])
        if not isinstance(listed, list) or not listed:
            raise ParameterError(f"{where}: list must be a list of mappings, not {listed!r}")
        settings: list[tuple[str, Mapping[str, Any]]] = []
        for entry in listed:
            own = dict(_mapping(entry, f"{where}: list"))
            label = own.pop("label", None)
            for values in itertools.product(*grid.values()):
                chosen = dict(zip(grid, values, strict=True))
                if both := set(own) & set(chosen):
                    raise ParameterError(
                        f"{where}: {', '.join(sorted(both))} is both in grid and in list; keep it in one of them"
                    )
                names = [*own, *chosen]
                parts = [str(label)] if label is not None else [short(k, v, names) for k, v in own.items()]
                parts += [short(k, v, names) for k, v in chosen.items()]
                settings.append((", ".join(parts) or "all", {**common, **own, **chosen}))
        labels = [label for label, _ in settings]
        if len(set(labels)) != len(labels):
            twice = next(label for label in labels if labels.count(label) > 1)
            raise ParameterError(f"{where}: two settings are called '{twice}'; give them different labels")
        mission = content.get("mission")
        file = folder / str(mission) if mission else None
        Settings.load(file, read_area=read_area)  # reports errors of the file itself first
        for label, values in settings:
            if "mission.seed" in values:
                raise ParameterError(f"{where}: setting '{label}' sets mission.seed; list seeds under `seeds` instead")
        varied = dict.fromkeys(k for entry in listed for k in entry if k != "label") | dict.fromkeys(grid)
        return cls(
            name=_folder_name(content.get("name") or name, where),
            settings=tuple(settings),
            seeds=_seeds(content.get("seeds", 1), where),
            varied=tuple(varied),
            base=read_parameter_file(file, read_area) if file is not None else {"/**": {}},
            where=where,
        )

    def jobs(self) -> list[Job]:
        """Every mission, seed by seed: a campaign that is stopped early has the same seeds of every setting.

        Raises:
            ParameterError: if a setting cannot be used.
        """
        jobs = []
        by_setting = []
        largest: dict[str, int] = {}  # team of the settings that have a parameter
        for label, values in self.settings:
            where = f"{self.where}: setting '{label}'"
            settings = Settings.from_patterns(self.base, where, values)
            largest |= {name: max(largest.get(name, 0), settings.mission.vehicles) for name in values}
            surveys = "".join(_digest(file, f"{where}: {name}") for name, file in _survey_files(settings))
            by_setting.append((label, values, settings.open_patterns(), surveys))
        for name, vehicles in largest.items():
            check_vehicles([name], vehicles, f"{self.where}: ")
        for seed in self.seeds:
            for label, values, complete, surveys in by_setting:
                common = complete["/**"]
                patterns = {**complete, "/**": {**common, "mission": {**common["mission"], "seed": seed}}}
                text = json.dumps(patterns, sort_keys=True) + surveys
                digest = hashlib.sha256(text.encode()).hexdigest()[:16]
                varied = {name: values[name] for name in self.varied if name in values}
                jobs.append(Job(id=digest, group=label, varied=varied, seed=seed, patterns=patterns))
        ids = [job.id for job in jobs]
        if len(set(ids)) != len(ids):
            twice = next(job for job in jobs if ids.count(job.id) > 1)
            raise ParameterError(
                f"{self.where}: setting '{twice.group}' with seed {twice.seed} is the same mission as another one"
            )
        return jobs


def _survey_files(settings: Settings) -> dict[tuple[str, str], None]:
    """The files of soundings that a mission reads, each with its parameter."""
    priors = [("gp.survey_file", own.gp.survey_file) for own in settings.vehicles if own.gp.mean == "survey"]
    return dict.fromkeys([("sim.bathymetry.file", settings.sim.bathymetry.file), *priors])


@functools.cache
def _digest(file: str, where: str) -> str:
    """Digest of a survey file's content, so that a changed file makes other missions; "" for no file."""
    if not file:
        return ""
    try:
        return hashlib.sha256(Path(file).read_bytes()).hexdigest()
    except OSError as error:
        raise ParameterError(f"{where}: {file}: {error.strerror or error}") from error


def _mapping(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise ParameterError(
            f"{where} must hold parameters by dotted name, such as planner.method: plain, not {value!r}"
        )
    return {str(k): v for k, v in value.items()}


def _folder_name(value: Any, where: str) -> str:
    """The campaign's name, checked."""
    name = str(value)
    if not isinstance(value, str | int) or not _NAME.fullmatch(name) or len(name.encode()) > _MAX_NAME_BYTES:
        raise ParameterError(
            f"{where}: name: {value!r} cannot name a folder; leave out '/' and a leading '.', and use at most "
            f"{_MAX_NAME_BYTES} bytes"
        )
    return name


def _seeds(value: Any, where: str) -> tuple[int, ...]:
    first, count = 1, value
    if isinstance(value, Mapping) and set(value) == {"first", "count"}:
        first, count = value["first"], value["count"]
    if _whole(first) and _whole(count) and count >= 1:
        if count > _MAX_SEEDS:
            raise ParameterError(f"{where}: seeds: {value!r} are more than {_MAX_SEEDS} seeds")
        _check_size(first + count - 1, where)
        return tuple(range(first, first + count))
    if isinstance(value, Sequence) and not isinstance(value, str) and _different_seeds(value):
        _check_size(max(value), where)
        return tuple(value)
    raise ParameterError(
        f"{where}: seeds must be a number of seeds, a list of different whole numbers from 0, or "
        f"{{first: from 0, count: from 1}}, not {value!r}"
    )


def _check_size(seed: int, where: str) -> None:
    """Refuses a seed that neither a mission file nor a row can hold."""
    if seed >= INTEGER_LIMIT:
        raise ParameterError(f"{where}: seeds: {seed} does not fit 64 bits; use a seed below {INTEGER_LIMIT}")


def _different_seeds(values: Sequence[Any]) -> bool:
    return all(map(_whole, values)) and 0 < len(values) == len(set(values))


def _whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def short(name: str, value: Any, among: Sequence[str]) -> str:
    """A parameter and its value in few words: by its last name, if that is unique among those of a setting."""
    last = name.split(".")[-1]
    return f"{last if sum(other.split('.')[-1] == last for other in among) == 1 else name} {value}"
