"""auv_lse replay: plays a recording, recomputes its maps and decisions, or renews its report."""

import argparse

from auv_lse_common.support.missing_packages import missing
from auv_lse_record.recording import recording_in
from auv_lse_run.process.domain import DomainError
from auv_lse_shore.replay.options import check, parser

__all__ = ["parser", "run"]

ERRORS = (DomainError, OSError, ValueError)
INTERRUPTED = "stopped"


def run(options: argparse.Namespace) -> int:
    """Returns 0; 1 if something differs or failed."""
    check(options)
    # Imported late: only playing needs ROS.
    if options.recompute:
        from auv_lse_shore.replay.recompute import recompute

        return recompute(options)
    if options.report:
        from auv_lse_shore.replay.report import report_again

        for line in report_again(options.run, options.mission, options.out):
            print(line)
        return 0
    recording_in(options.run)  # checked before ROS is loaded
    try:
        from auv_lse_shore.replay.play import play
    except ImportError as error:
        raise missing(error, "recordings that are played") from error
    return play(options)
