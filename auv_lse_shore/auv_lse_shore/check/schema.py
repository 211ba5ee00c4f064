"""The JSON schema of mission files for editors, and a commented template."""

import dataclasses
import json
import textwrap
import types
import typing
from typing import Any

from auv_lse_common.mission_file.parameters import describe
from auv_lse_common.mission_file.sections.table import SECTIONS, VEHICLE_SECTIONS

_COLUMNS = 118

_HEAD = """\
# yaml-language-server: $schema=../mission.schema.json
# A mission file with every parameter. Lines with a `#` in the first column hold defaults. To set a parameter, replace
# that `#` by a blank, in the line of its section too. Then: auv_lse check MISSION.yaml
# Made by: auv_lse check --template
"""


def schema() -> dict[str, Any]:
    """The JSON schema (draft 7) of a mission file."""
    sections = {name: _of_class(cls) for name, cls in SECTIONS.items()}
    shared = {"type": "object", "required": ["ros__parameters"], "additionalProperties": False}

    def body(names: typing.Iterable[str]) -> dict[str, Any]:
        known = {name: {"$ref": f"#/definitions/{name}"} for name in names}
        dotted: dict[str, Any] = {"^(" + "|".join(known) + r")\.": {}}  # ROS also allows gp.kernel
        known["use_sim_time"] = {"type": "boolean"}
        parameters = {
            "type": ["object", "null"],
            "properties": known,
            "patternProperties": dotted,
            "additionalProperties": False,
        }
        return {**shared, "properties": {"ros__parameters": parameters}}

    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "Mission file of auv_lse: a ROS 2 parameter file",
        "type": "object",
        "minProperties": 1,
        "patternProperties": {
            r"^/?\*\*$": {"description": "for every node", **body(SECTIONS)},
            r"^/?auv[1-9]\d*/\*\*$": {"description": "for one vehicle", **body(VEHICLE_SECTIONS)},
        },
        "additionalProperties": False,
        "definitions": sections,
    }


def schema_text() -> str:
    """The schema as the text of config/mission.schema.json."""
    return json.dumps(schema(), indent=1, ensure_ascii=False) + "\n"


def _of_class(cls: type) -> dict[str, Any]:
    hints = typing.get_type_hints(cls)
    properties = {f.name: _of_field(hints[f.name], f) for f in dataclasses.fields(cls) if f.init}
    about = (cls.__doc__ or "").strip().splitlines()[0]
    return {"type": "object", "description": about, "properties": properties, "additionalProperties": False}


def _of_field(hint: Any, field: dataclasses.Field[Any]) -> dict[str, Any]:
    if dataclasses.is_dataclass(hint):
        return _of_class(typing.cast(type, hint))
    meta = field.metadata
    found = _of_type(hint, meta)
    text = str(meta.get("help", ""))
    found["description"] = f"{text} ({meta['unit']})" if meta.get("unit") else text
    default = field.default
    if default is not dataclasses.MISSING and default is not None:
        found["default"] = list(default) if isinstance(default, tuple) else default
    return found


def _of_type(hint: Any, meta: typing.Mapping[str, Any]) -> dict[str, Any]:
    origin = typing.get_origin(hint)
    if origin in (typing.Union, types.UnionType):
        return _of_type(next(a for a in typing.get_args(hint) if a is not type(None)), meta)
    if origin is tuple:
        return {"type": "array", "items": _of_type(typing.get_args(hint)[0], meta)}
    if origin is dict:
        return {"type": "object", "additionalProperties": _of_type(typing.get_args(hint)[1], meta)}
    names = {bool: "boolean", int: "integer", float: "number", str: "string"}
    found: dict[str, Any] = {"type": names[hint]}
    if meta.get("choices"):
        found["enum"] = list(meta["choices"])
    limits = (("low", "minimum"), ("high", "maximum"), ("above", "exclusiveMinimum"))
    found.update({word: meta[name] for name, word in limits if meta.get(name) is not None})
    return found


def template_text() -> str:
    """config/missions/template.yaml: every parameter with default, unit, range and meaning."""
    lines = [*_HEAD.splitlines(), "/**:", "  ros__parameters:"]
    for name, cls in SECTIONS.items():
        about = (cls.__doc__ or "").strip().splitlines()[0]
        lines += ["", f"    # {about}", _at(2, f"{name}:", commented=name != "mission")]
        level: list[str] = []
        for path, default, unit, allowed, meaning in describe(cls, ""):
            *parents, leaf = path.split(".")
            if parents and parents != level:
                lines.append(_at(2 + len(parents), f"{parents[-1]}:"))
            level = parents
            about = "; ".join(part for part in (meaning, unit and f"in {unit}", allowed and f"({allowed})") if part)
            kept = (name, path) == ("mission", "vehicles")
            lines += _parameter(3 + len(parents), f"{leaf}: {_value(default)}", about, commented=not kept)
    lines += ["", f"# One vehicle's own values, in the sections {', '.join(VEHICLE_SECTIONS)}.", "/auv1/**:"]
    lines += ["  ros__parameters:", "    vehicle: {depth_m: 3.0}"]
    return "\n".join(line.rstrip() for line in lines) + "\n"


def _at(level: int, text: str, commented: bool = True) -> str:
    indent = "  " * level
    return ("#" + indent[1:] if commented else indent) + text


def _parameter(level: int, text: str, about: str, commented: bool) -> list[str]:
    """A parameter, with its meaning in the same line if it fits."""
    line = f"{_at(level, text, commented):34}  # {about}"
    if len(line) <= _COLUMNS:
        return [line]
    indent = "  " * level
    meaning = textwrap.wrap(about, _COLUMNS - len(indent) - 2, break_on_hyphens=False)
    return [*(f"{indent}# {part}" for part in meaning), _at(level, text, commented)]


def _value(default: Any) -> str:
    if default is None:
        return ""
    return json.dumps(list(default) if isinstance(default, tuple) else default, ensure_ascii=False)
