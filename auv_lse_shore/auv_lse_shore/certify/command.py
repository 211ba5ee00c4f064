"""auv_lse certify: the command line."""

import argparse
import sys
from pathlib import Path

from auv_lse_common.support.atomic_files import check_folder
from auv_lse_shore.certify.certificate import EXIT_CODES, certify, lines, write
from auv_lse_shore.report.progress import show_step

ERRORS = (ValueError, OSError)
INTERRUPTED = "stopped; no certificate is written"


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse certify."""
    p = argparse.ArgumentParser(
        prog="auv_lse certify",
        description="Recomputes a mission's final map from its recordings alone, by an independent dense computation, "
        "and writes certificate.html and certificate.json: what was asked, what is promised piece by piece, what is "
        "not, and the SHA-256 of every recording. It fails, and names the location, where the recordings do not "
        "support a map that a vehicle published.",
        epilog="Give all recordings of one mission in one call. A second certificate replaces the first. Exit codes: "
        "0 the recordings support the published maps; 1 they do not; 2 they cannot be read or are of different "
        "missions, or wrong command line; 3 a vehicle's recording has no published map, as after auv_lse import; "
        "130 Ctrl-C.",
    )
    p.add_argument("runs", type=Path, nargs="+", metavar="RUN", help="run folder, or a recording")
    p.add_argument("--mission", type=Path, metavar="FILE", help="mission file, for recordings without one")
    p.add_argument("--out", type=Path, metavar="DIR", help="output folder (default: certificate in the first RUN)")
    return p


def run(options: argparse.Namespace) -> int:
    """Certifies a mission; returns the exit code."""
    first: Path = options.runs[0]
    folder = options.out or (first if first.is_dir() else first.parent) / "certificate"
    check_folder(folder)
    certificate = certify(options.runs, options.mission, show_step)
    write(certificate, folder)
    for line in [*certificate.values["asked"]["notes"], *lines(certificate), *certificate.values["cannot_certify"]]:
        print(line)
    for line in certificate.failures:
        print(f"not supported: {line}", file=sys.stderr)
    print(f"written: {folder / 'certificate.html'}")
    return EXIT_CODES[certificate.verdict]
