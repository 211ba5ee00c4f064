"""Small whole files of the formats that users bring: areas, logs, soundings, rasters."""

import json
import zipfile
from collections.abc import Iterator
from functools import reduce
from operator import xor
from pathlib import Path

import numpy as np
from scipy.io import netcdf_file

_MISSIONS = Path(__file__).parents[3] / "config" / "missions"
Depths = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def small_files(folder: Path) -> Iterator[Path]:
    """Writes a small file of each format that can be written here; yields their paths."""
    yield _MISSIONS / "lake.geojson"
    rng = np.random.default_rng(1)
    places = np.column_stack([46.5 + 0.01 * rng.random(60), 6.6 + 0.01 * rng.random(60), 5.0 + 20.0 * rng.random(60)])
    rows = [f"2026-06-14T10:{i // 60:02d}:{i % 60:02d}Z,{a:.6f},{b:.6f},{c:.2f}" for i, (a, b, c) in enumerate(places)]
    ring = " ".join(f"{b:.6f},{a:.6f},0" for a, b in [(46.5, 6.6), (46.5, 6.62), (46.52, 6.62), (46.5, 6.6)])
    points = "".join(f'<trkpt lat="{a:.6f}" lon="{b:.6f}"><extensions><depth>{c:.1f}</depth></extensions></trkpt>'
                     for a, b, c in places)  # fmt: skip
    features = [{"type": "Feature", "geometry": {"type": "Point", "coordinates": [b, a]},
                 "properties": {"depth": c, "time": f"2026-06-14T10:00:{i:02d}Z"}}
                for i, (a, b, c) in enumerate(places.tolist())]  # fmt: skip
    grid = "\n".join(" ".join(f"{v:.1f}" for v in row) for row in 5.0 + 20.0 * rng.random((12, 12)))
    sentences = [text for i, (a, b, c) in enumerate(places) for text in _sentences(i, a, b, c)]
    texts = {
        "log.nmea": "".join(f"${text}*{reduce(xor, text.encode()):02X}\r\n" for text in sentences),
        "table.csv": "time_utc,lat,lon,depth_m\n" + "\n".join(rows),
        "area.kml": '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><name>lake</name>'
        f"<Polygon><outerBoundaryIs><LinearRing><coordinates>{ring}</coordinates></LinearRing></outerBoundaryIs>"
        "</Polygon></Placemark></kml>",
        "track.gpx": f'<gpx version="1.1"><trk><trkseg>{points}</trkseg></trk></gpx>',
        "csb.geojson": json.dumps({"type": "FeatureCollection", "features": features}),
        "area.waypoints": "QGC WPL 110\n" + "\n".join(f"{i}\t0\t3\t5001\t4\t0\t0\t0\t{a}\t{b}\t0\t1"
                                                     for i, (a, b, _) in enumerate(places[:4].tolist())),
        "grid.asc": f"ncols 12\nnrows 12\nxllcorner 0\nyllcorner 0\ncellsize 10\n{grid}\n",
    }  # fmt: skip
    for name, text in texts.items():
        (folder / name).write_text(text)
        yield folder / name
    with zipfile.ZipFile(folder / "area.kmz", "w") as packed:
        packed.writestr("doc.kml", texts["area.kml"])
    yield folder / "area.kmz"
    yield from _layers(folder, places[:4, 1::-1])
    yield from _rasters(folder, 5.0 + 20.0 * rng.random((12, 12)))


def _sentences(second: int, lat_deg: float, lon_deg: float, depth_m: float) -> tuple[str, str]:
    lat, lon = (f"{int(deg):0{digits}d}{deg % 1.0 * 60.0:07.4f}" for deg, digits in ((lat_deg, 2), (lon_deg, 3)))
    return (
        f"GPGGA,10{second // 60:02d}{second % 60:02d},{lat},N,{lon},E,2,9,0.9,372,M,48,M,,",
        f"SDDBT,,f,{depth_m:.1f},M,,F",
    )


def _layers(folder: Path, corners: Depths) -> Iterator[Path]:
    import pyogrio
    import shapely

    rings = shapely.to_wkb([shapely.Polygon(corners).convex_hull])
    for name, driver in (("area.gpkg", "GPKG"), ("area.shp", "ESRI Shapefile")):
        pyogrio.raw.write(folder / name, rings, [np.array(["lake"], dtype=object)], ["name"], driver=driver,
                          geometry_type="Polygon", crs="EPSG:4326")  # fmt: skip
        yield folder / name
    with zipfile.ZipFile(folder / "area.zip", "w") as packed:
        for part in folder.glob("area.*"):
            if part.suffix in (".shp", ".shx", ".dbf", ".prj"):
                packed.write(part, part.name)
    yield folder / "area.zip"


def _rasters(folder: Path, depth_m: Depths) -> Iterator[Path]:
    import rasterio

    size = {"height": depth_m.shape[0], "width": depth_m.shape[1], "crs": "EPSG:32632", "dtype": "float32"}
    at = rasterio.transform.from_origin(500_000.0, 5_200_000.0, 10.0, 10.0)
    for name, driver, bands in (("grid.tif", "GTiff", [-depth_m]), ("grid.bag", "BAG", [-depth_m, 0.0 * depth_m])):
        with rasterio.open(folder / name, "w", driver=driver, count=len(bands), transform=at, nodata=1e6, **size) as f:
            f.write(np.stack(bands).astype("float32"))
        yield folder / name
    with netcdf_file(folder / "grid.nc", "w") as file:
        for name, values in (("lat", 47.0 + 0.001 * np.arange(12.0)), ("lon", 8.0 + 0.001 * np.arange(12.0))):
            file.createDimension(name, 12)
            file.createVariable(name, "d", (name,))[:] = values
        file.createVariable("elevation", "f", ("lat", "lon"))[:] = -depth_m
    yield folder / "grid.nc"
    np.savez(folder / "grid.npz", north_m=np.arange(12.0), east_m=np.arange(12.0), depth_m=depth_m)
    yield folder / "grid.npz"
