"""Finds the verbs of all installed packages."""

from importlib.metadata import EntryPoint, entry_points

from auv_lse_common.support.verb import VERB_GROUP, Verb

#: The project's packages by their verbs; names the package of a verb that is not installed.
PACKAGE_OF = {
    **dict.fromkeys(("adjust", "bench", "campaign", "certify", "check", "export", "faults", "fit"), "auv_lse_shore"),
    **dict.fromkeys(("fleet", "import", "live", "mission", "replay", "reproduce", "sim"), "auv_lse_shore"),
    **dict.fromkeys(("abort", "go", "hold", "nodes", "params", "reset", "security-policy", "state"), "auv_lse_run"),
    **dict.fromkeys(("surface", "topics", "vehicle", "vehicle-side"), "auv_lse_run"),
    **dict.fromkeys(("key", "modem-check"), "auv_lse_comms"),
    "autopilot-check": "auv_lse_mavlink",
    "recover": "auv_lse_record",
    **dict.fromkeys(("completion", "files", "wheels"), "auv_lse_run"),
}


def find_verbs() -> tuple[dict[str, Verb], list[str]]:
    """The verbs of all installed packages by name, and a sentence for each list that cannot be loaded.

    Of two verbs with one name, that of the project's own packages counts.
    """
    verbs: dict[str, Verb] = {}
    problems = []
    for entry in sorted(entry_points(group=VERB_GROUP), key=_order):
        try:
            table = entry.load()
        except Exception as error:  # a broken package must not take the other verbs away
            problems.append(f"the verbs of {entry.name} cannot be loaded ({entry.value}): {error}")
            continue
        for verb in table:
            verbs.setdefault(verb.name, verb)
    return verbs, problems


def _order(entry: EntryPoint) -> tuple[bool, str]:
    return entry.value.partition(".")[0] not in PACKAGE_OF.values(), entry.name
