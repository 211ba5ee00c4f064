"""numba's cache in /tmp: code of others must not be run from it."""

from __future__ import annotations

import importlib.util
import os
import tempfile
from pathlib import Path

import pytest
from full_disk import full_disk

from auv_lse_common.support import compiled


@pytest.fixture
def nowhere_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A temporary folder, where neither the package nor the home can be written; returns the cache's usual folder."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(compiled.os, "access", lambda folder, mode: False)
    return tmp_path / f"auv_lse_numba_{os.getuid()}"


def chosen() -> Path:
    compiled._choose_cache_folder()
    return Path(os.environ.pop("NUMBA_CACHE_DIR"))


def test_the_folder_is_ours_alone_and_used_again(nowhere_else: Path) -> None:
    assert chosen() == nowhere_else
    assert nowhere_else.stat().st_mode & 0o777 == 0o700
    assert chosen() == nowhere_else


@pytest.mark.parametrize("kind", ["anyone writes", "of another", "a link", "a file"])
def test_a_folder_that_others_made_is_not_used(nowhere_else: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    if kind == "a link":
        (nowhere_else.parent / "theirs").mkdir()
        nowhere_else.symlink_to(nowhere_else.parent / "theirs")
    elif kind == "a file":
        nowhere_else.touch()
    else:
        nowhere_else.mkdir()
        nowhere_else.chmod(0o777 if kind == "anyone writes" else 0o700)
    if kind == "of another":
        real = Path.lstat

        def of_another(path: Path) -> os.stat_result:
            values = list(real(path))
            values[4] += 1
            return os.stat_result(values)

        monkeypatch.setattr(Path, "lstat", of_another)
    folder = chosen()
    assert folder != nowhere_else
    assert folder.is_dir()
    assert folder.stat().st_mode & 0o777 == 0o700


def test_a_read_only_package_lends_what_set_up_compiled(nowhere_else: Path, tmp_path: Path) -> None:
    made, folder = tmp_path / "package" / "__pycache__", nowhere_else
    made.mkdir(parents=True)
    for name in ("loops.nbi", "loops.nbc", "module.pyc"):
        (made / name).write_text("old")
    compiled._copy_cache(made, folder)
    assert {path.name for path in folder.iterdir()} == {"loops.nbi", "loops.nbc"}
    (folder / "loops.nbi").write_text("own")
    compiled._copy_cache(made, folder)
    assert (folder / "loops.nbi").read_text() == "own", "as new as set-up's"
    os.utime(made, (made.stat().st_mtime + 10, made.stat().st_mtime + 10))
    compiled._copy_cache(made, folder)
    assert (folder / "loops.nbi").read_text() == "old", "set up again since"
    compiled._copy_cache(made, tmp_path / "nowhere" / "cache")  # no position: nothing happens


def test_a_function_runs_although_the_disk_takes_no_code(tmp_path: Path) -> None:
    """A vehicle's disk may be full when a function is called for the first time."""
    pytest.importorskip("numba")
    package = tmp_path / "package"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "loops.py").write_text(
        "from auv_lse_common.support.compiled import compiled\n\n@compiled\ndef doubled(x):\n    return 2 * x\n"
    )
    spec = importlib.util.spec_from_file_location("package.loops", package / "loops.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    with full_disk(100):
        assert module.doubled(21) == 42


def test_what_set_up_compiled_is_used_under_every_path_of_the_same_file(tmp_path: Path) -> None:
    """colcon's symlinks lead to the sources, which the tests import directly: compiling takes half a minute."""
    pytest.importorskip("numba")
    package = tmp_path / "source" / "package"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "loops.py").write_text(
        "from auv_lse_common.support.compiled import compiled\n\n@compiled\ndef tripled(x):\n    return 3 * x\n"
    )
    (tmp_path / "built").symlink_to(tmp_path / "source")
    hits = []
    for folder in ("built", "source"):
        spec = importlib.util.spec_from_file_location("package.loops", tmp_path / folder / "package" / "loops.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        assert module.tripled(14) == 42
        hits.append(sum(module.tripled.stats.cache_hits.values()))
    assert hits == [0, 1]
