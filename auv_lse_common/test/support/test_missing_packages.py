"""Which packages count as installed."""

from pathlib import Path

import pytest

from auv_lse_common.support.missing_packages import is_installed, missing


def test_an_installed_package_without_a_file_of_its_own_counts_and_a_folder_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for package in ("installed_by_pip", "only_a_folder"):
        (tmp_path / package).mkdir()
    (tmp_path / "installed_by_pip-1.0.dist-info").mkdir()
    (tmp_path / "installed_by_pip-1.0.dist-info" / "METADATA").write_text("Name: installed_by_pip\nVersion: 1.0\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert is_installed("installed_by_pip")
    assert not is_installed("only_a_folder")
    assert not is_installed("nowhere_at_all")


def test_a_package_that_is_installed_but_does_not_load_is_not_called_missing() -> None:
    error = missing(ImportError("pyarrow requires NumPy 2.0 or newer, found 1.26.4"), "campaigns")
    wanted = "campaigns need a Python package that cannot be loaded: pyarrow requires NumPy 2.0 or newer, found 1.26.4"
    assert str(error) == wanted
    absent = missing(ModuleNotFoundError("No module named 'pyarrow'", name="pyarrow.parquet"), "campaigns")
    command = "pip install 'pyarrow<26'"
    assert str(absent) == f"campaigns need the Python package pyarrow, which is not installed: {command}"
