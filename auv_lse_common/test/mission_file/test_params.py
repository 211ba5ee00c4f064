"""The strict loader: what it takes, and the words with which it refuses."""

from __future__ import annotations

import dataclasses
import typing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from auv_lse_common.mission_file.parameter_file import parameters_for, read_parameter_file, read_yaml
from auv_lse_common.mission_file.parameters import (
    ParameterError,
    describe,
    from_mapping,
    merge,
    nest,
    parameter,
    section,
    to_mapping,
)
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.table import SECTIONS, check_sections


@dataclass(frozen=True, slots=True, kw_only=True)
class Inner:
    gain: float = parameter(1.0, above=0.0, unit="m", help="a gain")


@dataclass(frozen=True, slots=True, kw_only=True)
class Outer:
    count: int = parameter(3, low=1, high=9, help="a count")
    total: int = parameter(3, help="a count without limits")
    name: str = parameter("a", choices=("a", "b"), help="a name")
    on: bool = parameter(False, help="a switch")
    angles: tuple[float, ...] = parameter((0.0,), low=-1.0, high=1.0, help="angles")
    zones: dict[str, tuple[float, ...]] = parameter({}, help="named polygons")
    limit: float | None = parameter(None, low=0.0, help="may be absent")
    inner: Inner = field(default_factory=Inner)


@dataclass(frozen=True, slots=True, kw_only=True)
class Needy:
    must: float = parameter(unit="s", low=0.0, help="no default")

    def __post_init__(self) -> None:
        if self.must == 13.0:
            raise ValueError("must is 13; choose any other number")


def test_defaults_and_values() -> None:
    assert from_mapping(Outer, {}, "x") == Outer()
    given_ = {"count": 5, "angles": [1, -1], "inner": {"gain": 2}, "zones": {"z": [1, 2.5]}, "limit": 4}
    config = from_mapping(Outer, given_, "x")
    assert config == Outer(count=5, angles=(1.0, -1.0), inner=Inner(gain=2.0), zones={"z": (1.0, 2.5)}, limit=4.0)
    assert isinstance(config.inner.gain, float)
    assert from_mapping(Outer, to_mapping(config), "x") == config


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"cuont": 5}, r"f: s\.cuont: unknown parameter \(value 5\); did you mean 'count'\?"),
        ({"count": 1, "5": None}, r"f: s\.5: unknown parameter \(value None\); .* write a decimal point"),
        ({"zebra": 5}, r"known: angles, count, inner, limit, name, on, total, zones"),
        ({"count": 10}, r"f: s\.count must be a whole number from 1 to 9, not 10"),
        ({"total": 2**63}, r"f: s\.total: 9223372036854775808 does not fit 64 bits"),
        ({"total": -(10**23)}, r"f: s\.total: -1"),
        ({"count": 2.0}, r"f: s\.count must be .*, not 2\.0"),
        ({"count": True}, r"f: s\.count must be .*, not True"),
        ({"name": "c"}, r"f: s\.name must be one of 'a', 'b', not 'c'"),
        ({"on": 1}, r"f: s\.on must be .*, not 1"),
        ({"angles": [0.0, 2.0]}, r"f: s\.angles\[1\] must be a number from -1 to 1, not 2\.0"),
        ({"angles": "0.0"}, r"f: s\.angles must be .*, not '0\.0'"),
        ({"inner": {"gain": 0.0}}, r"f: s\.inner\.gain must be a number above 0 m, not 0\.0"),
        ({"inner": {"gain": float("nan")}}, r"f: s\.inner\.gain must be .*, not nan"),
        ({"inner": {"gain": float("inf")}}, r"f: s\.inner\.gain must be .*, not inf"),
        ({"inner": {"gain": "1e999"}}, r"f: s\.inner\.gain must be .*, not '1e999'"),
        ({"inner": {"gain": "1.5"}}, r"f: s\.inner\.gain must be .*, not '1\.5'"),
        ({"limit": float("inf")}, r"f: s\.limit must be .*, not inf"),
        ({"count": "1e0"}, r"f: s\.count must be .*, not '1e0'"),
        ({"inner": 3}, r"f: s\.inner must be a mapping of parameters, not 3"),
        ({"zones": [1.0]}, r"f: s\.zones must map names to values, not \[1\.0\]"),
        ({"limit": -1.0}, r"f: s\.limit must be .*, not -1\.0"),
    ],
)
def test_invalid_values_are_rejected_by_name(mapping: dict[str, object], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        section(Outer, {"s": mapping}, "s", "f")


@pytest.mark.parametrize(("text", "value"), [("1e-3", 1e-3), ("2E5", 2e5), ("1.5e3", 1.5e3), ("+.5", 0.5)])
def test_numbers_that_yaml_1_1_reads_as_text(text: str, value: float) -> None:
    assert isinstance(yaml.safe_load(text), str)
    assert from_mapping(Inner, {"gain": yaml.safe_load(text)}, "f").gain == value


def test_missing_and_cross_checked() -> None:
    with pytest.raises(ParameterError, match=r"f\.must is missing; set it to a number of at least 0 s"):
        from_mapping(Needy, {}, "f")
    with pytest.raises(ParameterError, match=r"f\.must is 13; choose any other number"):
        from_mapping(Needy, {"must": 13.0}, "f")


def test_unknown_sections() -> None:
    check_sections({"gp": {}, "planner": {}}, "f")
    with pytest.raises(ParameterError, match=r"f: planer: unknown section; did you mean 'planner'\?"):
        check_sections({"planer": {}}, "f")


@given(st.dictionaries(st.from_regex(r"[a-z]{1,4}(\.[a-z]{1,4}x){0,2}", fullmatch=True), st.integers(), max_size=8))
def test_nest_keeps_every_leaf(flat: dict[str, int]) -> None:
    prefixes = {k for k in flat if any(other.startswith(k + ".") for other in flat)}
    flat = {k: v for k, v in flat.items() if k not in prefixes}

    def leaves(nested: dict[str, object], prefix: str = "") -> dict[str, object]:
        found: dict[str, object] = {}
        for key, value in nested.items():
            name = f"{prefix}{key}"
            found.update(leaves(value, name + ".") if isinstance(value, dict) else {name: value})
        return found

    assert leaves(nest(flat)) == flat


def test_a_section_and_its_dotted_names_are_one_whatever_their_order() -> None:
    """As in ROS. A dotted name before its section was lost without a word."""
    dotted, section = {"vehicle.start_east_m": 20.0}, {"vehicle": {"depth_m": 4.0}}
    for both in ({**dotted, **section}, {**section, **dotted}):
        assert nest(both) == {"vehicle": {"depth_m": 4.0, "start_east_m": 20.0}}
    assert section == {"vehicle": {"depth_m": 4.0}}, "the caller's mapping is unchanged"


def test_merge_is_deep_and_does_not_change_its_arguments() -> None:
    base = {"a": {"x": 1, "y": 2}, "b": 3}
    assert merge(base, {"a": {"y": 5}, "c": 4}) == {"a": {"x": 1, "y": 5}, "b": 3, "c": 4}
    assert base == {"a": {"x": 1, "y": 2}, "b": 3}


def test_node_parameters_follow_rcl_patterns(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(
        "/**: {ros__parameters: {a: 1, s.x: 2}}\n/auv1/**: {ros__parameters: {a: 5}}\n"
        "/auv1/gp_node: {ros__parameters: {s: {x: 9}}}\n"
    )
    patterns = read_parameter_file(path)
    assert parameters_for(patterns, "/auv1/gp_node") == {"a": 5, "s": {"x": 9}}
    assert parameters_for(patterns, "/auv2/gp_node") == {"a": 1, "s": {"x": 2}}
    assert parameters_for(patterns, "/auv11/gp_node") == {"a": 1, "s": {"x": 2}}


@pytest.mark.parametrize(
    ("pattern", "node", "matches"),
    [
        ("/**", "/gp_node", True),
        ("**", "/auv1/gp_node", True),
        ("/auv1/**", "/auv1/gp_node", True),
        ("/auv1/**", "/auv1/a/gp_node", True),
        ("auv1/**", "/auv1/gp_node", True),
        ("/auv1/*", "/auv1/gp_node", True),
        ("/auv1/*", "/auv1/a/gp_node", False),
        ("/*/gp_node", "/auv1/gp_node", True),
        ("/**/gp_node", "/auv1/gp_node", True),
        ("/**/gp_node", "/gp_node", True),
        ("/auv1", "/auv1/gp_node", False),
        ("/auv[1]/**", "/auv1/gp_node", False),
    ],
)
def test_star_matches_one_name_and_two_stars_any_number(pattern: str, node: str, matches: bool) -> None:
    assert parameters_for({pattern: {"a": 1}}, node) == ({"a": 1} if matches else {})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("- 1\n", "write a ROS 2 parameter file"),
        ("a: {b: 1}\n", "'a' must hold 'ros__parameters:' alone"),
        ("{", r"m.yaml: not valid YAML: line 1, column 2: expected the node content, but found '<stream end>'"),
        ("/**: {a: !!python/name:x 1}", "not valid YAML: line 1, column 10: could not determine a constructor"),
        (
            "/**:\n  ros__parameters: {}\n/**:\n",
            "not valid YAML: line 3, column 1: the key '/\\*\\*' appears twice",
        ),
        ("/**:\n  ros__parameters:\n    gp: {}\n    gp: {}\n", "line 4, column 5: the key 'gp' appears twice"),
        (
            "/**: {ros__parameters: {}}\n---\n/auv2/**: {ros__parameters: {}}\n",
            r"m.yaml: not valid YAML: line 2, column 1: a second document begins; join both, without the line '---'",
        ),
        ("/**: {ros__parameters: {}}\n...\na: 1\n", r"line 3, column 1: a second document begins; join both"),
        ("/**:\n\tros__parameters: {}\n", r"line 2, column 1: a tab indents the line; write blanks"),
        ("a: " + "{a: " * 3000 + "1" + "}" * 3000, "m.yaml: not valid YAML: nested too deeply"),
        ("/**: {ros__parameters: {a: {b: 010}}}", "YAML reads 010 in base 8; write the number without the zero in"),
        ("/**: {ros__parameters: {a: {b: -1:30}}}", "YAML reads -1:30 in base 60; write the number in one unit"),
        ("/**: {ros__parameters: {a: {b: 1:30.5}}}", "YAML reads 1:30.5 in base 60"),
    ],
)
def test_files_of_another_shape_are_rejected(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError, match=message):
        read_parameter_file(path)
    with pytest.raises(ParameterError, match="cannot be read: No such file"):
        read_parameter_file(tmp_path / "none.yaml")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le"])
def test_a_file_that_windows_wrote_is_read(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "mission.yaml"
    path.write_bytes("# Öresund\r\n/**:\r\n  ros__parameters: {mission: {name: Öland}}\r\n".encode(encoding))
    assert read_parameter_file(path) == {"/**": {"mission": {"name": "Öland"}}}


def test_a_file_in_another_encoding_is_refused_with_the_cure(tmp_path: Path) -> None:
    path = tmp_path / "mission.yaml"
    path.write_bytes("# Öresund\n/**:\n  ros__parameters: {}\n".encode("cp1252"))
    with pytest.raises(ParameterError, match=r"mission.yaml is not UTF-8 text: .*\. Save it as UTF-8$"):
        read_parameter_file(path)


def test_numbers_that_have_one_meaning_are_read(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_text("[0, 00, -0, 1_000, 0x10, 0.5, 00.5, '010', 10.0.0.1:14550, 2026-06-14T10:00:00Z]\n")
    assert read_yaml(path)[:9] == [0, 0, 0, 1000, 16, 0.5, 0.5, "010", "10.0.0.1:14550"]
    path.write_text("a: !!int ''\n")
    with pytest.raises(ParameterError, match="not valid YAML"):
        read_yaml(path)


def test_yaml_merge_key_may_be_overridden(tmp_path: Path) -> None:
    path = tmp_path / "m.yaml"
    path.write_text("x: &x {a: 1, b: 2}\ny: {<<: *x, b: 3}\n")
    assert read_yaml(path)["y"] == {"a": 1, "b": 3}


def test_describe_lists_every_parameter() -> None:
    rows = {row[0]: row for row in describe(Outer, "s.")}
    assert set(rows) == {"s.count", "s.total", "s.name", "s.on", "s.angles", "s.zones", "s.limit", "s.inner.gain"}
    assert rows["s.inner.gain"] == ("s.inner.gain", 1.0, "m", "above 0", "a gain")


def test_every_number_of_a_mission_file_has_two_limits() -> None:
    def unlimited(kind: type, prefix: str) -> list[str]:
        found, hints = [], typing.get_type_hints(kind)
        for each in dataclasses.fields(kind):
            if dataclasses.is_dataclass(hints[each.name]):
                found += unlimited(hints[each.name], f"{prefix}{each.name}.")
            elif hints[each.name] in (int, float, int | None, float | None):
                is_low = any(each.metadata.get(name) is not None for name in ("low", "above"))
                if not (is_low and each.metadata.get("high") is not None):
                    found.append(prefix + each.name)
        return found

    seeds = ["mission.seed", "sim.lake.seed"]
    assert [name for section, kind in SECTIONS.items() for name in unlimited(kind, f"{section}.")] == seeds


@pytest.mark.parametrize(
    ("section", "key", "value", "message"),
    [
        ("vehicle", "speed_mps", 1500.0, r"a number from 0\.05 to 30 m/s, not 1500"),
        ("vehicle", "start_heading_rad", 90.0, r"from -7 to 7 rad, not 90"),
        ("vehicle", "start_north_m", 1e300, r"from -10,000,000 to 10,000,000 m, not 1e\+300"),
    ],
)
def test_numbers_in_other_units_are_refused(section: str, key: str, value: float, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        from_mapping(SECTIONS[section], {key: value}, section)


@pytest.mark.parametrize(
    ("section", "key", "hint"),
    [
        ("motion", "speed_mps", r"did you mean vehicle\.speed_mps\?"),
        ("motion", "sound_speed_mps", r"did you mean positions\.sound_speed_mps or tdma\.sound_speed_mps\?"),
        ("motion", "turn_radius", r"did you mean 'turn_radius_m'\?"),
    ],
)
def test_a_parameter_of_another_section_is_named(section, key, hint):
    with pytest.raises(ParameterError, match=rf"{section}\.{key}: unknown parameter \(value 1\.0\); {hint}"):
        from_mapping(SECTIONS[section], {key: 1.0}, f"m.yaml: {section}")


def every_field(cls):
    for of in dataclasses.fields(cls):
        kind = typing.get_type_hints(cls)[of.name]
        yield pytest.param(cls, of.name, id=f"{cls.__name__}.{of.name}")
        if dataclasses.is_dataclass(kind):
            yield from every_field(kind)


@pytest.mark.parametrize(("cls", "name"), {p.id: p for cls in SECTIONS.values() for p in every_field(cls)}.values())
def test_a_value_of_the_wrong_type_in_python_is_named_with_what_is_wanted(cls, name):
    for wrong in (object(), {"a": object()}, [object()], 1j):
        with pytest.raises(ParameterError, match=rf"^{cls.__name__}\.{name} must be .*, not "):
            cls(**{name: wrong})


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"length_scale_m": "a"}, r"GpConfig.length_scale_m must be a number above 0 and at most 100,000 m, not 'a'"),
        ({"max_centers": 2.5}, r"GpConfig.max_centers must be a whole number from 1 to 100,000, not 2.5"),
        ({"noise_std_m": None}, r"GpConfig.noise_std_m must be a number above 0 and at most 1000 m, not None"),
        ({"merge": 1}, r"GpConfig.merge must be true or false, not 1"),
        ({"length_scale_m": -1}, r"GpConfig.length_scale_m must be a number above 0 and at most 100,000 m, not -1"),
        ({"rotation_deg": 181.0}, r"GpConfig.rotation_deg must be a number from -180 to 180 deg, not 181.0"),
        ({"mean": "flat"}, r"GpConfig.mean must be one of 'constant', 'plane', 'survey', not 'flat'"),
    ],
)
def test_the_error_of_a_wrong_value_reads_like_that_of_a_mission_file(values, message):
    with pytest.raises(ParameterError, match=message):
        GpConfig(**values)


def test_numbers_of_numpy_and_whole_numbers_of_metres_are_of_the_right_type():
    config = GpConfig(length_scale_m=np.float32(50.0), max_centers=np.int64(5), mean_depth_m=3)
    assert (config.length_scale_m, config.max_centers, config.mean_depth_m) == (50.0, 5, 3)
