"""Strict loading of parameters: one ROS 2 parameter file feeds every node, script and the fleet engine.

A configuration is a frozen dataclass whose fields are made with `parameter(...)`, which keeps the unit, the
range and the meaning beside the default. `from_mapping` turns a mapping (from YAML, or from a node's ROS
parameters) into the dataclass and refuses everything it does not know: an unknown key, a missing one, a value
of another type, a value out of range. Each refusal is a `ParameterError` that names the key, the value, what
was expected and where it came from.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import re
import types
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml

T = TypeVar("T")

#: Top-level sections of a mission file and the package whose dataclass checks each of them.
SECTIONS = {
    "mission": "auv_lse_planner",
    "level_set": "auv_lse_gp",
    "area": "auv_lse_gp",
    "gp": "auv_lse_gp",
    "places": "auv_lse_gp",
    "motion": "auv_lse_planner",
    "planner": "auv_lse_planner",
    "vehicle": "auv_lse_planner",
    "safety": "auv_lse_common",
    "tdma": "auv_lse_comms",
    "packet": "auv_lse_comms",
    "modem": "auv_lse_comms",
    "link": "auv_lse_comms",
    "sim": "auv_lse_sim",
    "record": "auv_lse_record",
}


#: A number that YAML 1.1 takes for text, since it wants a point and a sign in it (1.0e-3).
_EXPONENT = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+")


class ParameterError(ValueError):
    """A parameter that cannot be used: unknown, missing, of the wrong type or out of range."""


def parameter(
    default: Any = dataclasses.MISSING,
    *,
    help: str,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    above: float | None = None,
    choices: Sequence[str] | None = None,
) -> Any:
    """A dataclass field that knows its unit, range and meaning.

    Args:
        default: Default value (a tuple or mapping is allowed: it is copied); leave out if required.
        help: What it means, with the paper's symbol where it has one.
        unit: SI unit as text, "" for none.
        low: Smallest allowed value (of each element, for sequences), inclusive.
        high: Largest allowed value, inclusive.
        above: The value must be greater than this (exclusive lower end).
        choices: Allowed texts.
    """
    metadata = {"help": help, "unit": unit, "low": low, "high": high, "above": above, "choices": choices}
    if isinstance(default, dict):
        return dataclasses.field(default_factory=lambda: dict(default), metadata=metadata)
    if default is dataclasses.MISSING:
        return dataclasses.field(metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def from_mapping(cls: type[T], mapping: Mapping[str, Any], where: str) -> T:
    """Builds dataclass `cls` from `mapping`, refusing what does not fit.

    Args:
        cls: A dataclass; nested dataclass fields are built from nested mappings.
        mapping: Nested mapping of plain values.
        where: Where the mapping came from, for messages ("config/missions/default.yaml: gp").

    Raises:
        ParameterError: naming the key, the value, what was expected, and `where`.
    """
    if not isinstance(mapping, Mapping):
        raise ParameterError(f"{where}: expected a mapping of parameters, got {mapping!r}")
    hints = typing.get_type_hints(cls)
    fields = {f.name: f for f in dataclasses.fields(cls) if f.init}  # type: ignore[arg-type]  # any dataclass
    for key in mapping:
        if key not in fields:
            _refuse_unknown(key, mapping[key], fields, where)
    values: dict[str, Any] = {}
    for name, field in fields.items():
        key = f"{where}.{name}"
        if name not in mapping:
            if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
                if dataclasses.is_dataclass(hints[name]):
                    values[name] = from_mapping(hints[name], {}, key)
                    continue
                raise ParameterError(f"{key}: missing; expected {_describe(hints[name], field)}")
            continue
        values[name] = _convert(hints[name], mapping[name], key, field)
    try:
        return cls(**values)
    except ParameterError:
        raise
    except ValueError as error:
        raise ParameterError(f"{where}: {error}") from error


def problems(cls: type, mapping: Any, where: str) -> list[str]:
    """What is wrong with a mapping for dataclass `cls`: every unknown key, wrong type and value out of range.

    `from_mapping` stops at the first one. What holds between several parameters is checked by `from_mapping` alone.
    """
    if not isinstance(mapping, Mapping):
        return [f"{where}: expected a mapping of parameters, got {mapping!r}"]
    hints = typing.get_type_hints(cls)
    fields = {f.name: f for f in dataclasses.fields(cls) if f.init}
    found: list[str] = []
    for key, value in mapping.items():
        try:
            if key not in fields:
                _refuse_unknown(key, value, fields, where)
            elif dataclasses.is_dataclass(hints[key]):
                found += problems(typing.cast(type, hints[key]), value, f"{where}.{key}")
            else:
                _convert(hints[key], value, f"{where}.{key}", fields[key])
        except ParameterError as error:
            found.append(str(error))
    return found


def _refuse_unknown(key: Any, value: Any, known: typing.Iterable[str], where: str) -> None:
    near = difflib.get_close_matches(str(key), known, n=1)
    hint = f"; did you mean '{near[0]}'?" if near else f"; known: {', '.join(sorted(known))}"
    raise ParameterError(f"{where}.{key}: unknown parameter (value {value!r}){hint}")


def _describe(hint: Any, field: dataclasses.Field[Any]) -> str:
    meta = field.metadata
    text = getattr(hint, "__name__", str(hint))
    if meta.get("choices"):
        text = "one of " + ", ".join(map(repr, meta["choices"]))
    elif typing.get_origin(hint) is tuple:
        text = "a list of " + getattr(typing.get_args(hint)[0], "__name__", "values") + "s"
    limits = [
        f"{sign} {meta[name]:g}"
        for name, sign in (("above", ">"), ("low", ">="), ("high", "<="))
        if meta.get(name) is not None
    ]
    unit = f" {meta['unit']}" if meta.get("unit") else ""
    return text + (" " + " and ".join(limits) + unit if limits else (f" in{unit}" if unit else ""))


def _convert(hint: Any, value: Any, key: str, field: dataclasses.Field[Any]) -> Any:
    expected = f"expected {_describe(hint, field)}"
    if dataclasses.is_dataclass(hint):
        return from_mapping(hint, value, key)  # type: ignore[arg-type]  # a class, not an instance
    origin = typing.get_origin(hint)
    if origin in (typing.Union, types.UnionType):
        if value is None:
            return None
        hint = next(a for a in typing.get_args(hint) if a is not type(None))
        return _convert(hint, value, key, field)
    if origin is dict:
        if not isinstance(value, Mapping):
            raise ParameterError(f"{key}: got {value!r}; expected a mapping of names")
        return {str(k): _convert(typing.get_args(hint)[1], v, f"{key}.{k}", field) for k, v in value.items()}
    if origin is tuple:
        if isinstance(value, str | bytes) or not hasattr(value, "__iter__"):
            raise ParameterError(f"{key}: got {value!r}; {expected}")
        return tuple(_scalar(typing.get_args(hint)[0], v, f"{key}[{i}]", field, expected) for i, v in enumerate(value))
    return _scalar(hint, value, key, field, expected)


def _scalar(hint: Any, value: Any, key: str, field: dataclasses.Field[Any], expected: str) -> Any:
    problem = ParameterError(f"{key}: got {value!r}; {expected}")
    if hint is bool:
        if not isinstance(value, bool):
            raise problem
        return value
    if hint is str:
        if not isinstance(value, str) or (field.metadata.get("choices") and value not in field.metadata["choices"]):
            raise problem
        return value
    if hint is float and isinstance(value, str) and _EXPONENT.fullmatch(value):
        value = float(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise problem
    if hint is int:
        if isinstance(value, float):
            raise problem
    elif hint is float:
        try:
            value = float(value)
        except OverflowError:  # a whole number beyond a float's range
            raise problem from None
        if not math.isfinite(value):
            raise problem
    low, high, above = (field.metadata.get(k) for k in ("low", "high", "above"))
    if (low is not None and value < low) or (high is not None and value > high):
        raise problem
    if above is not None and value <= above:
        raise problem
    return value


def to_mapping(config: Any) -> dict[str, Any]:
    """The nested plain mapping of a configuration, as `from_mapping` takes it (tuples become lists, None stays out)."""
    result: dict[str, Any] = {}
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if value is None or (value == {} or value == ()):
            continue  # a ROS 2 parameter file can hold neither null nor an untyped empty list
        if dataclasses.is_dataclass(value):
            value = to_mapping(value)
        elif isinstance(value, tuple):
            value = list(value)
        elif isinstance(value, dict):
            value = {k: list(v) if isinstance(v, tuple) else v for k, v in value.items()}
        result[field.name] = value
    return result


def describe(cls: type, prefix: str = "") -> list[tuple[str, Any, str, str, str]]:
    """Rows (name, default, unit, range or choices, meaning) of every parameter of `cls`, nested ones too."""
    rows: list[tuple[str, Any, str, str, str]] = []
    hints = typing.get_type_hints(cls)
    for field in dataclasses.fields(cls):
        if dataclasses.is_dataclass(hints[field.name]):
            rows += describe(hints[field.name], f"{prefix}{field.name}.")
            continue
        default = field.default
        if default is dataclasses.MISSING:
            default = field.default_factory() if field.default_factory is not dataclasses.MISSING else "required"
        meta = field.metadata
        allowed = ", ".join(meta.get("choices") or ()) or " ".join(
            f"{sign} {meta[name]:g}"
            for name, sign in (("above", ">"), ("low", ">="), ("high", "<="))
            if meta.get(name) is not None
        )
        rows.append((prefix + field.name, default, meta.get("unit", ""), allowed, meta.get("help", "")))
    return rows


def nest(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Nested mapping from ROS's dotted names: {"gp.kernel": 1} becomes {"gp": {"kernel": 1}}.

    Raises:
        ParameterError: if a name is a section and a value both.
    """
    nested: dict[str, Any] = {}
    for name, value in flat.items():
        *parents, leaf = str(name).split(".")
        level = nested
        for parent in parents:
            level = level.setdefault(parent, {})
            if not isinstance(level, dict):
                raise ParameterError(f"{name}: got {value!r}; expected '{parent}' to be a section, and it has a value")
        level[leaf] = value
    return nested


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Nested mapping with the values of `over` on top of those of `base`."""
    merged = dict(base)
    for key, value in over.items():
        old = merged.get(key)
        merged[key] = merge(old, value) if isinstance(old, Mapping) and isinstance(value, Mapping) else value
    return merged


def read_parameter_file(path: str | Path) -> dict[str, dict[str, Any]]:
    """Reads a ROS 2 parameter file: {node pattern: nested parameters}, in the file's order.

    Raises:
        ParameterError: if the file is missing, empty, not YAML, or not shaped as a ROS 2 parameter file.
    """
    return parse_parameters(_text_of(Path(path)), str(path))


def read_yaml(path: Path) -> Any:
    """What a YAML file holds.

    Raises:
        ParameterError: if the file is missing, no text, or not YAML.
    """
    return _parse_yaml(_text_of(path), str(path))


def _text_of(path: Path) -> str:
    try:
        return path.read_text()
    except OSError as error:
        raise ParameterError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # bytes that are no text
        raise ParameterError(f"{path}: is no text in UTF-8: {error}") from error


class _EachKeyOnce(yaml.SafeLoader):  # type: ignore[misc]  # PyYAML comes without types
    """YAML's own loader takes the last of two equal keys: a section that stands twice would lose its first half."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[tuple[str, str]] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and (key.tag, key.value) in seen:
                what = f"the key {key.value!r} stands here again; expected each key once"
                raise yaml.constructor.ConstructorError(problem=what, problem_mark=key.start_mark)
            seen.add((key.tag, str(key.value)))
        found: dict[Any, Any] = super().construct_mapping(node, deep)
        return found


def _parse_yaml(text: str, where: str) -> Any:
    try:
        return yaml.load(text, _EachKeyOnce)
    except yaml.MarkedYAMLError as error:
        at = error.problem_mark or error.context_mark
        place = f"line {at.line + 1}, column {at.column + 1}: " if at else ""
        raise ParameterError(f"{where}: not valid YAML: {place}{error.problem or error.context}") from error
    except yaml.YAMLError as error:
        raise ParameterError(f"{where}: not valid YAML: {error}") from error
    except (RecursionError, ValueError) as error:  # nested without end; a date or number that cannot be
        raise ParameterError(f"{where}: not valid YAML: {str(error) or 'nested too deeply'}") from error


def parse_parameters(text: str, where: str) -> dict[str, dict[str, Any]]:
    """As `read_parameter_file`, from the file's text; `where` names it in messages."""
    data = _parse_yaml(text, where)
    shape = "a ROS 2 parameter file: '/**:' (or '/auv1/**:'), then 'ros__parameters:', then the parameters"
    if not isinstance(data, Mapping) or not data:
        raise ParameterError(f"{where}: is {'empty' if data is None else repr(data)[:60]}; expected {shape}")
    patterns: dict[str, dict[str, Any]] = {}
    for pattern, body in data.items():
        if not isinstance(body, Mapping) or set(body) != {"ros__parameters"}:
            raise ParameterError(f"{where}: under {pattern!r}: expected {shape}")
        values = body["ros__parameters"]
        if not isinstance(values, Mapping | None):
            raise ParameterError(f"{where}: under {pattern!r}: ros__parameters: got {values!r}; expected parameters")
        patterns[str(pattern)] = {str(name): value for name, value in (values or {}).items()}
    return patterns


#: What the wildcards of a node pattern match.
_WILD = {"*": r"/\w+", "**": r"(/\w+)*"}


def parameters_for(patterns: Mapping[str, Mapping[str, Any]], node: str) -> dict[str, Any]:
    """The nested parameters that a node (its full name, "/auv1/gp_node") gets, later patterns over earlier ones.

    Follows rcl, which matches full names: `/*` stands for one name, `/**` for any number of them.
    """
    merged: dict[str, Any] = {}
    for pattern, values in patterns.items():
        parts = (_WILD.get(part, re.escape("/" + part)) for part in pattern.removeprefix("/").split("/"))
        if re.fullmatch("".join(parts), node):
            merged = merge(merged, nest(values))
    return merged


def section(cls: type[T], parameters: Mapping[str, Any], name: str, where: str) -> T:
    """The section `name` of nested `parameters` as `cls`; a missing section takes its defaults."""
    return from_mapping(cls, parameters.get(name, {}), f"{where}: {name}")


def check_sections(parameters: Mapping[str, Any], where: str, ignore: Sequence[str] = ()) -> None:
    """Refuses top-level names that no package of the stack owns.

    Raises:
        ParameterError: naming the section and the nearest known one.
    """
    for name in parameters:
        if name not in SECTIONS and name not in ignore:
            near = difflib.get_close_matches(str(name), SECTIONS, n=1)
            hint = f"; did you mean '{near[0]}'?" if near else f"; known: {', '.join(SECTIONS)}"
            raise ParameterError(f"{where}: {name}: unknown section{hint}")
