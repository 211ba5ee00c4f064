"""scripts/faults: breaks things on purpose and prints a table of what happened (docs/design/safety.md)."""

from __future__ import annotations

import argparse
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path


def _kills(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> tuple[list[str], bool]:
    from benchmarks.faults import kills

    return kills.run(folder, options.kills, options.seed, say)


def _soak(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> tuple[list[str], bool]:
    from benchmarks.faults import soak

    return soak.run(options.minutes, options.vehicles, options.seed, say)


def _nodes(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> tuple[list[str], bool]:
    from benchmarks.faults import nodes

    return nodes.run(folder, options.minutes, options.vehicles, options.real_time_factor, options.seed, say)


def _water(options: argparse.Namespace, folder: Path, say: Callable[[str], None]) -> tuple[list[str], bool]:
    from benchmarks.faults import water

    return water.run(folder, options.seeds, options.seed, options.steps, say, options.out is not None)


def parser() -> argparse.ArgumentParser:
    """The command line of scripts/faults."""
    p = argparse.ArgumentParser(
        prog="scripts/faults",
        description="Breaks things on purpose, and prints a table of what happened.",
        epilog="Exit codes: 0 all as it should be; 1 something was lost, or broke; 130 Ctrl-C.",
    )
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--seed", type=int, default=1, help="seed of everything random (default: %(default)s)")
    common.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="new folder for what it leaves (default: a temporary one, kept if something broke)",
    )
    kinds = p.add_subparsers(dest="kind", required=True, metavar="KIND")
    one = kinds.add_parser("kills", parents=[common], help="kills random nodes of two vehicles in one paced mission")
    one.add_argument("--kills", type=int, default=50, metavar="N", help="how many (default: %(default)s; 9 s each)")
    one.set_defaults(run=_kills)
    one = kinds.add_parser("soak", parents=[common], help="a long mission of a large team, with mates that babble")
    one.add_argument("--minutes", type=float, default=30.0, metavar="N", help="mission time (default: %(default)s)")
    one.add_argument("--vehicles", type=int, default=20, metavar="N", help="vehicles (default: %(default)s)")
    one.set_defaults(run=_soak)
    one = kinds.add_parser("nodes", parents=[common], help="a paced mission of real nodes under load: memory of each")
    one.add_argument("--minutes", type=float, default=30.0, metavar="N", help="mission time (default: %(default)s)")
    one.add_argument("--vehicles", type=int, default=2, metavar="N", help="vehicles (default: %(default)s)")
    one.add_argument("--real-time-factor", type=float, default=2.5, metavar="X", help="speed (default: %(default)s)")
    one.set_defaults(run=_nodes)
    one = kinds.add_parser(
        "water", parents=[common], help="packets lost, doubled, late, damaged; a clock off; with --out a picture"
    )
    one.add_argument("--seeds", type=int, default=4, metavar="N", help="missions of each kind (default: %(default)s)")
    one.add_argument("--steps", type=int, default=60, metavar="N", help="steps of each (default: %(default)s)")
    one.set_defaults(run=_water)
    return p


def main(arguments: list[str] | None = None) -> int:
    """Runs one kind of fault. Returns 0, 1 or 130, as the help says."""
    options = parser().parse_args(arguments)
    if options.out is not None and options.out.exists():
        print(f"error: --out {options.out}: is there already; expected a new folder", file=sys.stderr)
        return 1
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    began_s = time.monotonic()

    def say(text: str) -> None:
        print(f"  {time.monotonic() - began_s:6.0f} s  {text}", file=sys.stderr, flush=True)

    try:
        with _folder(options.out) as folder:
            lines, good = options.run(options, folder, say)
            print("\n".join(lines))
            if not good:
                raise _Broken("not all as it should be")
    except KeyboardInterrupt:
        return 130
    except (OSError, RuntimeError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


class _Broken(RuntimeError):
    """Something was lost, or broke."""


@contextmanager
def _folder(out: Path | None) -> Iterator[Path]:
    """The folder for what is left: `out`, or a temporary one, which stays if something broke, and is then named."""
    if out is not None:
        yield out.resolve()
        return
    temporary = Path(tempfile.mkdtemp(prefix="auv_lse_faults_"))
    keep = False
    try:
        yield temporary / "faults"
    except (OSError, RuntimeError, ValueError):
        keep = (temporary / "faults").exists()
        if keep:
            print(f"logs, journals and recordings are kept in {temporary / 'faults'}", file=sys.stderr)
        raise
    finally:
        if not keep:
            shutil.rmtree(temporary, ignore_errors=True)


if __name__ == "__main__":
    sys.exit(main())
