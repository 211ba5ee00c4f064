"""The documentation names only what exists, wraps, and cites nothing from outside of the project."""

import argparse
import ast
import functools
import importlib
import importlib.metadata
import importlib.util
import re
import shlex
import subprocess
from collections import defaultdict
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from auv_lse_common.mission_file.parameters import describe
from auv_lse_common.mission_file.sections.table import SECTIONS
from auv_lse_run.command import parsing
from auv_lse_run.command.find_verbs import PACKAGE_OF, find_verbs
from auv_lse_run.command.main import main as auv_lse
from auv_lse_shore.reference_pages.__main__ import BLOCKS
from auv_lse_shore.reference_pages.blocks import block_names, outdated, render
from auv_lse_shore.reference_pages.commands import parser_of
from benchmarks import licences

ROOT = Path(__file__).resolve().parents[3]
PACKAGES = sorted(folder.parent for folder in ROOT.glob("auv_lse_*/package.xml"))
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
COLUMNS = 120

#: Names in a changelog may be gone.
LIVING = [page for page in PAGES if page.name != "CHANGELOG.md"]
#: A worked example also names what it adds.
SETTLED = [page for page in LIVING if not page.name.startswith("adding-")]

#: What looks like a parameter, as `packet.py` does, and is a file.
NOT_PARAMETERS = re.compile(r"\.(py|md|yaml|json|geojson|html|msg)$")


def pages(of):
    return pytest.mark.parametrize("page", of, ids=[page.relative_to(ROOT).as_posix() for page in of])


def prose(page):
    """(line number, text) of each line outside of code blocks."""
    fenced = listed = False
    for number, line in enumerate(page.read_text().splitlines(), 1):
        if line.startswith("```"):
            fenced = not fenced
            continue
        listed = bool(re.match(r"\s*([-*]|\d+\.) ", line)) or (listed and line.startswith(" "))
        if not fenced and (listed or not line.startswith("    ")):
            yield number, line


def code_spans(page):
    """What stands in backticks, on one line."""
    return [span for _, line in prose(page) for span in re.findall(r"`([^`]+)`", line)]


def sources():
    """Every Python file of the project but its tests."""
    folders = [package / package.name for package in PACKAGES] + [ROOT / "benchmarks"]
    return [file for folder in folders for file in sorted(folder.rglob("*.py"))]


def files_of_tests():
    return [file for package in PACKAGES for file in sorted((package / "test").rglob("*.py"))]


def project_files():
    """Text files that a reader opens: pages, configuration, scripts, messages and code, without tests."""
    kept = [ROOT / "pyproject.toml", *PAGES, *sources()]
    kept += [file for name in ("config", "scripts", ".ci") for file in (ROOT / name).rglob("*") if file.is_file()]
    for package in PACKAGES:
        kept += [*package.glob("msg/*.msg"), *package.glob("launch/*.py"), *package.glob("*.xml")]
    return kept


@pytest.fixture(scope="module")
def attributes():
    """{class: names of its methods and attributes, those of its bases in the project included}."""
    found = defaultdict(set)
    bases = defaultdict(set)
    for file in [*sources(), *files_of_tests()]:
        for node in ast.walk(ast.parse(file.read_text())):
            if not isinstance(node, ast.ClassDef):
                continue
            bases[node.name] |= {base.id for base in node.bases if isinstance(base, ast.Name)}
            found[node.name] |= set()
            for part in ast.walk(node):
                if isinstance(part, ast.FunctionDef):
                    found[node.name].add(part.name)
                elif isinstance(part, ast.AnnAssign | ast.Assign):
                    targets = [part.target] if isinstance(part, ast.AnnAssign) else part.targets
                    for target in targets:
                        if isinstance(target, ast.Name):
                            found[node.name].add(target.id)
                        elif isinstance(target, ast.Attribute):
                            found[node.name].add(target.attr)
    for name in found:
        found[name] |= {attribute for base in bases[name] for attribute in found.get(base, ())}
    return dict(found)


@pages(PAGES)
def test_lines_wrap(page):
    text = ((number, re.sub(r"\]\([^)]*\)", "]", line)) for number, line in prose(page) if not line.startswith("|"))
    long = [f"{page.name}:{number}: {len(line)} columns" for number, line in text if len(line) > COLUMNS]
    assert not long, long


def test_the_citation_file_names_the_version_of_the_packages():
    """Its schema (1.2.0) is checked by cffconvert, by hand: the file changes only with a release."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation.keys() >= {"cff-version", "message", "title", "authors", "version", "license", "references"}
    for package in PACKAGES:
        assert f"<version>{citation['version']}</version>" in (package / "package.xml").read_text()


def anchor(heading):
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


@pages(PAGES)
def test_links_lead_somewhere(page):
    for number, line in prose(page):
        for target in re.findall(r"\]\(([^)\s]+)\)", line):
            if re.match(r"[a-z]+:", target):
                continue
            name, _, section = target.partition("#")
            file = (page.parent / name).resolve() if name else page
            assert file.exists(), f"{page.name}:{number}: {target}"
            if page.is_relative_to(ROOT / "docs"):
                assert file.is_relative_to(ROOT / "docs"), f"{page.name}:{number}: {target} is not part of the site"
            if section:
                headings = [anchor(line.lstrip("#")) for line in file.read_text().splitlines() if line.startswith("#")]
                assert section in headings, f"{page.name}:{number}: {target}"


def test_every_figure_is_on_a_page():
    shown = {name for page in PAGES for name in re.findall(r"figures/([\w.]+)\)", page.read_text())}
    assert {file.name for file in (ROOT / "docs" / "figures").iterdir()} == shown


def test_nothing_outside_of_the_project_is_cited():
    banned = re.compile(r"\b(PAPER|DESIGN|STYLE)\.md\b|\.\./shared")
    found = [
        f"{file.relative_to(ROOT)}:{number}: {line.strip()}"
        for file in project_files()
        for number, line in enumerate(file.read_text(errors="replace").splitlines(), 1)
        if banned.search(line)
    ]
    assert not found, "\n".join(found)


def test_every_own_type_has_a_reason_why_no_standard_one_fits():
    section = (ROOT / "docs" / "reference" / "topics.md").read_text().partition("## Why own types\n")[2]
    rows = re.findall(r"^\| (`.+`) \| (\w.+) \|$", section, re.MULTILINE)
    named = [name for names, _ in rows for name in re.findall(r"`(\w+)`", names)]
    interfaces = [*ROOT.glob("auv_lse_msgs/msg/*.msg"), *ROOT.glob("auv_lse_msgs/srv/*.srv")]
    assert sorted(named) == sorted(path.stem for path in interfaces)


def test_the_page_of_the_python_api_shows_every_example():
    """`test_examples.py` runs them."""
    page = (ROOT / "docs" / "reference" / "python-api.md").read_text()
    examples = sorted(file.name for file in (ROOT / "docs" / "reference" / "python").iterdir())
    assert len(examples) >= 4
    assert [name for name in examples if f"](python/{name})" not in page] == []


def words(*patterns, code=True):
    """Words in pages: what has a letter or a digit, so that a table's bars do not count. Blocks of code if wanted."""
    files = {file for pattern in patterns for file in ROOT.glob(pattern)}
    assert files
    texts = [file.read_text() if code else "\n".join(line for _, line in prose(file)) for file in files]
    return sum(len(re.findall(r"\S*\w\S*", text)) for text in texts)


@pytest.mark.parametrize(
    ("most", "patterns"),
    [
        (1_200, ["README.md"]),
        (25_000, ["docs/guide/**/*.md", "docs/reference/**/*.md"]),
        *((2_000, [f"docs/design/{page.name}"]) for page in sorted((ROOT / "docs" / "design").glob("*.md"))),
        *((2_000, [f"docs/extending/{page.name}"]) for page in sorted((ROOT / "docs" / "extending").glob("*.md"))),
    ],
    ids=str,
)
def test_pages_are_short(most, patterns):
    assert words(*patterns) <= most


def test_the_reference_is_short():
    assert words("docs/reference/**/*.md", code=False) <= 12_000


@pytest.mark.ros  # the commands' modules import ROS
def test_generated_tables_are_those_of_the_code():
    pages = outdated(ROOT / "docs", BLOCKS)
    assert not pages, f"python -m auv_lse_shore.reference_pages --write: {', '.join(map(str, pages))}"


def helps(parser):
    """The help of a command and of its subcommands."""
    yield parser.format_help()
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for own in action.choices.values():
                yield from helps(own)


@pytest.mark.parametrize(
    "verb", [verb for verb in find_verbs()[0].values() if verb.name in PACKAGE_OF], ids=lambda verb: verb.name
)
def test_the_help_of_every_command_lists_its_exit_codes(verb):
    assert [text for text in helps(parser_of(verb)) if "Exit codes: 0" not in text] == []


def options(parser):
    """The options of a command and of its subcommands."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for own in action.choices.values():
                yield from options(own)
        elif action.option_strings:
            yield action


@pytest.mark.parametrize(
    "verb", [verb for verb in find_verbs()[0].values() if verb.name in PACKAGE_OF], ids=lambda verb: verb.name
)
def test_a_flag_means_the_same_in_every_command(verb):
    meanings = {"--domain": r"N ROS domain", "--rate": r"X .*speed", "--out": r"(DIR|FILE) "}
    for action in options(parser_of(verb)):
        for name in set(action.option_strings) & set(meanings):
            assert re.match(meanings[name], f"{action.metavar} {action.help}"), (name, action.metavar, action.help)


def test_every_generated_table_has_a_page_and_is_current():
    shown = [name for page in PAGES for name in block_names(page.read_text())]
    assert sorted(shown) == sorted(BLOCKS)
    without_ros = {name: BLOCKS[name] for name in BLOCKS if name != "commands"} | {"commands": lambda: ""}
    for page in PAGES:
        if "commands" not in block_names(text := page.read_text()):
            assert render(text, without_ros) == text, f"python -m auv_lse_shore.reference_pages --write: {page.name}"


def evidence_commands():
    """Every command that prints a figure in docs/evidence, with its arguments."""
    text = "\n".join(page.read_text() for page in (ROOT / "docs" / "evidence").glob("*.md"))
    found = re.findall(r"`((?:python -m |auv_lse |scripts/)[^`]+)`", text)
    return sorted({" ".join(command.split()) for command in found})


def verb_of(words):
    """The verb and the arguments of a command line of auv_lse, or of a script."""
    name = words[0].removeprefix("scripts/")
    return words[1:] if name in ("auv_lse", "run") else [name, *words[1:]]


class Parsed(Exception):
    """The command line was accepted."""


@pytest.mark.parametrize("command", evidence_commands())
def test_the_commands_of_the_evidence_are_accepted(command, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    words = [{"FILE": str(tmp_path / "file"), "FOLDER": str(tmp_path)}.get(word, word) for word in shlex.split(command)]
    for where, name in ((argparse.ArgumentParser, "parse_args"), (parsing, "parsed")):
        parse = getattr(where, name)

        def accepted(*given, parse=parse):
            parse(*given)
            raise Parsed

        monkeypatch.setattr(where, name, accepted)
    if words[0] == "python":
        module, arguments = words[2], words[3:]
    else:
        with pytest.raises(Parsed):
            auv_lse(verb_of(words))
        return
    package = importlib.import_module(module)
    main = package.main if hasattr(package, "main") else importlib.import_module(f"{module}.__main__").main
    with pytest.raises(Parsed):
        main(arguments)


@pytest.mark.skipif(not (ROOT / ".venv-docs" / "setup.done").is_file(), reason="scripts/docs has not been called here")
def test_the_site_builds_without_a_broken_link():
    built = subprocess.run([ROOT / "scripts" / "docs"], capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr


def test_the_site_shows_every_page():
    site = yaml.safe_load((ROOT / "config" / "site" / "mkdocs.yml").read_text())

    def pages_of(entry):
        if isinstance(entry, str):
            return [entry]
        parts = entry.values() if isinstance(entry, dict) else entry
        return [page for part in parts for page in pages_of(part)]

    present = [page.relative_to(ROOT / "docs").as_posix() for page in (ROOT / "docs").rglob("*.md")]
    assert sorted(pages_of(site["nav"])) == sorted(present)


@functools.cache
def known_ends():
    """Every file of the checkout by its path and all ends of it; not those of environment and build."""
    parts = [part for part in ROOT.iterdir() if part.is_dir() and part.name[0] != "." and part.name != "ros_ws"]
    found = [file.relative_to(ROOT).parts for part in parts for file in part.rglob("*") if file.is_file()]
    found += [(file.name,) for file in ROOT.iterdir()]
    return {"/".join(names[start:]) for names in found for start in range(len(names))}


@pages(SETTLED)
def test_files_that_are_named_exist(page):
    """`auv_lse_gp/level_set/bayes_risk.py` and `bayes_risk.py` name the same file."""
    for span in code_spans(page):
        for name in re.findall(r"(?<![\w/.*~])[\w./-]*\w\.(?:py|msg|toml|sh)\b", span):
            if name.startswith("/"):
                continue
            assert name in known_ends(), f"{page.name}: `{span}`"
        for name in re.findall(r"(?<![\w/.])((?:docs|config|scripts|benchmarks|auv_lse_\w+)/[\w./*-]+)", span):
            if "*" not in name:
                path = name.rstrip("/.")
                package = path.split("/")[0]
                candidates = [ROOT / path, ROOT / package / path]
                assert any(candidate.exists() for candidate in candidates), f"{page.name}: `{span}`"


@pages(SETTLED)
def test_modules_that_are_named_exist(page):
    """`auv_lse_gp.OnlineGp` and `python -m benchmarks.gp`: modules, and what they hold."""
    for name in re.findall(r"\b(?:auv_lse_\w+|benchmarks)(?:\.\w+)+\b(?![./]\w)", page.read_text()):
        if NOT_PARAMETERS.search(name):
            continue
        parts = name.split(".")
        depth = len(parts)
        while depth > 1 and not found(".".join(parts[:depth])):
            depth -= 1
        module = ".".join(parts[:depth])
        if parts[depth:] and not module.endswith("_node"):
            holder = importlib.import_module(module)
            for part in parts[depth:]:
                assert hasattr(holder, part), f"{page.name}: {name}"
                holder = getattr(holder, part)


def found(module):
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:
        return False


@pages(LIVING)
def test_scripts_that_are_named_exist(page):
    for name in re.findall(r"(?<![\w/.-])scripts/(\w[\w.-]*\w)", page.read_text()):
        assert (ROOT / "scripts" / name).is_file(), f"{page.name}: scripts/{name}"


@pages(SETTLED)
def test_parameters_that_are_named_exist(page):
    """`planner.horizon`, and what is given to --set and in param set."""
    names = {row[0] for name, cls in SECTIONS.items() for row in describe(cls, f"{name}.")}
    groups = {".".join(name.split(".")[:depth]) for name in names for depth in range(1, name.count(".") + 1)}
    modules = {file.stem for file in sources()}
    text = page.read_text()
    spans = [*code_spans(page), *re.findall(r"--set (\S+)", text), *re.findall(r"param set \S+ (\S+)", text)]
    for span in spans:
        for name in re.findall(rf"(?<![\w./])(?:{'|'.join(SECTIONS)})(?:\.\w+)+", span):
            if NOT_PARAMETERS.search(name) or name.split(".")[1] in modules or name.split(".")[1][0].isupper():
                continue
            if f"{name}*" in span:  # `area.origin_*` names all that begin so
                assert any(known.startswith(name) for known in names), f"{page.name}: `{span}`"
                continue
            assert name in names or name in groups, f"{page.name}: `{span}`"


@pages(SETTLED)
def test_classes_that_are_named_have_what_is_named(page, attributes):
    """`VehiclePlanner.decide`: a class of the project, and its method or attribute."""
    for span in code_spans(page):
        for name, attribute in re.findall(r"(?<![\w./])([A-Z]\w*[a-z]\w*)\.(\w+)", span):
            assert name in attributes, f"{page.name}: `{span}`"
            assert attribute in attributes[name], f"{page.name}: `{span}`"


@pages(SETTLED)
def test_functions_and_classes_that_are_named_alone_exist(page):
    """`expected_bayes_risk(...)`, `test_it_telescopes`, `PathReward`: defined somewhere in the project, or imported."""
    text = "\n".join(file.read_text() for file in [*sources(), *files_of_tests()])
    words = set(re.findall(r"\w+", text))
    words |= {file.stem for file in [*sources(), *files_of_tests(), *ROOT.glob("auv_lse_msgs/msg/*.msg")]}
    for span in code_spans(page):
        for name in re.findall(r"^(\w+)\(|\b(test_\w+)\b|^([A-Z][a-z]+(?:[A-Z][a-z]+)+)$", span):
            word = next(part for part in name if part)
            assert word in words, f"{page.name}: `{span}`"


def test_the_list_of_licences_and_the_hashes_have_every_pinned_package():
    pinned = set(licences.pins())
    listed = re.findall(r"^([\w.-]+)==(\S+)  \S", (ROOT / "config" / "licences.txt").read_text(), re.M)
    assert set(listed) == pinned, "python -m benchmarks.licences > config/licences.txt"
    entries = [entry for name in ("locked.txt", "locked-ros.txt") for entry in locked(name)]
    hashed = {(name, version) for name, version, marker in entries if marker != " ; sys_platform == 'win32'"}
    assert hashed == {(name.lower().replace("_", "-").replace(".", "-"), version) for name, version in pinned}
    assert len(entries) == len({name for name, _, _ in entries}), "a package is in one of the two files"


def locked(name):
    """Package, version and marker of each entry of a lock file, each of which has a hash."""
    text = (ROOT / "config" / name).read_text()
    entries = re.findall(r"^([\w.-]+)==(\S+)( ; [^\\]+)? \\\n    --hash=sha256:[0-9a-f]{64}", text, re.M)
    assert len(entries) == len(re.findall(r"^[^#\s]", text, re.M)), "each has a hash"
    return entries


def test_the_lock_file_has_all_that_the_stack_needs_and_all_that_builds_it():
    """`scripts/setup` installs without dependencies, and builds source packages without an environment of their own."""
    has = {name for name, _, _ in locked("locked.txt")}
    wanted, seen = re.findall(r"^[\w.-]+", (ROOT / "config" / "requirements.txt").read_text(), re.M), set()
    while wanted:
        requirement = Requirement(wanted.pop())
        name = canonicalize_name(requirement.name)
        if name in seen or (requirement.marker and not requirement.marker.evaluate({"extra": ""})):
            continue
        seen.add(name)
        assert name in has, f"config/locked.txt lacks {name}"
        wanted += importlib.metadata.requires(name) or []
    assert "setuptools" in seen
    setup = (ROOT / "scripts" / "setup").read_text()
    installs = re.findall(r"pip install.*", setup)
    assert len(installs) == 1, installs
    assert "--require-hashes --no-deps" in installs[0]
    calls = re.findall(r'"\$\{pip\[@\]\}".*', setup)
    assert [("build-tools.txt" in call, "--no-build-isolation" in call) for call in calls] == [(1, 0), (0, 1)]
