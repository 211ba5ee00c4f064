"""`scripts/faults all`: a row for each kind, also for one that breaks and one that Ctrl-C interrupts."""

from types import SimpleNamespace

import pytest

from benchmarks.faults import __main__ as faults
from benchmarks.faults.report import Report


def kind(outcome, *, small=("--size", "2")):
    """A module of a kind of faults whose run returns or raises `outcome`."""
    made = SimpleNamespace(seen=[], arguments=lambda parser: parser.add_argument("--size", type=int, default=99))

    def run(options, folder, say):
        made.seen.append((options.size, options.seed, folder.name))
        if isinstance(outcome, BaseException):
            raise outcome
        return outcome

    made.run = run
    if small is not None:
        made.SMALL = small
    return made


@pytest.fixture
def kinds(monkeypatch):
    def set_kinds(**modules):
        monkeypatch.setattr(faults, "KINDS", dict.fromkeys(modules, "a kind"))
        monkeypatch.setattr(faults, "_kind", modules.__getitem__)

    return set_kinds


def test_all_runs_every_small_kind_and_prints_one_table(kinds, capsys):
    disk, soak = kind(Report(["a line"], tried=20, survived=20, worst_recovery_s=1.5)), kind(None, small=None)
    kinds(disk=disk, soak=soak, kills=kind(Report([], tried=5, survived=5)))
    assert faults.main(["all", "--seed", "7"]) == 0
    out = capsys.readouterr().out
    assert disk.seen == [(2, 7, "disk")]
    assert soak.seen == []
    assert "a line" in out
    assert "soak" not in out
    assert "| disk | 20 | 20 | 1.5 s | nothing |" in out
    assert "| all | 25 | 25 | 1.5 s | nothing |" in out


def test_a_kind_that_breaks_is_a_row_and_the_others_still_run(kinds, capsys):
    kinds(disk=kind(RuntimeError("no tmpfs")), kills=kind(Report([], tried=5, survived=4, lost=["a slot"])))
    assert faults.main(["all"]) == 1
    out = capsys.readouterr().out
    assert "| disk | 1 | 0 | - | RuntimeError: no tmpfs |" in out
    assert "| kills | 5 | 4 | - | a slot |" in out
    assert "| all | 6 | 4 | - | 2 |" in out


def test_ctrl_c_prints_what_there_is(kinds, capsys):
    last = kind(Report([], tried=1, survived=1))
    kinds(disk=kind(Report([], tried=20, survived=20)), kills=kind(KeyboardInterrupt()), water=last)
    assert faults.main(["all"]) == 130
    out = capsys.readouterr().out
    assert "| disk | 20 | 20 | - | nothing |" in out
    assert "| kills | 0 | 0 | - | interrupted |" in out
    assert last.seen == []


def test_every_kind_accepts_its_small_size():
    small = faults._small()
    assert {"kills", "water"} <= set(small)
    for name, arguments in small.items():
        faults.parser().parse_args([name, *arguments])
