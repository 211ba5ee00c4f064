"""Reads ROS 2 parameter files: strict YAML, node patterns, and the parameters of a node."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from auv_lse_common.mission_file.degrees import AreaReader, in_metres
from auv_lse_common.mission_file.parameters import ParameterError, merge, nest
from auv_lse_common.support.input_bounds import MAX_PATTERNS, MAX_YAML_BYTES, MAX_YAML_VALUES, over_size
from auv_lse_common.support.user_error import brief


def read_parameter_file(path: str | Path, read_area: AreaReader | None = None) -> dict[str, dict[str, Any]]:
    """Reads a ROS 2 parameter file: {node pattern: nested parameters}, in the file's order; all is in metres.

    Args:
        path: The file.
        read_area: Reads the file that `area.file` names; None: such a file is refused.

    Raises:
        ParameterError: if the file is missing, empty, not YAML, or not shaped as a ROS 2 parameter file.
    """
    path = Path(path)
    return in_metres(parse_parameters(_read_text(path), str(path)), path.parent, str(path), read_area)


def parse_parameters(text: str, where: str) -> dict[str, dict[str, Any]]:
    """As `read_parameter_file`, from the file's text; `where` names the file in messages."""
    data = _parse_yaml(text, where)
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
    return _parse_yaml(_read_text(path), str(path))


def yaml_value(text: str) -> Any:
    """The value of a text in YAML, as for a parameter on the command line.

    Raises:
        ParameterError: if it is not YAML.
    """
    return _parse_yaml(text, repr(text))


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
        return path.read_text()
    except OSError as error:
        raise ParameterError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # UnicodeDecodeError
        raise ParameterError(f"{path} is not UTF-8 text: {brief(error)}") from error


class _UniqueKeyLoader(yaml.SafeLoader):  # type: ignore[misc]  # PyYAML comes without types
    """Rejects duplicate keys; PyYAML would silently keep only the last one.

    Also rejects aliases that multiply a short file into more than `MAX_YAML_VALUES` values, and numbers that YAML 1.1
    reads in base 8 (010 is 8) or 60 (1:30 is 90).
    """

    def get_single_node(self) -> yaml.Node | None:
        node: yaml.Node | None = super().get_single_node()
        if node is not None and (number := _count_values(node, {})) > MAX_YAML_VALUES:
            what = f"too many values: {number:.3g}, aliases included; at most {MAX_YAML_VALUES} are read"
            raise yaml.constructor.ConstructorError(problem=what, problem_mark=node.start_mark)
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[tuple[str, str]] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and (key.tag, key.value) in seen:
                what = f"the key {key.value!r} appears twice; remove one"
                raise yaml.constructor.ConstructorError(problem=what, problem_mark=key.start_mark)
            seen.add((key.tag, str(key.value)))
        found: dict[Any, Any] = super().construct_mapping(node, deep)
        return found

    def construct_number(self, node: yaml.ScalarNode) -> int | float:
        """Whole numbers and others."""
        text = node.value.lstrip("+-")
        if ":" in text or re.fullmatch(r"0[0-7_]+", text):
            base, cure = (60, "in one unit") if ":" in text else (8, "without the zero in front")
            what = f"YAML reads {node.value} in base {base}; write the number {cure}"
            raise yaml.constructor.ConstructorError(problem=what, problem_mark=node.start_mark)
        is_whole = node.tag.endswith(":int")
        value: int | float = self.construct_yaml_int(node) if is_whole else self.construct_yaml_float(node)
        return value


for _kind in ("int", "float"):
    _UniqueKeyLoader.add_constructor(f"tag:yaml.org,2002:{_kind}", _UniqueKeyLoader.construct_number)


def _count_values(node: yaml.Node, known: dict[int, float]) -> float:
    """Values below a node, each alias counted as what it stands for; inf where it stands for itself."""
    if id(node) not in known:
        known[id(node)] = math.inf  # until it is counted: met again meanwhile, it contains itself
        parts = node.value if isinstance(node, yaml.CollectionNode) else ()
        parts = [part for pair in parts for part in pair] if isinstance(node, yaml.MappingNode) else parts
        known[id(node)] = 1.0 + sum(_count_values(part, known) for part in parts)
    return known[id(node)]


def _parse_yaml(text: str, where: str) -> Any:
    try:
        return yaml.load(text, _UniqueKeyLoader)
    except yaml.MarkedYAMLError as error:
        at = error.problem_mark or error.context_mark
        position = f"line {at.line + 1}, column {at.column + 1}: " if at else ""
        raise ParameterError(f"{where}: not valid YAML: {position}{error.problem or error.context}") from error
    except yaml.YAMLError as error:
        raise ParameterError(f"{where}: not valid YAML: {brief(error)}") from error
    except RecursionError as error:
        raise ParameterError(f"{where}: not valid YAML: nested too deeply") from error
    except ValueError as error:  # an impossible date or number
        raise ParameterError(f"{where}: not valid YAML: {error}") from error
