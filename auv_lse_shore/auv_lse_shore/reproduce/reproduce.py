"""auv_lse reproduce: the paper's results in simulation, over many seeds, with its claims checked one by one.

The study's campaigns continue where they were stopped; then one mission of each kind is recorded for the figures.
"""

import argparse
import time
from functools import partial
from pathlib import Path

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.support.option_types import whole_from
from auv_lse_common.support.plurals import counted
from auv_lse_common.support.project_folder import project_folder
from auv_lse_shore.campaign.cluster import CampaignError, add_cluster_options, cluster
from auv_lse_shore.campaign.page import write_results
from auv_lse_shore.campaign.progress_display import duration
from auv_lse_shore.campaign.runner import CampaignState, make_folder
from auv_lse_shore.reproduce.examples import examples
from auv_lse_shore.reproduce.reproduce_page import write_page
from auv_lse_shore.reproduce.study import CAMPAIGNS, METHODS, SENSITIVE, SWEEP_NAMES, full_study, quick_study
from auv_lse_shore.reproduce.study_runner import estimate_s, run_study

ERRORS = (ParameterError, CampaignError, OSError)
INTERRUPTED = "stopped; finished missions are kept. Run the same command again to continue"


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse reproduce."""
    p = argparse.ArgumentParser(
        prog="auv_lse reproduce",
        description="Reproduces the paper's results in simulation: figures, a table over seeds with confidence "
        "intervals, and its claims, one by one, with the evidence for and against them. Started again after an "
        "interruption, it continues.",
        epilog="Exit codes: 0 success; 1 missions failed; 2 wrong command line or impossible request; 130 Ctrl-C.",
    )
    p.add_argument("--quick", action="store_true", help="a small version, in about 3 minutes")
    p.add_argument("--out", type=Path, metavar="DIR", help="folder of results (default: runs/reproduce[-quick])")
    p.add_argument(
        "--seeds",
        type=whole_from(1),
        default=50,
        metavar="N",
        help="seeds of the field trials (default: 50; with a chart 20)",
    )
    p.add_argument(
        "--sweep-seeds", type=whole_from(1), default=10, metavar="N", help="seeds of the sensitivities (default: 10)"
    )
    p.add_argument(
        "--sweep-methods",
        nargs="+",
        choices=METHODS,
        default=SENSITIVE,
        metavar="NAME",
        help=f"methods of the sensitivities (default: {' '.join(SENSITIVE)})",
    )
    p.add_argument(
        "--sweeps",
        nargs="+",
        choices=SWEEP_NAMES,
        default=SWEEP_NAMES,
        metavar="NAME",
        help=f"sensitivities (default: {' '.join(SWEEP_NAMES)})",
    )
    p.add_argument(
        "--only",
        nargs="+",
        choices=CAMPAIGNS,
        default=CAMPAIGNS,
        help="campaigns to simulate (default: all)",
    )
    add_cluster_options(p)
    p.add_argument("--estimate", action="store_true", help="only estimate the time; write nothing")
    p.add_argument("--page", action="store_true", help="write the page from the missions simulated so far, and exit")
    return p


#: Wall-clock time (s) of --quick, and the part of it for its missions; start, examples and page take the rest.
QUICK_TOTAL_S, QUICK_S = 180.0, 90.0


def _check_quick(options: argparse.Namespace) -> None:
    """Raises CampaignError if an option is given that --quick does not use."""
    default = parser().parse_args([])
    for name in ("seeds", "sweep_seeds", "sweep_methods", "sweeps", "only"):
        if getattr(options, name) != getattr(default, name):
            raise CampaignError(f"--{name.replace('_', '-')} is for the full version; leave it or --quick out")


def run(options: argparse.Namespace) -> int:
    """Reproduces the paper; returns the exit code."""
    began = time.monotonic()
    if options.quick:
        _check_quick(options)
    study = (
        quick_study(QUICK_S)
        if options.quick
        else full_study(options.seeds, options.sweep_seeds, options.only, options.sweep_methods, options.sweeps)
    )
    folder = options.out or project_folder() / "runs" / ("reproduce-quick" if options.quick else "reproduce")
    if options.page and not any((folder / name / "rows").is_dir() for name in study.campaigns):
        raise CampaignError(f"{folder} has no simulated missions. Run the same command without --page")
    if not options.estimate:
        make_folder(folder)
    states: dict[str, CampaignState] = {}
    if options.page:
        flown = examples(study, folder, None)
    else:
        with cluster(options.scheduler, options.workers) as client:
            threads = max(sum(client.nthreads().values()), 1)
            if options.quick:
                left = duration(QUICK_TOTAL_S)
            else:
                left = duration(estimate_s(study, folder, client, threads, partial(print, flush=True)))
            print(f"about {left} on {threads} cores. Ctrl-C stops; the same command continues", flush=True)
            if options.estimate:
                return 0
            states = run_study(
                study,
                folder,
                client,
                lambda name, state: write_results(study.campaigns[name], folder / name, state),
            )
            flown = examples(study, folder, client if "trials" in study.only else None)
    page = write_page(study, folder, flown)
    failed = sum(state.failed for state in states.values())
    print(f"{page} ({counted(failed, 'mission')} failed; {duration(time.monotonic() - began)})")
    return 1 if failed else 0
