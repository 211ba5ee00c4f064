"""From files to logs on the local plane: reads, selects, dates and places them, and counts what is left out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from auv_lse_common.support.plurals import counted
from auv_lse_shore.survey_import.choice import Choice, chosen_logs
from auv_lse_shore.survey_import.clocks import ClockFacts, to_utc
from auv_lse_shore.survey_import.log_content import LogContent
from auv_lse_shore.survey_import.log_file import ReadOptions
from auv_lse_shore.survey_import.reading import files_of, read_all
from auv_lse_shore.survey_import.survey_log import LogError
from auv_lse_shore.survey_import.team import without_repetitions
from auv_lse_shore.survey_import.track import PlacedLog, Placement, local_origin, placed_log
from auv_lse_shore.survey_import.words import log_lines


@dataclass(frozen=True, slots=True, kw_only=True)
class UserFacts:
    """What the user knows about the logs, the boat and its clock.

    Attributes:
        origin: Latitude and longitude (deg) of north = east = 0; None: the first good position.
        lag_std_s: Standard deviation (s) of the sounder's delay; None: by format.
    """

    read: ReadOptions = field(default_factory=ReadOptions)
    choice: Choice = field(default_factory=Choice)
    clock: ClockFacts = field(default_factory=ClockFacts)
    placement: Placement = field(default_factory=Placement)
    origin: tuple[float, float] | None = None
    lag_std_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Gathered:
    """The logs of a survey.

    Attributes:
        placed: The logs, without soundings that another log has, too.
        origin: Latitude and longitude (deg) of north = east = 0; None for logs in metres.
        depth_std_m: Largest standard deviation (m) that a log states for a depth.
        lines: What was found in each file, and what was left out and why.
    """

    placed: list[PlacedLog]
    origin: tuple[float, float] | None
    depth_std_m: float
    lines: list[str]


def gather(
    names: Sequence[Path],
    facts: UserFacts,
    progress: Callable[[Path, float], None] = lambda path, share: None,
    step: Callable[[str], None] = lambda text: None,
) -> Gathered:
    """Reads files, folders and patterns, and places their logs.

    Args:
        names: Names of the files and folders, and patterns.
        progress: Called with the share of a file that has been read.
        step: Called with the name of each step after reading.

    Raises:
        LogError, FlightLogError: if a log cannot be used.
        MissingPackageError: if a package that a format needs is missing.
        OSError: if a file cannot be read.
    """
    contents: list[LogContent] = []
    lines: list[str] = []
    paths, all_named = files_of(names)
    for found in read_all(paths, all_named, facts.read, progress):
        if isinstance(found, str):
            lines.append(found)
        else:
            contents += found
    if not contents:
        first = "".join([*(["The first: "] if len(lines) > 1 else []), *lines[:1]])
        raise LogError(f"None of {counted(len(paths), 'file')} is a log that can be read. {first}")
    questions = to_utc(contents, facts.clock)
    logs, left_out = chosen_logs(contents, facts.choice, all_named)
    lines += left_out
    origin = local_origin(logs)
    if facts.origin is not None:
        if origin is None:
            raise LogError("--origin does not apply to logs in metres. Set it in the mission file.")
        origin = facts.origin
    placed = []
    for log in logs:
        log.lag_std_s = log.lag_std_s if facts.lag_std_s is None else facts.lag_std_s
        step(f"placing {log.name}")
        try:
            placed.append((log, placed_log(log, origin, facts.placement)))
        except LogError as error:
            if all_named or (log is logs[-1] and not placed):
                raise
            lines.append(f"left out: {error}")
    kept = without_repetitions([found for _, found in placed])
    lines += [line for log, found in placed for line in log_lines(log, found)]
    lines += [f"question: {question}" for question in questions]
    return Gathered(placed=kept, origin=origin, depth_std_m=max(log.depth_std_m for log in logs), lines=lines)
