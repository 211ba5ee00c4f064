"""Parameters: dataclass fields with unit, range and meaning, and the strict loader that fills them.

A `configuration` is a frozen dataclass whose fields are declared with `parameter(...)`. `from_mapping` builds it from a
nested mapping (from YAML, or from a node's ROS parameters). It rejects unknown and missing keys, and values of the
wrong type or out of range, with a `ParameterError`.
"""

import dataclasses
import difflib
import functools
import math
import numbers
import re
import types
import typing
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeVar

from auv_lse_common.mission_file.retired import RENAMED, RETIRED, replacement

T = TypeVar("T")

#: A number that YAML 1.1 reads as text: it lacks the point, the exponent's sign (1e-3 for 1.0e-3) or the zero (-.5).
NUMBER_AS_TEXT = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+|[-+]\.\d+")
#: ROS 2 parameters hold whole numbers below this.
INTEGER_LIMIT = 2**63
#: Sections of a mission file that have a parameter of this name; `sections/table.py` adds its own.
SECTIONS_OF: dict[str, list[str]] = {}
_TYPE_NAMES = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}


class ParameterError(ValueError):
    """An unusable parameter: unknown, missing, of the wrong type or out of range."""


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
    """A dataclass field with unit, range and meaning.

    Args:
        default: Default value (a dict is copied); omitted for a required parameter.
        help: Its meaning, with the paper's symbol if there is one.
        unit: SI unit as text, "" for none.
        low: Smallest allowed value (of each element of a sequence), inclusive.
        high: Largest allowed value, inclusive.
        above: Exclusive lower limit.
    """
    metadata = {"help": help, "unit": unit, "low": low, "high": high, "above": above, "choices": choices}
    if isinstance(default, dict):
        return dataclasses.field(default_factory=lambda: dict(default), metadata=metadata)
    if default is dataclasses.MISSING:
        return dataclasses.field(metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


@typing.dataclass_transform(frozen_default=True, kw_only_default=True)
def configuration(cls: type[T]) -> type[T]:
    """Decorates a class of parameters: a frozen dataclass that refuses what a mission file must not hold."""
    check = cls.__dict__.get("__post_init__", lambda self: None)

    def __post_init__(self: Any) -> None:
        hints = _hints(self.__class__)
        for field in dataclasses.fields(self):
            name = f"{type(self).__name__}.{field.name}"
            if text := _refusal(hints[field.name], getattr(self, field.name), name, field):
                raise ParameterError(text)
        check(self)

    __post_init__.__doc__ = check.__doc__
    type.__setattr__(cls, "__post_init__", __post_init__)
    return dataclasses.dataclass(frozen=True, slots=True, kw_only=True)(cls)


@functools.cache
def _hints(cls: type) -> dict[str, Any]:
    return typing.get_type_hints(cls)


def from_mapping(cls: type[T], mapping: Mapping[str, Any], where: str) -> T:
    """Builds dataclass `cls` from `mapping`.

    Args:
        cls: A dataclass; nested dataclass fields are built from nested mappings.
        where: Where the mapping came from, for messages ("config/missions/default.yaml: gp").

    Raises:
        ParameterError: naming the key, the value, what was expected, and `where`.
    """
    hints, fields = _declared(cls, mapping, where)
    for key in mapping:
        if key not in fields:
            raise _unknown(key, mapping[key], fields, where)
    values: dict[str, Any] = {}
    for name, field in fields.items():
        key = f"{where}.{name}"
        if name in mapping:
            values[name] = _convert(hints[name], mapping[name], key, field)
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            if not dataclasses.is_dataclass(hints[name]):
                raise ParameterError(f"{key} is missing; set it to {_allowed(hints[name], field)}")
            values[name] = from_mapping(typing.cast(type, hints[name]), {}, key)
    try:
        return cls(**values)
    except ValueError as error:  # parameters contradict each other; the text starts with their names
        file, separator, name = where.rpartition(": ")
        full = str(error) if str(error).startswith(f"{name}.") else f"{name}.{error}"
        raise ParameterError(f"{file}{separator}{full}") from error


def nest(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Nested mapping from ROS's dotted names: {"gp.kernel": 1} becomes {"gp": {"kernel": 1}}.

    Raises:
        ParameterError: if a name is both a section and a value.
    """
    nested: dict[str, Any] = {}
    for name, value in flat.items():
        *parents, leaf = str(name).split(".")
        level = nested
        for parent in parents:
            level = level.setdefault(parent, {})
            if not isinstance(level, dict):
                raise ParameterError(
                    f"{name} (value {value!r}): '{parent}' is already a value, so it cannot be a section"
                )
        old = level.get(leaf)
        level[leaf] = merge(old if isinstance(old, Mapping) else {}, value) if isinstance(value, Mapping) else value
    return nested


def flatten(nested: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """The reverse of `nest`: values by their dotted names, which begin with `prefix` ("gp.")."""
    flat: dict[str, Any] = {}
    for key, value in nested.items():
        flat |= flatten(value, f"{prefix}{key}.") if isinstance(value, Mapping) else {f"{prefix}{key}": value}
    return flat


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Nested mapping with the values of `over` on top of those of `base`."""
    merged = dict(base)
    for key, value in over.items():
        old = merged.get(key)
        merged[key] = merge(old, value) if isinstance(old, Mapping) and isinstance(value, Mapping) else value
    return merged


def section(cls: type[T], parameters: Mapping[str, Any], name: str, where: str) -> T:
    """The section `name` of nested `parameters` as `cls`; a missing section has its defaults."""
    return from_mapping(cls, parameters.get(name, {}), f"{where}: {name}")


def is_given(parameters: Mapping[str, Any], name: str) -> bool:
    """Whether nested `parameters` contain the dotted `name`, "area.polygon_m"."""
    section_name, _, key = name.partition(".")
    values = parameters.get(section_name, {})
    return isinstance(values, Mapping) and key in values


def problems(cls: type, mapping: Any, where: str) -> list[str]:
    """All errors in a mapping for dataclass `cls`; `from_mapping` stops at the first.

    Only `from_mapping` checks for parameters that contradict each other.
    """
    return [text for _, text in split_refused(cls, mapping, where)[1]]


def split_refused(cls: type, mapping: Any, where: str) -> tuple[dict[str, Any], list[tuple[str, str]]]:
    """Separates the valid values of a mapping for dataclass `cls` from the invalid ones.

    Only `from_mapping` checks for parameters that contradict each other.

    Returns:
        The valid values, and for each invalid one its dotted name and the message. The name of an unknown key is that
        of the most similar parameter, or else of its section; "" is `cls` itself.
    """
    try:
        hints, fields = _declared(cls, mapping, where)
    except ParameterError as error:
        return {}, [("", str(error))]
    usable: dict[str, Any] = {}
    refused: list[tuple[str, str]] = []
    for key, value in mapping.items():
        if key not in fields:
            refused.append((_nearest(key, fields), str(_unknown(key, value, fields, where))))
        elif dataclasses.is_dataclass(hints[key]):
            usable[key], inner = split_refused(typing.cast(type, hints[key]), value, f"{where}.{key}")
            refused += [(f"{key}.{name}".rstrip("."), text) for name, text in inner]
        elif typing.get_origin(hints[key]) is dict and isinstance(value, Mapping):
            usable[key] = {}
            for name, item in value.items():
                try:
                    usable[key].update(_convert(hints[key], {name: item}, f"{where}.{key}", fields[key]))
                except ParameterError as error:
                    refused.append((key, str(error)))
        else:
            try:
                _convert(hints[key], value, f"{where}.{key}", fields[key])
                usable[key] = value
            except ParameterError as error:
                refused.append((key, str(error)))
    return usable, refused


def to_mapping(config: Any) -> dict[str, Any]:
    """The nested mapping that `from_mapping` turns into an equal configuration.

    Tuples become lists. None and empty values are omitted, because a ROS 2 parameter file can hold neither null nor an
    empty list.
    """
    result: dict[str, Any] = {}
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if value is None or value == {} or value == ():
            continue
        if dataclasses.is_dataclass(value):
            value = to_mapping(value)
            if not value:
                continue
        elif isinstance(value, tuple):
            value = list(value)
        elif isinstance(value, dict):
            value = {k: list(v) if isinstance(v, tuple) else v for k, v in value.items()}
        result[field.name] = value
    return result


def describe(cls: type, prefix: str = "") -> list[tuple[str, Any, str, str, str]]:
    """Rows (name, default, unit, range or choices, meaning) of every parameter of `cls`, nested ones included."""
    rows: list[tuple[str, Any, str, str, str]] = []
    hints = _hints(cls)
    for field in dataclasses.fields(cls):
        if dataclasses.is_dataclass(hints[field.name]):
            rows += describe(hints[field.name], f"{prefix}{field.name}.")
            continue
        default = field.default
        if default is dataclasses.MISSING:
            default = field.default_factory() if field.default_factory is not dataclasses.MISSING else "required"
        meta = field.metadata
        allowed = ", ".join(meta.get("choices") or ()) or _limits(meta)
        rows.append((prefix + field.name, default, meta.get("unit", ""), allowed, meta.get("help", "")))
    return rows


def limits_of(cls: type, prefix: str = "") -> dict[str, tuple[float | None, float | None]]:
    """The lowest and the highest value of each single number of `cls`, nested ones included, by name."""
    found: dict[str, tuple[float | None, float | None]] = {}
    for field in dataclasses.fields(cls):
        hint = _hints(cls)[field.name]
        if isinstance(hint, type) and dataclasses.is_dataclass(hint):
            found |= limits_of(hint, f"{prefix}{field.name}.")
        elif {hint, *typing.get_args(hint)} & {int, float} and typing.get_origin(hint) not in (tuple, dict):
            found[prefix + field.name] = (field.metadata.get("low"), field.metadata.get("high"))
    return found


def _declared(cls: type, mapping: Any, where: str) -> tuple[dict[str, Any], dict[str, dataclasses.Field[Any]]]:
    """Types and fields of a dataclass, by name."""
    if not isinstance(mapping, Mapping):
        raise ParameterError(f"{where} must be a mapping of parameters, not {mapping!r}")
    return _hints(cls), {f.name: f for f in dataclasses.fields(cls) if f.init}


def _nearest(key: Any, known: Iterable[str]) -> str:
    """The known name most similar to an unknown key; "" if none is similar."""
    return next(iter(difflib.get_close_matches(str(key), known, n=1)), "")


def _in_other_sections(section_name: str, key: Any) -> list[str]:
    """Dotted names of the parameters called `key` in other sections of a mission file; none for other mappings."""
    if not any(section_name in sections for sections in SECTIONS_OF.values()):
        return []
    return [f"{name}.{key}" for name in SECTIONS_OF.get(key, ())]


def _unknown(key: Any, value: Any, known: Iterable[str], where: str) -> ParameterError:
    near = _nearest(key, known)
    hint = f"did you mean '{near}'?" if near else f"known: {', '.join(sorted(known))}"
    name = f"{where}.{key}".rpartition(": ")[2]
    if others := _in_other_sections(name.partition(".")[0], key):
        hint = f"did you mean {' or '.join(others)}?"
    if value is None and str(key).isdigit():  # {level_m: 15,5}
        hint = "YAML separates by commas; write a decimal point"
    if name in RETIRED:
        hint = "it was removed. Delete it"
    elif name in RENAMED:
        hint = f"its name is now {RENAMED[name]}"
    return ParameterError(f"{where}.{key}: unknown parameter (value {value!r}); {hint}")


def _allowed(hint: Any, field: dataclasses.Field[Any]) -> str:
    """Text for the values of a field: "a number from 0 to 1", "a list of numbers in m"."""
    meta = field.metadata
    if meta.get("choices"):
        return "one of " + ", ".join(map(repr, meta["choices"]))
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        hint = _without_none(hint)
    if typing.get_origin(hint) is tuple:
        element = _TYPE_NAMES[typing.get_args(hint)[0]]
        text = f"a list of {element.removeprefix('a ')}s"
    else:
        if hint not in _TYPE_NAMES:
            is_object = isinstance(hint, type) and dataclasses.is_dataclass(hint)
            return f"an object of the class {hint.__name__}" if is_object else "a mapping of names"
        text = _TYPE_NAMES[hint]
    limits, unit = _limits(meta), meta.get("unit") or ""
    joint = "from" if " to " in limits else "of" if limits.startswith("at ") else "in" if unit and not limits else ""
    words = (text, joint, limits, unit)
    return " ".join(word for word in words if word)


def _limits(meta: Mapping[str, Any]) -> str:
    """The allowed range: "0 to 1", "at least 0", "above 0 and at most 10"; "" if there is none."""
    if meta.get("low") is not None and meta.get("high") is not None:
        return f"{_written(meta['low'])} to {_written(meta['high'])}"
    words = (("above", "above"), ("low", "at least"), ("high", "at most"))
    return " and ".join(f"{word} {_written(meta[name])}" for name, word in words if meta.get(name) is not None)


def _written(limit: float) -> str:
    return f"{limit:,.0f}" if abs(limit) >= 1e4 else f"{limit:g}"


def _without_none(hint: Any) -> Any:
    return next(a for a in typing.get_args(hint) if a is not type(None))


def _has_type(hint: Any, value: Any) -> bool:
    """Whether a value, which may be NumPy's, has the type of a field."""
    if (origin := typing.get_origin(hint)) in (typing.Union, types.UnionType):
        return value is None or _has_type(_without_none(hint), value)
    if origin is dict:
        return isinstance(value, Mapping) and all(_has_type(typing.get_args(hint)[1], v) for v in value.values())
    if origin is tuple:
        is_list = hasattr(value, "__iter__") and not isinstance(value, str | bytes | Mapping)
        return is_list and all(_has_type(typing.get_args(hint)[0], v) for v in value)
    if hint in (int, float):
        return isinstance(value, numbers.Integral if hint is int else numbers.Real) and not isinstance(value, bool)
    return isinstance(value, hint) or (hint is bool and getattr(value, "dtype", None) == "bool")


def _is_within(value: Any, meta: Mapping[str, Any]) -> bool:
    low, high, above = (meta.get(name) for name in ("low", "high", "above"))
    return not (
        (low is not None and value < low)
        or (high is not None and value > high)
        or (above is not None and value <= above)
    )


def _refusal(hint: Any, value: Any, name: str, field: dataclasses.Field[Any]) -> str:
    """Why a value, which may be NumPy's, has the wrong type, or is out of range; "" if it is neither."""
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return "" if value is None else _refusal(_without_none(hint), value, name, field)
    if typing.get_origin(hint) is tuple and _has_type(hint, value):
        element = typing.get_args(hint)[0]
        each = (_refusal(element, v, f"{name}[{i}]", field) for i, v in enumerate(value))
        return next(filter(None, each), "")
    choices = field.metadata.get("choices")
    good = _has_type(hint, value) and (not choices or value in choices)
    if hint in (int, float):
        good = good and math.isfinite(value) and _is_within(value, field.metadata)
    return "" if good else f"{name} must be {_allowed(hint, field)}, not {value!r}"


def _convert(hint: Any, value: Any, key: str, field: dataclasses.Field[Any]) -> Any:
    if dataclasses.is_dataclass(hint):
        return from_mapping(typing.cast(type, hint), value, key)
    origin = typing.get_origin(hint)
    if origin in (typing.Union, types.UnionType):
        return None if value is None else _convert(_without_none(hint), value, key, field)
    if origin is dict:
        if not isinstance(value, Mapping):
            raise ParameterError(f"{key} must map names to values, not {value!r}")
        return {str(k): _convert(typing.get_args(hint)[1], v, f"{key}.{k}", field) for k, v in value.items()}
    if origin is tuple:
        if isinstance(value, str | bytes) or not hasattr(value, "__iter__"):
            raise ParameterError(f"{key} must be {_allowed(hint, field)}, not {value!r}")
        element = typing.get_args(hint)[0]
        allowed = _allowed(element, field)
        return tuple(_scalar(element, v, f"{key}[{i}]", field.metadata, allowed) for i, v in enumerate(value))
    return _scalar(hint, value, key, field.metadata, _allowed(hint, field))


def _scalar(hint: Any, value: Any, key: str, meta: Mapping[str, Any], allowed: str) -> Any:
    error = ParameterError(f"{key} must be {allowed}, not {value!r}")
    if (new := replacement(key, value)) is not None:
        raise ParameterError(f"{error}. {value!r} was replaced by {new!r}")
    if hint in (bool, str):
        if not isinstance(value, hint) or (meta.get("choices") and value not in meta["choices"]):
            raise error
        return value
    if hint is float and isinstance(value, str) and NUMBER_AS_TEXT.fullmatch(value):
        value = float(value)
    if isinstance(value, bool) or not isinstance(value, int | float) or (hint is int and isinstance(value, float)):
        raise error
    if hint is float:
        try:
            value = float(value)
        except OverflowError:  # a whole number beyond a float's range
            raise error from None
        if not math.isfinite(value):
            raise error
    elif abs(value) >= INTEGER_LIMIT:
        raise ParameterError(f"{key}: {value!r} does not fit 64 bits, which ROS 2 has for a whole number")
    if not _is_within(value, meta):
        raise error
    return value
