"""`auv_lse files`: where the files are that the project ships."""

import argparse

from auv_lse_run.shipped_files import FOLDER, shipped_file, shipped_files

ERRORS = (FileNotFoundError,)


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse files."""
    p = argparse.ArgumentParser(
        prog="auv_lse files",
        description="Lists the files that the project ships: missions, campaigns, viewer layouts, the systemd unit. "
        "With a NAME, prints the path of that file, to copy it: cp $(auv_lse files default.yaml) my-mission.yaml",
        epilog="Exit codes: 0; 2 no file has that name, or wrong command line.",
    )
    p.add_argument("name", nargs="?", metavar="NAME", help="a file, such as missions/default.yaml or default.yaml")
    return p


def run(options: argparse.Namespace) -> None:
    """Prints the names of all files, or the path of one."""
    if options.name is not None:
        print(shipped_file(options.name))
        return
    print(f"in {FOLDER}:")
    for name in shipped_files():
        print(f"  {name}")
