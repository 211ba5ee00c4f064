"""The completion script, in the shells themselves."""

from __future__ import annotations

import shutil
import subprocess

import pytest

from auv_lse_run.command import completion


def completed(script: str, *words: str) -> list[str]:
    """What bash offers for the last word of a command line."""
    line = " ".join(f"'{word}'" for word in ("auv_lse", *words))
    code = f"{script}\nCOMP_WORDS=({line}); COMP_CWORD={len(words)}; _auv_lse; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    return subprocess.run(["bash", "-c", code], capture_output=True, text=True, check=True).stdout.split()


@pytest.fixture(scope="module")
def script() -> str:
    return completion.script()


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (("mi",), ["mission"]),
        (("recover", "--"), ["--help"]),
        (("topics", "e"), ["echo"]),
        (("topics", "echo", "/x", "--on"), ["--once"]),
        (("abort", "--te"), ["--team"]),
        (("go", "--te"), []),
        (("fit", "--mean", ""), ["constant", "plane"]),
        (("completion", ""), ["--help", "bash", "zsh"]),
    ],
)
def test_bash_offers_verbs_subcommands_options_and_values(
    script: str, words: tuple[str, ...], offered: list[str]
) -> None:
    assert completed(script, *words) == offered


def test_zsh_reads_the_script(script: str) -> None:
    zsh = shutil.which("zsh")
    if zsh is None:
        pytest.skip("needs zsh")
    code = f"{completion._ZSH}{script}\nemulate sh; COMP_WORDS=(auv_lse fit --mean p); COMP_CWORD=3; _auv_lse"
    code += '\necho "${COMPREPLY[@]}"'  # zsh picks those that begin with the word itself
    done = subprocess.run([zsh, "-fc", code], capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["constant", "plane"], done.stderr
