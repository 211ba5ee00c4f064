"""A package's declaration of a verb of the command `auv_lse`.

A package lists its verbs in a module `verbs`, which imports nothing else, and names that list in the entry-point group
`auv_lse.verbs` of its setup.py. `auv_lse --help` shows the lists; a verb's own module is imported when it is called.
"""

from typing import NamedTuple

#: Entry-point group in which a package names its verbs.
VERB_GROUP = "auv_lse.verbs"
#: Headings of `auv_lse --help`, in this order, by the groups of the verbs. Other groups are their own heading.
GROUPS = {
    "mission": "Missions, simulated and planned",
    "vehicle": "On a vehicle, and beside it",
    "inspect": "Running nodes",
    "after": "After the dive",
    "research": "Research and development",
    "install": "This installation",
}
#: Packages without which no node runs; pip installs neither.
NODES = ("rclpy", "auv_lse_msgs")


class Verb(NamedTuple):
    """A verb of the command `auv_lse`.

    Attributes:
        name: What users type: "live".
        group: Key of `GROUPS`, or a heading.
        text: The line in `auv_lse --help`, without a full stop.
        module: Name of the module with `parser()`, which returns the `argparse.ArgumentParser`, and `run(options)`,
            which returns the exit code. It may have `ERRORS`, a tuple of the exceptions that mean a wrong request (one
            line, exit code 2), and `INTERRUPTED`, the line printed after Ctrl-C.
        words: Words put before the user's: with ("go",), `auv_lse go auv2` parses `go auv2`.
        needs: Packages that must be installed beside the verb's own.
        in_checkout: Whether the module is one of a checkout's, outside of the installed packages.
    """

    name: str
    group: str
    text: str
    module: str
    words: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    in_checkout: bool = False
