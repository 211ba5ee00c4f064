"""The text of `auv_lse --help` and `auv_lse --version`."""

import os
import platform
from collections.abc import Iterable

from auv_lse_common.support.installed_copy import commit_of, copy_of
from auv_lse_common.support.verb import GROUPS, Verb

_HEAD = """\
usage: auv_lse VERB [ARGUMENTS]
       auv_lse VERB --help
       auv_lse --version

Maps a line of equal depth with a team of underwater vehicles. Each verb explains its arguments with --help.
"""
_TAIL = """\
Exit codes: those of the verb; 2 for a wrong command line or a missing package, 130 after Ctrl-C, 143 after SIGTERM,
129 after SIGHUP."""


def help_text(verbs: Iterable[Verb]) -> str:
    """The verbs with a line each, grouped by who uses them."""
    groups: dict[str, list[Verb]] = {group: [] for group in GROUPS}
    for verb in verbs:
        groups.setdefault(verb.group, []).append(verb)
    width = max((len(verb.name) for found in groups.values() for verb in found), default=0)
    parts = [_HEAD]
    for group, found in groups.items():
        if found:
            parts.append(f"{GROUPS.get(group, group)}:")
            parts += [f"  {verb.name:{width}}  {verb.text}" for verb in found]
            parts.append("")
    return "\n".join([*parts, _TAIL])


def version_text(packages: Iterable[str]) -> str:
    """Which copy of the software runs; packages of another copy are listed below."""
    copies = {package: copy for package in packages if (copy := copy_of(package)) is not None}
    main = copies["auv_lse_run"]
    commit = commit_of(main.folder) if main.kind == "checkout" else ""
    ros = os.environ.get("ROS_DISTRO")
    lines = [
        f"auv_lse {main.version}",
        f"{main.kind}: {main.folder}{f' at commit {commit}' if commit else ''}",
        f"Python {platform.python_version()}{f', ROS 2 {ros}' if ros else ''}",
    ]
    for package, copy in copies.items():
        if copy != main and not copy.folder.is_relative_to(main.folder):
            lines.append(f"from another copy: {package} {copy.version}, {copy.kind}: {copy.folder}")
    return "\n".join(lines)
