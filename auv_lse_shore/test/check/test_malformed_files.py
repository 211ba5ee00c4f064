"""Mission files that nobody should write: each is a `ParameterError` that names the file, never another exception."""

import random
from pathlib import Path

import pytest

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.settings import Settings
from auv_lse_shore.areas.area_file import read_area
from auv_lse_shore.check.command import check
from auv_lse_shore.check.findings import Findings
from auv_lse_shore.check.mission_file import check_file

DEFAULT = Path(__file__).parents[3] / "config" / "missions" / "default.yaml"
HEAD = "/**:\n  ros__parameters:\n"
REFUSED = {
    "empty": "",
    "only a comment": "# a mission\n",
    "a number": "1\n",
    "a list": "- 1\n",
    "a set": "!!set {a, b}\n",
    "a Python object": "!!python/object/apply:os.system [echo]\n",
    "two documents": HEAD + "    gp: {}\n---\n" + HEAD,
    "a tab": "/**:\n\tros__parameters: {}\n",
    "nested without end": HEAD + "    gp: " + "[" * 3000 + "]" * 3000 + "\n",
    "itself": "/**: &a\n  ros__parameters: *a\n",
    "a list in itself": HEAD + "    area: {polygon_m: &a [*a]}\n",
    "a vehicle without body": HEAD + "    gp: {}\n/auv3/**:\n",
    "a vehicle's list": HEAD + "    gp: {}\n/auv3/**:\n  ros__parameters: [1]\n",
    "a vehicle's text": HEAD + "    gp: {}\n/auv3/**:\n  ros__parameters: deep\n",
    "vehicle 0": HEAD + "    gp: {}\n/auv0/**:\n  ros__parameters: {vehicle: {depth_m: 3.0}}\n",
    "a number for a pattern": "3:\n  ros__parameters: {}\n",
    "a number for a section": HEAD + "    3: 4\n",
    "a number for a parameter": HEAD + "    gp: {3: 4}\n",
    "a value for a section": HEAD + "    vehicle: 3\n",
    "a section that is a value too": HEAD + "    gp: 3\n    gp.kernel: wendland_c2\n",
    "a whole number beyond floats": HEAD + "    gp: {length_scale_m: " + "9" * 400 + "}\n",
    "a date that cannot be": HEAD + "    gp: {length_scale_m: 2020-99-99}\n",
    "an area of two corners": HEAD + "    area: {polygon_m: [0.0, 0.0, 1.0, 1.0]}\n",
    "an area that crosses itself": HEAD + "    area: {polygon_m: [0.0, 0.0, 9.0, 9.0, 9.0, 0.0, 0.0, 9.0]}\n",
}
VALUES = ("{}", "[]", "null", "1e400", "-1", ".nan", "'x'", "[1, [2]]", "{a: 1}", "true", "&a [*a]", "9" * 400)
VALUES += ("2020-01-01", "0x10", "\x00", "\ud800", "", "..", "~", "!!binary aGk=", "? a", "- b")
KEYS = ("mission", "gp", "planner", "area", "sim", "/auv3/**", "x", "ros__parameters", "1", "~")


def mutated(lines: list[str], rng: random.Random) -> bytes:
    """The file with one to three changes: lines gone, doubled, cut off, shifted; other values, keys, letters."""
    lines = list(lines)
    for _ in range(rng.randint(1, 3)):
        at, what = rng.randrange(len(lines)), rng.randrange(7)
        line = lines[at]
        if what == 0 and len(lines) > 1:
            del lines[at]
        elif what == 1:
            lines.insert(at, rng.choice(lines))
        elif what == 2:
            lines[at] = f"{line.split(':')[0]}: {rng.choice(VALUES)}\n"
        elif what == 3:
            lines[at] = line[: rng.randrange(len(line) + 1)]
        elif what == 4:
            lines[at] = " " * rng.randrange(6) + line.lstrip()
        elif what == 5:
            lines.insert(at, " " * rng.randrange(8) + f"{rng.choice(KEYS)}: {rng.choice(VALUES)}\n")
        elif line:
            i = rng.randrange(len(line))
            lines[at] = line[:i] + chr(rng.choice((0, 9, 34, 39, 58, 123, 91, 42, 38, 33, 255, 8232))) + line[i + 1 :]
    return "".join(lines).encode("utf8", "surrogatepass")


@pytest.mark.parametrize("name", REFUSED)
def test_a_file_that_cannot_be_a_mission_is_refused_in_words(tmp_path, name):
    file = tmp_path / "mission.yaml"
    file.write_text(REFUSED[name])
    with pytest.raises(
        ParameterError, match=r"must|write|give|not valid YAML|known:|has no area|no vehicle 0|cannot be|crosses itself"
    ):
        Settings.load(file, read_area=read_area)
    try:
        errors = check(file).count("error")
    except ParameterError:  # not a ROS 2 parameter file
        return
    assert errors > 0


def test_bytes_that_are_no_text_are_refused(tmp_path):
    file = tmp_path / "mission.yaml"
    file.write_bytes(bytes(range(256)))
    with pytest.raises(ParameterError, match=r"mission.yaml is not UTF-8 text"):
        Settings.load(file, read_area=read_area)


def test_four_hundred_mutated_mission_files_are_read_or_refused_in_words(tmp_path):
    rng, file, refused = random.Random(1), tmp_path / "mission.yaml", 0
    lines = DEFAULT.read_text().splitlines(keepends=True)
    for _ in range(400):
        file.write_bytes(mutated(lines, rng))
        findings, loads = Findings(), True
        try:
            Settings.load(file, read_area=read_area)
        except ParameterError:
            refused += 1
            loads = False
        try:
            check_file(file, findings, read_area)
        except ParameterError:
            assert not loads
        else:
            assert not loads or not findings.count("error")
            assert loads or findings.count("error"), "what the loader refuses is an error"
    assert 250 < refused < 400  # the rest are missions, too
