"""A package's face without its weight: the names it offers, each imported from its home when it is first used.

A node that needs one class of a package would otherwise load all that the package offers, and SciPy with it.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any


def face(package: str, homes: Mapping[str, tuple[str, ...]]) -> Callable[[str], Any]:
    """The `__getattr__` (PEP 562) of a package.

    Args:
        package: The package's name, its `__name__`.
        homes: Names offered, by the module that defines them: below the package, or with its full name.
    """
    module_of = {
        name: home if home.startswith("auv_lse_") else f"{package}.{home}"
        for home, names in homes.items()
        for name in names
    }

    def attribute(name: str) -> Any:
        if name not in module_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(importlib.import_module(module_of[name]), name)

    return attribute
