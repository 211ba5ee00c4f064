"""Which copy of the software runs, and what is refused of a mixture."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from auv_lse_common.support import installed_copy
from auv_lse_common.support.installed_copy import (
    COPY_VARIABLE,
    InstalledCopy,
    commit_of,
    copy_of,
    mixed_versions,
    note_software,
    own_copy,
    refuse_mixture,
)

ROOT = Path(__file__).resolve().parents[3]


def asked(site: Path, package: str) -> str:
    """The copy of a package that is installed in `site`, found by a Python that has nothing else."""
    code = f"from auv_lse_common.support.installed_copy import copy_of; print(*copy_of({package!r}), sep='|')"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(site), str(ROOT / "auv_lse_common")))}
    return subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    ).stdout.strip()


def test_a_checkout_has_its_version_folder_and_commit() -> None:
    copy = copy_of("auv_lse_common")
    assert copy is not None
    assert (copy.kind, copy.folder) == ("checkout", ROOT)
    assert copy.version[0].isdigit()
    if (ROOT / ".git").exists():
        assert len(commit_of(ROOT).removesuffix("-dirty")) >= 7
    assert copy_of("auv_lse_nobody") is None


def test_a_colcon_prefix_and_pip_are_told_apart(tmp_path: Path) -> None:
    site = tmp_path / "lib" / "python3.12" / "site-packages"
    (site / "auv_lse_odd").mkdir(parents=True)
    (site / "auv_lse_odd" / "__init__.py").touch()
    share = tmp_path / "share" / "auv_lse_odd"
    share.mkdir(parents=True)
    (share / "package.xml").write_text("<package><version>9.8.7</version></package>")
    assert asked(site, "auv_lse_odd") == f"9.8.7|colcon|{tmp_path}"
    info = site / "auv_lse_odd-1.2.3.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: auv_lse_odd\nVersion: 1.2.3\n")
    (info / "INSTALLER").write_text("pip\n")
    assert asked(site, "auv_lse_odd") == f"1.2.3|pip|{site}", "wheels bring package.xml, too"


def test_packages_of_several_versions_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    copies = {"a": InstalledCopy("0.2.0", "pip", Path("/p")), "b": InstalledCopy("0.3.0", "colcon", Path("/c"))}
    monkeypatch.setattr(installed_copy, "copy_of", copies.get)
    assert mixed_versions(["a", "nobody"]) == ""
    problem = mixed_versions(["a", "b"])
    assert "a 0.2.0 in /p; b 0.3.0 in /c. Install one version of all" in problem


def test_a_node_of_another_copy_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(COPY_VARIABLE, raising=False)
    refuse_mixture()  # started by hand
    monkeypatch.setenv(COPY_VARIABLE, own_copy())
    refuse_mixture()
    monkeypatch.setenv(COPY_VARIABLE, "0.1.0, pip: /elsewhere")
    with pytest.raises(ValueError, match="pip: /elsewhere, but this node is of another copy"):
        refuse_mixture()


def test_each_start_adds_a_line_to_the_run_folder(tmp_path: Path) -> None:
    note_software(tmp_path)
    note_software(tmp_path)
    lines = (tmp_path / "logs" / "software.txt").read_text().splitlines()
    assert len(lines) == 2
    assert f"auv_lse {own_copy()}" in lines[0]
