"""auv_lse campaign: the command line of campaigns."""

import argparse
import sys
from pathlib import Path

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.support.plurals import counted
from auv_lse_common.support.project_folder import project_folder
from auv_lse_shore.campaign import spec as campaign_spec
from auv_lse_shore.campaign.cluster import CampaignError, add_cluster_options, cluster
from auv_lse_shore.campaign.page import write_results
from auv_lse_shore.campaign.progress_display import progress_display
from auv_lse_shore.campaign.rerun import rerun
from auv_lse_shore.campaign.rows import Rows, columns_of, schema
from auv_lse_shore.campaign.runner import locked, run_campaign
from auv_lse_shore.campaign.spec import CampaignSpec
from auv_lse_sim.ground.ground import GroundError

ERRORS = (ParameterError, CampaignError, GroundError, OSError)
INTERRUPTED = "stopped; finished missions are kept. Run the same command again to continue"


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse campaign."""
    p = argparse.ArgumentParser(
        prog="auv_lse campaign",
        description="Simulates a grid or list of settings over seeds (fleet engine, no ROS). Writes a result row in "
        "Parquet for each\nmission as it finishes. Started again, it continues where it stopped.\n\n"
        "Exit codes: 0 success; 1 missions failed; 2 wrong command line or impossible request; 130 Ctrl-C.",
        epilog=campaign_spec.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("spec", nargs="?", type=Path, metavar="SPEC.yaml", help="the campaign (below)")
    p.add_argument("--out", type=Path, metavar="DIR", help="the campaign's folder (default: runs/campaigns/NAME)")
    add_cluster_options(p)
    p.add_argument("--retry-failed", action="store_true", help="repeat missions that failed earlier")
    p.add_argument(
        "--list",
        action="store_true",
        help="list the missions with the status of their rows, and exit; without SPEC.yaml those flown in --out",
    )
    p.add_argument("--rerun", metavar="ID", help="repeat the mission of one row of --out with full recording")
    p.add_argument("--to", type=Path, metavar="DIR", help="run folder of --rerun (default: DIR/reruns/ID)")
    return p


def run(options: argparse.Namespace) -> int:
    """Simulates a campaign; returns the exit code."""
    if options.rerun is not None:
        return _rerun(options)
    if options.to is not None:
        raise CampaignError("--to requires --rerun ID")
    if options.spec is None and options.list and options.out is not None:
        return _list_flown(options.out)
    if options.spec is None:
        raise CampaignError("SPEC.yaml is missing; name a campaign file, or give --out DIR with --list or --rerun ID")
    spec = CampaignSpec.load(options.spec)
    folder = options.out or project_folder() / "runs" / "campaigns" / spec.name
    if options.list:
        return _list(spec, folder)
    spec.jobs()  # an impossible setting must not replace the file as flown
    with locked(folder):  # before a cluster is started, which takes seconds
        (folder / "campaign.yaml").write_text(options.spec.read_text())
        print(f"campaign folder: {folder}; starting the workers", flush=True)
        with cluster(options.scheduler, options.workers) as client, progress_display() as show:
            state = run_campaign(spec, folder, client, retry_failed=options.retry_failed, progress=show)
        page = write_results(spec, folder, state)
    print(
        f"{counted(state.done, 'mission')} simulated, {state.before:,} already there, {state.failed:,} failed; {page}"
    )
    return 1 if state.failed else 0


def _list(spec: CampaignSpec, folder: Path) -> int:
    have, jobs = Rows(folder, columns_of(spec)).statuses(), spec.jobs()
    for job in jobs:
        print(_listed(job.id, have.get(job.id, "-"), job.seed, job.group))
    print(f"{sum(job.id in have for job in jobs)} of {counted(len(jobs), 'mission')} flown in {folder} (--out)")
    return 0


def _list_flown(folder: Path) -> int:
    """Lists the rows of a campaign without its file."""
    rows = sorted(Rows(folder, schema({})).read(), key=lambda row: (row["seed"], row["group"]))
    if not rows:
        raise CampaignError(f"{folder} holds no missions of a campaign; name the campaign file, or its folder")
    for row in rows:
        print(_listed(row["id"], row["status"], row["seed"], row["group"]))
    print(f"{counted(len(rows), 'mission')} flown in {folder}")
    return 0


def _listed(mission: str, status: str, seed: int, group: str) -> str:
    return f"{mission}  {status:6}  seed {seed:<5} {group}"


def _rerun(options: argparse.Namespace) -> int:
    """Repeats one mission."""
    if options.out is None:
        raise CampaignError("--rerun needs --out DIR, the campaign's folder")
    to, changed = rerun(options.out, options.rerun, options.to)
    print(f"run folder: {to}")
    if changed:
        print(f"differs from the row: {', '.join(changed)}", file=sys.stderr)
    return 0
