"""Reads ROS 2 parameter files: node patterns, and the parameters of a node."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

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
