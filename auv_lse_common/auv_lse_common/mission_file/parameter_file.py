"""Reads and writes ROS 2 parameter files: node patterns, and the parameters of a node."""

import contextlib
import os
import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml

from auv_lse_common.mission_file.degrees import AreaReader, in_metres
from auv_lse_common.mission_file.parameters import ParameterError, merge, nest
from auv_lse_common.mission_file.strict_yaml import parse_yaml
from auv_lse_common.support.input_bounds import MAX_PATTERNS, MAX_YAML_BYTES, over_size
from auv_lse_common.support.text import encoding_of
from auv_lse_common.support.user_error import brief


def read_parameter_file(
    path: str | Path,
    read_area: AreaReader | None = None,
    is_recorded: bool = False,
    origin_on_top: Mapping[str, Any] | None = None,
) -> dict[str, dict[str, Any]]:
    """Reads a ROS 2 parameter file: {node pattern: nested parameters}, in the file's order; all is in metres.

    Args:
        read_area: Reads the file that `area.file` names; None: such a file is refused.
        is_recorded: Whether it is the file of a run, which an earlier version may have written: see `parse_yaml`.
        origin_on_top: As in `in_metres`.

    Raises:
        ParameterError: if the file is missing, empty, not YAML, or not shaped as a ROS 2 parameter file.
    """
    path = Path(path)
    patterns = parse_parameters(_read_text(path), str(path), is_recorded)
    return in_metres(patterns, path.parent, str(path), read_area, origin_on_top=origin_on_top)


def parse_parameters(text: str, where: str, is_recorded: bool = False) -> dict[str, dict[str, Any]]:
    """As `read_parameter_file`, from the file's text; `where` names the file in messages."""
    data = parse_yaml(text, where, is_recorded)
    shape = "a ROS 2 parameter file: '/**:' (or '/auv1/**:'), then 'ros__parameters:', then the parameters"
    if not isinstance(data, Mapping) or not data:
        raise ParameterError(f"{where} {'is empty' if data is None else f'holds {repr(data)[:60]}'}; write {shape}")
    if len(data) > MAX_PATTERNS:
        raise ParameterError(f"{where} has {len(data):,} node patterns, more than {MAX_PATTERNS:,}. Leave out some")
    patterns: dict[str, dict[str, Any]] = {}
    for pattern, body in data.items():
        if not isinstance(body, Mapping) or set(body) != {"ros__parameters"}:
            raise ParameterError(f"{where}: {pattern!r} must hold 'ros__parameters:' alone; write {shape}")
        values = body["ros__parameters"]
        if not isinstance(values, Mapping | None):
            raise ParameterError(f"{where}: {pattern!r}: ros__parameters must hold parameters, not {values!r}")
        patterns[str(pattern)] = {str(name): value for name, value in (values or {}).items()}
    return patterns


def read_yaml(path: Path) -> Any:
    """The content of a YAML file.

    Raises:
        ParameterError: if the file is missing, not UTF-8 text, or not YAML.
    """
    return parse_yaml(_read_text(path), str(path))


#: Regular expressions for the wildcards of a node pattern.
_WILDCARDS = {"*": r"/\w+", "**": r"(/\w+)*"}


def parameters_for(patterns: Mapping[str, Mapping[str, Any]], node: str) -> dict[str, Any]:
    """The nested parameters of a node, later patterns over earlier ones.

    As in rcl, `/*` matches one name, and `/**` any number of names.

    Args:
        patterns: As `read_parameter_file` returns them.
        node: Full name, "/auv1/gp_node".
    """
    merged: dict[str, Any] = {}
    for pattern, values in patterns.items():
        parts = (_WILDCARDS.get(part, re.escape("/" + part)) for part in pattern.removeprefix("/").split("/"))
        if re.fullmatch("".join(parts), node):
            merged = merge(merged, nest(values))
    return merged


def parameter_text(patterns: Mapping[str, Mapping[str, Any]]) -> str:
    """The text of a ROS 2 parameter file, with nothing that ROS's YAML parser cannot read or takes for another value.

    It supports no aliases, refuses a list of integers and floats, and URLs in braces without quotes, and takes 0801 and
    1e5 for numbers, and y for true.
    """
    body = {pattern: {"ros__parameters": _plain(values)} for pattern, values in patterns.items()}
    text: str = yaml.dump(
        body, Dumper=_Dumper, sort_keys=False, default_flow_style=False, allow_unicode=True, width=110
    )
    return text


def readable_by_ros(arguments: Sequence[str]) -> list[str]:
    """A node's command line, each parameter file replaced by one in memory that ROS's YAML parser can read.

    Raises:
        ParameterError: if a file cannot be read here either.
    """
    result = list(arguments)
    for number, (option, path) in enumerate(pairwise(arguments), 1):
        if option == "--params-file" and hasattr(os, "memfd_create"):
            result[number] = str(file_in_memory(parameter_text(read_parameter_file(path))))
    return result


def as_comment(path: Path) -> str:
    """A file with comments as one comment, so that these are kept behind what was made of the file; else ""."""
    text = _read_text(path)
    lines = [f"{path.name}, as it was written:", *text.splitlines()] if "#" in text else []
    return "".join(f"# {line}".rstrip() + "\n" for line in lines)


def file_in_memory(text: str) -> Path:
    """A parameter file in memory for as long as this process runs: a node must start although the disk is full."""
    file = os.memfd_create("mission.yaml")
    os.write(file, text.encode())
    return Path(f"/proc/{os.getpid()}/fd/{file}")


class _Dumper(yaml.SafeDumper):  # type: ignore[misc]  # yaml has no types
    """Writes floats that YAML 1.1 reads as floats: 1.0e-05 instead of 1e-05."""


def _float(dumper: yaml.SafeDumper, value: float) -> Any:
    text = repr(value)
    if "e" in text:
        mantissa, exponent = text.split("e")
        sign = exponent if exponent[0] in "+-" else "+" + exponent
        text = f"{mantissa if '.' in mantissa else mantissa + '.0'}e{sign}"
    return dumper.represent_scalar("tag:yaml.org,2002:float", text)


def _text(dumper: yaml.SafeDumper, value: str) -> Any:
    """A text; in quotes if ROS would take it for a number or a truth value without them."""
    is_doubtful = value.lower() in ("y", "n")
    with contextlib.suppress(ValueError):
        float(value)
        is_doubtful = True
    return dumper.represent_scalar("tag:yaml.org,2002:str", value, style="'" if is_doubtful else None)


def _list(dumper: yaml.SafeDumper, value: list[Any]) -> Any:
    return dumper.represent_sequence("tag:yaml.org,2002:seq", value, flow_style=True)


_Dumper.add_representer(float, _float)
_Dumper.add_representer(str, _text)
_Dumper.add_representer(list, _list)
_Dumper.ignore_aliases = lambda self, data: True


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if not isinstance(value, list | tuple):
        return value
    if {type(v) for v in value} == {int, float}:
        return [float(v) for v in value]
    return [_plain(v) for v in value]


def _read_text(path: Path) -> str:
    try:
        if too_large := over_size(path, MAX_YAML_BYTES):
            raise ParameterError(f"{too_large}. Is this a mission file?")
        data = path.read_bytes()
        return data.decode(encoding_of(data))
    except OSError as error:
        raise ParameterError(f"{path}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise ParameterError(f"{path} is not UTF-8 text: {brief(error)}. Save it as UTF-8") from error
