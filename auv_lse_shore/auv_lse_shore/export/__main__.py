"""scripts/export: the command line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from auv_lse_common.support.user_error import error_text
from auv_lse_shore.export.errors import ExportError
from auv_lse_shore.export.export import export


def parser() -> argparse.ArgumentParser:
    """The command line of scripts/export."""
    p = argparse.ArgumentParser(
        prog="scripts/export",
        description="Writes what a mission found for other programs: isobath.geojson (with its band, and each piece's "
        "class: found, likely or guessed); risk, depth and std (standard deviation of the depth) as GeoTIFF and as "
        "ESRI ASCII grid; soundings.csv; and isobath.qgs, a QGIS project that opens all of them, with a style (.qml) "
        "beside each file.",
        epilog="With area.origin_lat_deg and origin_lon_deg in the mission file, the files lie where they belong on "
        "Earth; without, they are in local metres. A second export into the same folder replaces the first. "
        "Exit codes: 0; 2 the run cannot be exported, or a wrong command line; 130 Ctrl-C.",
    )
    p.add_argument("run", type=Path, metavar="RUN", help="run folder, with mission.yaml and bag/")
    p.add_argument("--out", type=Path, metavar="DIR", help="where to write (default: RUN/export)")
    p.add_argument("--picture", action="store_true", help="also draw export.png, from the written files alone")
    return p


def main(arguments: Sequence[str] | None = None) -> int:
    """Exports a run. Returns 0, 2 if that cannot be done, 130 after Ctrl-C."""
    options = parser().parse_args(arguments)
    folder = options.out or options.run / "export"
    try:
        for line in export(options.run, folder, picture=options.picture):
            print(line, flush=True)
    except (ExportError, ValueError, OSError) as error:
        print(f"error: {error_text(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nstopped; what is in the folder may be incomplete: the same command writes it anew", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
