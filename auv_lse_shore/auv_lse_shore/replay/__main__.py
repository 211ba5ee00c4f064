"""scripts/replay: plays a recording, computes its decisions again, or makes its report anew."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from auv_lse_common.process.domain import DomainError
from auv_lse_common.support.missing_packages import missing
from auv_lse_common.support.project_folder import project_folder
from auv_lse_common.support.user_error import error_text
from auv_lse_record.recording import recording_in
from auv_lse_shore.replay.options import check, parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Does what the command line asks for. Returns 0; 1 if something differs or failed; 2 if it cannot be done; 130."""
    options = parser().parse_args(arguments)
    root = project_folder()
    try:
        check(options)
        # Imported where they are used: playing needs ROS, the other two do not.
        if options.recompute:
            from auv_lse_shore.replay.again import recompute

            return recompute(options)
        if options.report:
            from auv_lse_shore.replay.report import report_again

            for line in report_again(options.run, options.mission, options.out):
                print(line)
            return 0
        recording_in(options.run)  # before ROS is loaded, and where there is none
        from auv_lse_shore.replay.play import play

        return play(options, root)
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
