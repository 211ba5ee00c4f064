"""A certificate's content, and its files `certificate.json` and `certificate.html`."""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.mission_file.parameter_file import parameters_for
from auv_lse_common.support.atomic_files import written_whole
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_gp.map.certainty import CLASSES, FOUND, Piece, found_within_m, length_of
from auv_lse_gp.map.depth_map import BAND_SIGMAS
from auv_lse_record.software import version
from auv_lse_shore.certify import calibration
from auv_lse_shore.certify.checks import Check, check_map
from auv_lse_shore.certify.final_map import FinalMap, corrected_runs, final_map
from auv_lse_shore.certify.recorded import Recorded, hashes, read_recordings, without_maps
from auv_lse_shore.report.page import embed, number, render
from auv_lse_shore.report.progress import Show, show_nothing
from auv_lse_shore.report.words import MIN_STRETCH_M, is_length, opening_lines

#: Verdicts, and the exit code of each.
SUPPORTED, CONTRADICTED, UNPUBLISHED = "supported", "contradicted", "nothing published"
EXIT_CODES = {SUPPORTED: 0, CONTRADICTED: 1, UNPUBLISHED: 3}

_VERDICTS = {
    SUPPORTED: "The recordings support the maps that the vehicles published.",
    CONTRADICTED: "The recordings do NOT support the maps that the vehicles published.",
    UNPUBLISHED: "Not every vehicle's recording has a published map. The map below rests on the soundings alone.",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """The content of a certificate.

    Attributes:
        verdict: `SUPPORTED`, `CONTRADICTED` or `UNPUBLISHED`.
        checks: Every comparison with published maps.
        values: What the JSON file holds.
    """

    verdict: str
    final: FinalMap
    checks: list[Check]
    values: dict[str, Any]

    @property
    def failures(self) -> list[str]:
        """Where published maps are not supported, one line each."""
        return [_failure(check, self.final.run.origin) for check in self.checks if not check.passed]


def certify(paths: Sequence[Path], mission: Path | None = None, show: Show = show_nothing) -> Certificate:
    """Makes the certificate of a mission.

    Args:
        paths: Run folders or recordings.
        mission: Mission file of recordings without one.

    Raises:
        CertifyError: if the recordings are not of one mission, or hold no soundings.
        RecordingError, ParameterError: if one cannot be read.
    """
    show("reading the recordings")
    recorded = read_recordings(paths, mission)
    show("estimating the positions of soundings")
    run, positions = corrected_runs(recorded)
    checks, notes = [], []
    for published in recorded.maps.values():
        show(f"recomputing the map of auv{published.vehicle}")
        done, left = check_map(published, recorded.settings, run)
        checks += done
        notes += left
    silent = without_maps(recorded)
    notes += [f"auv{number}: its recording has no published map (topic field)" for number in silent]
    verdict = CONTRADICTED if not all(c.passed for c in checks) else UNPUBLISHED if silent else SUPPORTED
    show("computing the final map")
    final = final_map(recorded, run, positions)
    show("")
    if not any(len(v.decisions) for v in run.vehicles):
        notes.append("no plan is recorded: whether the mission was flown to its end is unknown")
    return Certificate(
        verdict=verdict, final=final, checks=checks, values=_values(recorded, final, checks, notes, verdict, paths)
    )


def _values(
    recorded: Recorded, final: FinalMap, checks: list[Check], notes: list[str], verdict: str, paths: Sequence[Path]
) -> dict[str, Any]:
    settings, origin = recorded.settings, final.run.origin
    files = list(recorded.files)
    if settings.gp.mean == "survey":
        files += hashes(Path(settings.gp.survey_file))
    asked: dict[str, Any] = {
        "level_m": settings.level_set.level_m,
        "polygon_m": list(settings.area.polygon_m),
        "no_go": sorted(name for name in settings.area.no_go if not name.startswith("unreachable_")),
        "origin_deg": origin,
        "vehicles": len(final.run.vehicles),
        "steps": settings.mission.steps,
        "steps_flown": final.run.steps,
        "until": parameters_for(final.run.parameters, "/auv1/planner_node").get("mission", {}).get("until"),
        "prior": dataclasses.asdict(settings.gp),
        "notes": list(dict.fromkeys(note for run in recorded.runs for note in run.notes)),
    }
    return {
        "certificate": 1,
        "verdict": verdict,
        "asked": asked,
        "promised": {
            **{f"{kind}_m": round(length_of(final.pieces, kind), 1) for kind in CLASSES},
            "found_within_m": _rounded(found_within_m(final.pieces)),
            "band_sigmas": round(BAND_SIGMAS, 3),
            "pieces": [_piece(piece, origin) for piece in _sorted(final.pieces)],
        },
        "not_promised": {
            "undiscovered_m": round(final.undiscovered.expected_m, 1),
            "undiscovered_limit_m": round(final.undiscovered.limit_m, 1),
            "undiscovered_locations": [
                {**_location(north, east, origin), "expected_m": round(length, 1)}
                for north, east, length in final.undiscovered.patches()
                if length >= MIN_STRETCH_M
            ],
            "unreachable_m2": round(final.area.unreachable_m2, 1),
            "unsure_m": round(sum(p.length_m for p in final.pieces if p.kind != FOUND), 1),
        },
        "map": {
            "soundings": sum(len(v.soundings) for v in final.run.vehicles),
            "averages": final.averages,
            "locations": final.positions,
            "variance_scale": round(final.field.variance_scale, 6),
        },
        "checks": [_checked(check, origin) for check in checks],
        "cannot_certify": notes,
        "calibration": calibration.calibration(),
        "software": {"recorded": recorded.software, "certificate": version()},
        "files": [dataclasses.asdict(file) for file in files],
        "repeat": "auv_lse certify " + " ".join(path.name for path in paths),
    }


def _sorted(pieces: list[Piece]) -> list[Piece]:
    return sorted(pieces, key=lambda p: (CLASSES.index(p.kind), -p.length_m))


def _location(north: float, east: float, origin: tuple[float, float] | None) -> dict[str, float]:
    location = {"north_m": round(float(north), 1), "east_m": round(float(east), 1)}
    if origin is not None:
        latitude, longitude = geodetic_from_local(north, east, *origin)
        location |= {"latitude_deg": round(float(latitude), 6), "longitude_deg": round(float(longitude), 6)}
    return location


def _piece(piece: Piece, origin: tuple[float, float] | None) -> dict[str, Any]:
    """A piece: its class, length, ends, and half the width of its band, median and largest (null: no slope)."""
    half = BAND_SIGMAS * piece.std_m
    widths = {"band_median_m": float(np.median(half)), "band_largest_m": float(half.max())}
    return {
        "class": piece.kind,
        "reason": piece.reason,
        "length_m": round(piece.length_m, 1),
        **{name: _rounded(width) for name, width in widths.items()},
        "from": _location(piece.line[0, 0], piece.line[0, 1], origin),
        "to": _location(piece.line[-1, 0], piece.line[-1, 1], origin),
    }


def _rounded(value_m: float) -> float | None:
    return round(value_m, 1) if math.isfinite(value_m) else None


def _checked(check: Check, origin: tuple[float, float] | None) -> dict[str, Any]:
    worst = round(check.worst, 4) if math.isfinite(check.worst) else None
    return {
        "vehicle": check.vehicle,
        "what": check.what,
        "passed": check.passed,
        "worst_over_tolerance": worst,
        "cells_beyond": check.cells,
        "at": check.location(origin),
        "published": _finite(check.published),
        "recomputed": _finite(check.recomputed),
        "tolerance": _finite(check.tolerance),
    }


def _finite(value: float) -> float | None:
    return round(value, 5) if math.isfinite(value) else None


def _failure(check: Check, origin: tuple[float, float] | None) -> str:
    unit = f" {check.unit}" if check.unit else ""
    return (
        f"auv{check.vehicle}: {check.what}: published as {check.published:.3f}{unit} at "
        f"{_where(check.location(origin))}, recomputed as {check.recomputed:.3f} ± {check.tolerance:.3f}{unit} "
        f"(cells that differ: {check.cells:,})"
    )


def _where(location: Mapping[str, float]) -> str:
    text = f"north {location['north_m']:.0f} m, east {location['east_m']:.0f} m"
    if "latitude_deg" in location:
        text += f" ({location['latitude_deg']:.5f}, {location['longitude_deg']:.5f} deg)"
    return text


def lines(certificate: Certificate) -> list[str]:
    """The certificate in brief, for the terminal and the top of the page."""
    v, promised = certificate.values, certificate.values["promised"]
    missing = v["not_promised"]
    return [
        _VERDICTS[certificate.verdict],
        *opening_lines(
            {kind: promised[f"{kind}_m"] for kind in CLASSES},
            promised["found_within_m"],
            missing["undiscovered_m"],
            missing["undiscovered_limit_m"],
        ),
    ]


def write(certificate: Certificate, folder: Path) -> None:
    """Writes both files, and replaces those of an earlier certificate.

    Raises:
        OSError: if they cannot be written; the folder is then unchanged.
    """
    from auv_lse_shore.certify.picture import draw  # slow to import

    with written_whole(folder) as part:
        (part / "certificate.json").write_text(json.dumps(certificate.values, indent=1, allow_nan=False) + "\n")
        draw(certificate.final, part / "certificate.png")
        caption = (
            "The final map: where the water is at least the level deep, the soundings (grey), and the isobath: found "
            "(black), likely (yellow) and guessed (dotted)."
        )
        picture = embed(part / "certificate.png", caption)
        (part / "certificate.png").unlink()
        (part / "certificate.html").write_text(
            render(
                "certificate.html",
                "auv_lse_shore.certify",
                title=f"Certificate of the {certificate.values['asked']['level_m']:g} m isobath",
                opening=lines(certificate),
                failures=certificate.failures,
                picture=picture,
                v=certificate.values,
                where=_where,
                number=number,
                metres=lambda width_m: "–" if width_m is None else f"{width_m:.0f}",
                is_length=is_length,
            )
        )
