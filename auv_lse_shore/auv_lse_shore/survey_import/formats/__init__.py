"""Formats of logs: each module of this package reads one.

A format has a function `recognizes(file: LogFile) -> bool` that judges a file by its content, and a function
`read(file: LogFile, options: ReadOptions) -> list[LogContent]`, one of each vehicle. The first line of its docstring is
shown by the help. Formats that begin with a signature are asked first; `ASKED_LAST` is True for those that do not.
docs/extending/adding-a-log-format.md adds one.
"""

import importlib
import pkgutil
from types import ModuleType


def formats() -> list[ModuleType]:
    """The modules of all formats, in the order in which they are asked whether a file is theirs."""
    modules = [importlib.import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__)]
    return sorted(modules, key=lambda module: (getattr(module, "ASKED_LAST", False), module.__name__))
