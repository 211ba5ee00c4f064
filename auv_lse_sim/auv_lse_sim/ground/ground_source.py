"""Loads the ground of a mission, once for all of its processes."""

import contextlib
import os
import pickle
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from auv_lse_common.mission_file.sections.area import AreaConfig, corners
from auv_lse_common.mission_file.sections.world import BathymetryConfig, LakeConfig
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_sim.ground.ground import Ground
from auv_lse_sim.ground.ground_files import load_ground
from auv_lse_sim.ground.lake import SyntheticLake

#: A large raster is read up to this distance (m) beyond the area, which vehicles do not reach.
AROUND_M = 500.0
#: Environment variable of a mission's processes: the file to which the first one that needs the ground saves it.
GROUND_VARIABLE = "AUV_LSE_GROUND"


@dataclass(frozen=True)
class _Source:
    """What a ground is built from; a changed file has another `file_version`: its size and time of change.

    `around` are corners (latitude, longitude deg) around the area, if the mission has one of its own on Earth.
    """

    config: LakeConfig | BathymetryConfig
    seed: int = 0
    origin: tuple[float, float] | None = None
    around: tuple[tuple[float, float], ...] = ()
    file_version: tuple[int, int] | None = None

    def build(self) -> Ground:
        if isinstance(self.config, LakeConfig):
            return SyntheticLake(self.config, self.seed)
        return load_ground(self.config.file, self.config, self.origin, self.around)


def ground_of(settings: Settings) -> Ground:
    """The file of `sim.bathymetry`, or the synthetic lake of `sim.lake`; built once in a process for one mission.

    Raises:
        GroundError: if the file cannot be used.
        ValueError: if the lake's parameters are inconsistent.
    """
    config = settings.sim.bathymetry
    if not config.file:
        return _ground(_Source(settings.sim.lake, seed=settings.mission.seed))
    lat, lon = settings.area.origin_lat_deg, settings.area.origin_lon_deg
    origin = (lat, lon) if lat is not None and lon is not None else None
    around = _around(settings.area, origin) if origin and settings.area.polygon_m != AreaConfig().polygon_m else ()
    version = None
    with contextlib.suppress(OSError):  # reported when the file is read
        about = Path(config.file).stat()
        version = (about.st_size, about.st_mtime_ns)
    return _ground(_Source(config, origin=origin, around=around, file_version=version))


def _around(area: AreaConfig, origin: tuple[float, float]) -> tuple[tuple[float, float], ...]:
    """Corners (latitude, longitude deg) of a rectangle `AROUND_M` around an area."""
    locations = corners("area.polygon_m", area.polygon_m)
    (south, west), (north, east) = locations.min(axis=0) - AROUND_M, locations.max(axis=0) + AROUND_M
    lat, lon = geodetic_from_local([south, south, north, north], [west, east, west, east], *origin)
    return tuple(zip(lat.tolist(), lon.tolist(), strict=True))


@contextlib.contextmanager
def shared_ground() -> Iterator[dict[str, str]]:
    """While it lasts, this process and those started with these environment variables build the ground once."""
    with contextlib.ExitStack() as stack:
        try:
            new = tempfile.TemporaryDirectory(prefix="auv_lse_ground_", ignore_cleanup_errors=True)
        except OSError:  # nowhere to save it: each process builds its own
            yield {}
            return
        variables = {GROUND_VARIABLE: str(Path(stack.enter_context(new)) / "ground.pickle")}
        os.environ |= variables
        stack.callback(os.environ.pop, GROUND_VARIABLE, None)
        yield variables


@dataclass(frozen=True)
class _Built:
    source: _Source
    ground: Ground

    def fits(self, source: _Source) -> bool:
        """Whether `source` builds the same ground; it may also state the origin that was found in the file."""
        return source in (self.source, replace(self.source, origin=self.ground.origin))


#: The ground that this process used last.
_last: _Built | None = None


def _ground(source: _Source) -> Ground:
    global _last
    if _last is None or not _last.fits(source):
        _last = _shared(source)
    return _last.ground


def _shared(source: _Source) -> _Built:
    """The ground that another process of the mission has built; else builds it, and saves it for the others."""
    name = os.environ.get(GROUND_VARIABLE)
    if not name:
        return _Built(source, source.build())
    file = Path(name)
    with contextlib.suppress(OSError, EOFError, pickle.UnpicklingError):
        found: _Built = pickle.loads(file.read_bytes())
        if found.fits(source):
            return found
    built = _Built(source, source.build())
    with contextlib.suppress(OSError):  # without space, each process builds its own
        part = file.with_suffix(f".{os.getpid()}")
        part.write_bytes(pickle.dumps(built, pickle.HIGHEST_PROTOCOL))
        part.replace(file)
    return built
