"""Writes the generated blocks of docs, or checks them: `python -m auv_lse_shore.reference_pages`."""

import argparse
import sys
from collections.abc import Callable, Sequence

from auv_lse_common.support.project_folder import project_folder
from auv_lse_shore.reference_pages import commands, tables
from auv_lse_shore.reference_pages.blocks import outdated

#: What generates each block, by the name in its marker.
BLOCKS: dict[str, Callable[[], str]] = {
    "commands": commands.commands,
    "mission-states": tables.mission_states,
    "nodes": tables.nodes,
    "packet-fields": tables.packet_fields,
    "packet-reasons": tables.packet_reasons,
    "packet-sizes": tables.packet_sizes,
    "parameters": tables.parameters,
    "phases": tables.phases,
    "subpackages": tables.subpackages,
    "summary-keys": tables.summary_keys,
    "topics": tables.topics,
}


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser(
        prog="python -m auv_lse_shore.reference_pages",
        description="Derives the generated tables of docs from the code: topics, parameters, packet, commands, summary "
        "keys.",
        epilog="Exit codes: 0; 1 with --check if a page is out of date; 2 a wrong command line.",
    )
    mode = p.add_mutually_exclusive_group(required=True)
    mode.add_argument("--write", action="store_true", help="rewrite the pages that are out of date")
    mode.add_argument("--check", action="store_true", help="list the pages that are out of date")
    return p


def main(arguments: Sequence[str] | None = None) -> int:
    """Writes or checks the pages; returns the exit code."""
    options = parser().parse_args(arguments)
    docs = project_folder() / "docs"
    pages = outdated(docs, BLOCKS)
    for page, text in pages.items():
        print(f"{page.relative_to(docs.parent)}: {'written' if options.write else 'out of date'}")
        if options.write:
            page.write_text(text)
    return 1 if options.check and pages else 0


if __name__ == "__main__":
    sys.exit(main())
