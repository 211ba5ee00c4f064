"""What recordings hold for a certificate: the mission, the maps that vehicles published, and the files' hashes."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from auv_lse_common.mission_file.parameter_file import parse_parameters, read_parameter_file
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.topics.records import CentersReport, FieldReport
from auv_lse_record.recording import MISSION_FILE, SOFTWARE, STORAGES, Recording, parts_of, recording_in
from auv_lse_record.run_data import RunData
from auv_lse_record.run_reader import read_bag
from auv_lse_shore.areas.area_file import read_area
from auv_lse_shore.judge.team_map import mission_settings
from auv_lse_shore.positions.merging import on_one_clock

_BLOCK = 1 << 20


class CertifyError(ValueError):
    """Recordings that do not belong together, or hold nothing to certify."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceFile:
    """A file that the certificate was made from."""

    name: str
    size_bytes: int
    sha256: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedMap:
    """The last map that a vehicle published, and the kernel centers that it was computed from (None: not recorded)."""

    vehicle: int
    field: FieldReport
    centers: CentersReport | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorded:
    """The recordings of one mission.

    Attributes:
        runs: One for each recording, on the first one's clock.
        settings: Settings that all of them share: level, area, prior.
        maps: The last published map of each vehicle that has one, by number.
        software: Versions that made the recordings; "unknown" where they are not recorded.
    """

    runs: list[RunData]
    settings: PlannerSettings
    maps: dict[int, PublishedMap]
    files: list[SourceFile]
    software: list[str]


def read_recordings(paths: Sequence[Path], mission: Path | None = None) -> Recorded:
    """Reads the recordings of one mission; nothing else in their folders is used.

    Args:
        paths: Run folders or recordings.
        mission: Mission file of recordings without one.

    Raises:
        CertifyError: if they are of different missions, or hold no soundings or no mission file.
        RecordingError, ParameterError: if one cannot be read.
    """
    runs: list[RunData] = []
    maps: dict[int, PublishedMap] = {}
    files: list[SourceFile] = []
    software: list[str] = []
    for path in paths:
        bag = recording_in(path)
        files += [file for part in parts_of(bag) for file in hashes(part)]
        with Recording(bag) as recording:
            text = recording.text(MISSION_FILE)
            software.append(recording.text(SOFTWARE) or "unknown")
            maps |= _published(recording)
        if mission is None and text is None:
            raise CertifyError(f"{path} holds no mission file (topic {MISSION_FILE}); name it with --mission FILE")
        parameters = (
            read_parameter_file(mission, read_area)
            if mission is not None
            else parse_parameters(text or "", f"{path}: mission", is_recorded=True)
        )
        runs.append(read_bag(bag, parameters))
    if mission is not None:
        files += hashes(mission)
    _check(paths, runs)
    settings = mission_settings(runs[0].parameters, runs[0].vehicles[0].vehicle)[-1]
    return Recorded(
        runs=on_one_clock(runs)[0],
        settings=settings,
        maps=dict(sorted(maps.items())),
        files=files,
        software=list(dict.fromkeys(software)),
    )


def _published(recording: Recording) -> dict[int, PublishedMap]:
    """The last map of each vehicle with the last centers up to its stamp."""
    fields: dict[int, FieldReport] = {}
    centers: dict[int, list[CentersReport]] = {}
    for _, vehicle, _, _, value in recording.values({"field", "kernel_centers"}):
        if isinstance(value, FieldReport):
            fields[vehicle] = value
        else:
            centers.setdefault(vehicle, []).append(value)
    return {
        vehicle: PublishedMap(
            vehicle=vehicle,
            field=field,
            centers=max(
                (c for c in centers.get(vehicle, ()) if c.stamp_s <= field.stamp_s),
                key=lambda c: c.stamp_s,
                default=None,
            ),
        )
        for vehicle, field in fields.items()
    }


def _check(paths: Sequence[Path], runs: Sequence[RunData]) -> None:
    """Raises CertifyError for recordings that are not of one mission; drops vehicles without soundings."""
    seen: dict[int, Path] = {}
    for path, run in zip(paths, runs, strict=True):
        if not any(len(v.soundings) for v in run.vehicles):
            raise CertifyError(f"{path} holds no sounding (topic sounding)")
        run.vehicles = [vehicle for vehicle in run.vehicles if len(vehicle.soundings)]
        for vehicle in run.vehicles:
            if vehicle.vehicle in seen:
                raise CertifyError(
                    f"{path} has soundings of auv{vehicle.vehicle}, and so has {seen[vehicle.vehicle]}. Certify "
                    "missions one by one, with each vehicle once"
                )
            seen[vehicle.vehicle] = path
    first = mission_settings(runs[0].parameters, 1)[0]
    for path, run in zip(paths[1:], runs[1:], strict=True):
        other = mission_settings(run.parameters, 1)[0]
        for name in ("mission", "level_set", "area", "gp"):
            if getattr(other, name) != getattr(first, name):
                raise CertifyError(
                    f"{path} has other parameters in section {name} than {paths[0]}, so they are not of one "
                    "mission. Certify missions one by one"
                )
    spans = [_span(run) for run in on_one_clock(runs)[0]]
    for path, (start, end) in zip(paths[1:], spans[1:], strict=True):
        if start > spans[0][1] or end < spans[0][0]:
            raise CertifyError(
                f"{path} has soundings from {start:.0f} to {end:.0f} s, {paths[0]} from {spans[0][0]:.0f} to "
                f"{spans[0][1]:.0f} s, so they are not of one mission. Certify missions one by one"
            )


def _span(run: RunData) -> tuple[float, float]:
    """First and last stamp of a run's soundings."""
    stamps = [v.soundings.stamp_s for v in run.vehicles if len(v.soundings)]
    return min(float(s.min()) for s in stamps), max(float(s.max()) for s in stamps)


def hashes(path: Path) -> list[SourceFile]:
    """SHA-256 of a file, or of the files of messages in a rosbag2 directory."""
    files = sorted(f for f in path.iterdir() if f.suffix in STORAGES) if path.is_dir() else [path]
    found = []
    for file in files:
        digest = hashlib.sha256()
        with file.open("rb") as opened:
            while block := opened.read(_BLOCK):
                digest.update(block)
        found.append(SourceFile(name=file.name, size_bytes=file.stat().st_size, sha256=digest.hexdigest()))
    return found


def without_maps(recorded: Recorded) -> list[int]:
    """Vehicles with soundings that published no map."""
    numbers = [v.vehicle for run in recorded.runs for v in run.vehicles if len(v.soundings)]
    return [number for number in sorted(numbers) if number not in recorded.maps]
