"""Lazy package exports: each public name of a package is imported on first use.

Otherwise a node that needs one class would import the whole package and SciPy.
"""

import importlib
from collections.abc import Callable, Mapping
from typing import Any


def lazy_exports(package: str, homes: Mapping[str, tuple[str, ...]]) -> Callable[[str], Any]:
    """Returns the `__getattr__` (PEP 562) of a package.

    Args:
        package: The package's `__name__`.
        homes: Exported names by defining module: relative to the package, or with its full name (auv_lse_...).
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
