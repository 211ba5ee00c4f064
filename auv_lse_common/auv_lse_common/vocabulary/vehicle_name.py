"""Names of vehicles as people type them on a command line."""

import re
from collections.abc import Iterable


def vehicle_name(typed: str) -> str:
    """ "auv2" for "2", "/auv2" and "AUV2"; other texts unchanged."""
    number = re.fullmatch(r"/?(?:auv)?(\d+)", typed, re.IGNORECASE)
    return typed if number is None else f"auv{number[1]}"


def vehicle_names(typed: Iterable[str]) -> list[str] | None:
    """Each vehicle once, as `vehicle_name`, in order; None for all of them, if one of the texts is "all"."""
    names = list(dict.fromkeys(map(vehicle_name, typed)))
    return None if any(name.lower() == "all" for name in names) else names
