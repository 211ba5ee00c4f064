"""soundings_b12_auvN.geojson: soundings for crowdsourced bathymetry (IHO B-12, GeoJSON CSB 3.1); needs --provider."""

import datetime
import json
import re
import uuid
from collections.abc import Iterator
from typing import Any, TextIO

from auv_lse_common.support.plurals import counted
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_record.run_data import VehicleRun
from auv_lse_record.software import version
from auv_lse_shore.export.content import Export
from auv_lse_shore.export.survey import FIRST_UTC_S
from auv_lse_shore.export.uncertainty import SIGMAS_95, sounding_uncertainty

#: Name of the convention, as its schema (csbschema, 3.1.0) demands it.
CONVENTION = "GeoJSON CSB 3.1"
#: Decimals of a coordinate (deg): 1 cm.
_DECIMALS = 7


def write(export: Export) -> str:
    """Writes a file of one vehicle's soundings as `soundings_b12_auvN.geojson`, since a file is of one platform.

    Depths are below the water surface or below the datum, as the metadata state. Uncertainties are east, north and
    vertical at one standard deviation.
    """
    export.discard("soundings_b12_auv*.geojson")
    vehicles = [v for v in export.team.run.vehicles if len(v.soundings)]
    if missing := _missing(export, vehicles):
        return f"soundings_b12_auvN.geojson: skipped, because {missing}"
    numbers = sorted({v.vehicle for v in vehicles})
    for number in numbers:
        dives = [v for v in vehicles if v.vehicle == number]
        with (export.folder / f"soundings_b12_auv{number}.geojson").open("w") as file:
            _write_collection(file, _collection(export, dives), (f for dive in dives for f in _features(export, dive)))
    return f"soundings_b12_auvN.geojson ({counted(len(numbers), 'vehicle')}, {CONVENTION})"


def _write_collection(file: TextIO, collection: dict[str, Any], features: Iterator[dict[str, Any]]) -> None:
    """Writes a collection with its features one by one: those of a long survey take more than a gigabyte together."""
    file.write(json.dumps({**collection, "features": []}, allow_nan=False).removesuffix("]}"))
    for number, feature in enumerate(features):
        file.write(f"{', ' if number else ''}{json.dumps(feature, allow_nan=False)}")
    file.write("]}")


def _missing(export: Export, vehicles: list[VehicleRun]) -> str:
    """What the files would lack; "" if nothing."""
    if export.reference.origin is None:
        return "the mission has no origin; give --origin LAT LON"
    if export.survey.provider is None:
        return "--provider NAME EMAIL is not given"
    if any(v.soundings.stamp_s.min() < FIRST_UTC_S for v in vehicles):
        return "times are not UTC: a simulation has none, and an imported log without a date needs import --date"
    return ""


def _collection(export: Export, dives: list[VehicleRun]) -> dict[str, Any]:
    """A collection without its features."""
    survey = export.survey
    assert survey.provider is not None
    organization, email = survey.provider
    node = re.sub(r"[^A-Za-z0-9]", "", organization)
    number = dives[0].vehicle
    unique = uuid.uuid5(uuid.NAMESPACE_URL, f"{email}/auv{number}")
    vessel = f"{node if node[:1].isalpha() else f'A{node}'}-{unique}"
    # an imported log has no plans, and may be a boat's
    kind = {"type": "autonomous underwater vehicle"} if any(dive.decisions for dive in dives) else {}
    last = _utc(max(float(dive.soundings.stamp_s.max()) for dive in dives))
    return {
        "type": "FeatureCollection",
        "crs": {"type": "name", "properties": {"name": "EPSG:4326"}},
        "properties": {
            "trustedNode": {
                "providerOrganizationName": organization,
                "providerEmail": email,
                "uniqueVesselID": vessel,
                "convention": CONVENTION,
                "dataLicense": "CC0 1.0",
                "providerLogger": "auv_lse",
                "providerLoggerVersion": version(),
                "navigationCRS": "EPSG:4326",
                "verticalReferenceOfDepth": "Unknown" if survey.datum else "Waterline",
                "vesselPositionReferencePoint": "Transducer",
            },
            "platform": {
                **kind,
                "name": f"auv{number}",
                "soundSpeedDocumented": survey.sound_speed is not None,
                "positionOffsetsDocumented": False,
                "dataProcessed": True,
                "uniqueID": vessel,
            },
            "processing": _processing(export, last),
        },
    }


def _processing(export: Export, timestamp: str) -> list[dict[str, Any]]:
    """What was done to the soundings."""
    survey, about = export.survey, export.survey.describe()
    steps: list[dict[str, Any]] = [
        {"type": "Algorithm", "timestamp": timestamp, "name": "positions estimated by auv_lse", "parameters": about},
        {
            "type": "Uncertainty",
            "timestamp": timestamp,
            "name": "auv_lse",
            "version": version(),
            "parameters": {"standard_deviations": about["standard_deviations"]},
            "comment": "one standard deviation: east and north of the estimated position, and depth",
            "reference": "docs/guide/after-the-dive.md",
        },
    ]
    if survey.datum:
        observed = survey.water_level is not None
        steps.append(
            {
                "type": "VerticalReduction",
                "timestamp": timestamp,
                "reference": about["water_level"],
                "datum": survey.vertical_datum,
                "method": "Observed Waterlevel" if observed else "the water surface was taken as the datum",
            }
        )
    if survey.sound_speed is not None:
        method = f"travel times through the profile; the sounder assumed {about['sounder_sound_speed']}"
        source = about["sound_speed"]
        steps.append({"type": "SoundSpeed", "timestamp": timestamp, "source": source, "method": method})
    return steps


def _features(export: Export, vehicle: VehicleRun) -> Iterator[dict[str, Any]]:
    assert export.reference.origin is not None
    soundings = vehicle.soundings
    latitude, longitude = geodetic_from_local(soundings.north_m, soundings.east_m, *export.reference.origin)
    stds = vehicle.position_std_at(soundings.stamp_s)
    noise = export.team.settings.gp.noise_std_m
    tvu = sounding_uncertainty(export.team.run, vehicle, export.survey, noise).tvu_m
    for i, sounding in enumerate(soundings):
        properties: dict[str, Any] = {"depth": round(sounding.depth_m, 3), "time": _utc(sounding.stamp_s)}
        uncertainty = [float(value) for value in (stds[i, 1], stds[i, 0], tvu[i] / SIGMAS_95)]
        if all(value == value for value in uncertainty):  # not NaN: the position's uncertainty is known
            properties["uncertainty"] = [round(value, 3) for value in uncertainty]
        location = [round(float(longitude[i]), _DECIMALS), round(float(latitude[i]), _DECIMALS)]
        geometry = {"type": "Point", "coordinates": location}
        yield {"type": "Feature", "geometry": geometry, "properties": properties}


def _utc(stamp_s: float) -> str:
    """RFC 3339 with milliseconds."""
    time = datetime.datetime.fromtimestamp(round(stamp_s, 3), datetime.UTC)
    return f"{time:%Y-%m-%dT%H:%M:%S}.{time.microsecond // 1000:03d}Z"
