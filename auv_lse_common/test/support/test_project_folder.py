"""Where the project's folder is taken from."""

from pathlib import Path

from auv_lse_common.support.project_folder import project_folder


def test_environment_variable_precedes_the_source_tree(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setenv("AUV_LSE_ROOT", str(tmp_path))
    assert project_folder() == tmp_path
    monkeypatch.delenv("AUV_LSE_ROOT")
    assert (project_folder() / "config" / "missions" / "default.yaml").is_file()


def test_installed_package_uses_the_working_directory(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.delenv("AUV_LSE_ROOT", raising=False)
    installed = tmp_path / "lib" / "python" / "auv_lse_common" / "project_folder.py"
    monkeypatch.setattr("auv_lse_common.support.project_folder.__file__", str(installed))
    monkeypatch.chdir(tmp_path)
    assert project_folder() == tmp_path
