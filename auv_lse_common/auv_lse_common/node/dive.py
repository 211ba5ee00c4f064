"""The id of a dive or a simulation, with which nodes recognize the messages of their own mission.

An entry point creates the id and passes it to its nodes in their environment: "auv2-1123-184534-3f2a" for a vehicle,
"sim-1123-184534-3f2a" for a simulation. The project's messages carry it in their field `dive`. Messages of standard
types are recognized by their sender's participant in the ROS domain (`senders.py`).

A node ignores messages of another dive and reports them. Messages without an id come from operators and from users'
drivers. Nodes accept them on the topics on which these may publish, unless a node of their own dive publishes there,
too; a simulation accepts only commands. Nodes started by hand have the id "" and ignore every message that has one, so
hardware never obeys a simulation.
"""

import os
import re
import secrets
from collections.abc import Mapping
from datetime import datetime
from typing import Any

from auv_lse_common.support.plurals import counted
from auv_lse_common.topics.table import Topic

#: The environment variable that carries the id to a mission's nodes.
DIVE_VARIABLE = "AUV_LSE_DIVE"
#: The environment variable that makes a new dive wait for GO, whatever `vehicle.start` is.
WAIT_VARIABLE = "AUV_LSE_WAIT"
#: Kind of the id of a simulation.
SIMULATION = "sim"
_ID = re.compile(r"(sim|auv\d+)-\d{4}-\d{6}-[0-9a-f]{4}")


def new_dive(kind: str) -> str:
    """A new id.

    Args:
        kind: `SIMULATION`, or the vehicle's name, "auv2".
    """
    return f"{kind}-{datetime.now():%m%d-%H%M%S}-{secrets.token_hex(2)}"


def own_dive() -> str:
    """The id of this process's dive; "" if its entry point set none."""
    return os.environ.get(DIVE_VARIABLE, "")


def dive_of(frame_id: str) -> str:
    """The id of the dive in a header's frame, where version 0.2 put it: "sim-1123-184534-3f2a/map"; "" if none."""
    prefix, separator, _ = frame_id.partition("/")
    return prefix if separator and _ID.fullmatch(prefix) else ""


def is_simulation(dive: str) -> bool:
    """Whether an id is that of a simulation."""
    return dive.startswith(f"{SIMULATION}-")


def tagged(message: Any, dive: str) -> Any:
    """Enters the id into a message of the project; returns the message, which is unchanged if of a standard type."""
    if hasattr(message, "dive"):
        message.dive = dive
    return message


def vehicle_of(dive: str) -> str:
    """The vehicle of a dive, "auv2"; "" for a simulation, and without an id."""
    return "" if is_simulation(dive) else dive.partition("-")[0]


def is_foreign(topic: Topic, sender: str, own: str) -> bool:
    """Whether a reader of a topic must ignore a message.

    Args:
        sender: The message's id.
        own: The reader's id.
    """
    if sender or not own:
        return sender != own
    driver = any(writer in _DRIVERS for writer in topic.writer.split("|"))
    return bool(topic.writer) and (is_simulation(own) or not driver)


#: Nodes that a user's own driver may replace.
_DRIVERS = ("vehicle_link_node", "micromodem_node")
#: Time (s) for which another dive counts as present after its last message.
_PRESENT_S = 60.0
#: Number of other dives that a node names; further ones are counted together.
_MAX_NAMED = 8
_FURTHER = "one of several further dives"
#: Characters of an id that are reported; it is text from the network.
_MAX_NAME = 40


class ForeignMessages:
    """The messages of other dives that a node has ignored."""

    def __init__(self, own: str) -> None:
        """Args: own: the id of the node's dive."""
        self._own = own
        self._served: set[str] = set()  # topics on which the node's own dive publishes
        self._counts: dict[str, dict[str, int]] = {}
        self._heard_s: dict[str, float] = {}

    def ignores(self, topic: Topic, sender: str, now_s: float) -> bool:
        """Whether to ignore a message; counts ignored ones.

        Args:
            sender: The message's id.
            now_s: A monotonic clock.
        """
        if sender == self._own != "":
            self._served.add(topic.name)
        is_second = not sender and topic.writer != "" and topic.name in self._served
        if not is_second and not is_foreign(topic, sender, self._own):
            return False
        for name, heard_s in list(self._heard_s.items()):
            if now_s - heard_s > _PRESENT_S:
                del self._counts[name], self._heard_s[name]
        sender = sender[:_MAX_NAME]
        if sender not in self._counts and len(self._counts) >= _MAX_NAMED:
            sender = _FURTHER
        counts = self._counts.setdefault(sender, {})
        counts[topic.name] = counts.get(topic.name, 0) + 1
        self._heard_s[sender] = now_s
        return True

    def problems(self, now_s: float) -> Mapping[str, str]:
        """A sentence for each other dive with messages in the last minute, by its id.

        Args:
            now_s: A monotonic clock.
        """
        return {
            sender: f"{sender or 'a sender without an id'} publishes in this ROS domain, too: "
            f"{counted(sum(counts.values()), 'message')} ignored ({', '.join(counts)}). End it, or use another domain"
            for sender, counts in self._counts.items()
            if now_s - self._heard_s[sender] <= _PRESENT_S
        }
