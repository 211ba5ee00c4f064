"""File formats of an export: each module of this package is one.

A format has a function `write(export: Export) -> str` that writes its files into `export.folder` and returns a line
for the terminal. It may have a function `check()` that raises `ExportError` where the format cannot be written. The
first line of its docstring is shown by `auv_lse export --help`. docs/extending/adding-an-export-format.md adds one.
"""

import importlib
import pkgutil
from types import ModuleType


def formats() -> list[ModuleType]:
    """The modules of all formats, by name."""
    return [importlib.import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__)]
