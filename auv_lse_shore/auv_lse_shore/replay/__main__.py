"""scripts/replay: plays a recording, recomputes its maps and decisions, or renews its report."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from auv_lse_common.support.missing_packages import missing
from auv_lse_common.support.user_error import error_text
from auv_lse_record.recording import recording_in
from auv_lse_run.process.domain import DomainError
from auv_lse_shore.replay.options import check, parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line. Returns 0; 1 if something differs or failed; 2 for a bad request; 130 after Ctrl-C."""
    options = parser().parse_args(arguments)
    try:
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
        from auv_lse_shore.replay.play import play

        return play(options)
    except ImportError as error:
        print(f"error: {missing(error, 'recordings that are played')}", file=sys.stderr)
        return 2
    except (DomainError, OSError, ValueError) as error:
        print(f"error: {error_text(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nstopped", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
