"""Files that are written completely or not at all."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Collection
from pathlib import Path

import pytest

from auv_lse_common.support import atomic_files
from auv_lse_common.support.atomic_files import check_file, check_folder, write_whole, written_whole
from auv_lse_common.support.ending_signals import SIGNALS


def _begin_and_raise(path: Path, error: BaseException) -> None:
    path.write_text("new")
    raise error


def _write_all(folder: Path, names: str, obsolete: Collection[str] = ()) -> None:
    with written_whole(folder, obsolete) as part:
        for name in names:
            (part / name).write_text("new")


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left on device")])
def test_an_interrupted_folder_stays_as_it_was(tmp_path: Path, error: BaseException) -> None:
    (tmp_path / "old").write_text("old")
    with pytest.raises(type(error)), written_whole(tmp_path) as part:
        _begin_and_raise(part / "old", error)
    assert [path.name for path in tmp_path.iterdir()] == ["old"]
    assert (tmp_path / "old").read_text() == "old"


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left on device")])
def test_an_interrupted_folder_that_was_missing_is_missing(tmp_path: Path, error: BaseException) -> None:
    with pytest.raises(type(error)), written_whole(tmp_path / "a" / "b") as part:
        _begin_and_raise(part / "file", error)
    assert not list(tmp_path.iterdir())


def test_an_error_names_the_folder_that_the_user_knows(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No such file") as caught, written_whole(tmp_path / "a") as part:
        (part / "nowhere" / "file").write_text("new")
    assert caught.value.filename == str(tmp_path / "a")


def test_an_error_of_another_library_is_one_line(tmp_path: Path) -> None:
    """As HDF5's of a full disk, which also names the folder of the parts."""
    text = "file write failed: time = Sat Nov 28 22:18:35 2026\n, filename = 'a/.part-h3wfypxf/chart.h5'"
    with pytest.raises(OSError, match="No space left on device") as caught, written_whole(tmp_path / "a"):
        raise OSError(errno.ENOSPC, text)
    assert caught.value.strerror == "No space left on device"


def test_a_folder_in_place_of_a_file_is_named_before_anything_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("old")
    (tmp_path / "b" / "more").mkdir(parents=True)
    with pytest.raises(IsADirectoryError) as caught:
        _write_all(tmp_path, "ab")
    assert caught.value.filename == str(tmp_path / "b")
    assert (tmp_path / "a").read_text() == "old"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_while_files_are_moved_waits_until_all_are_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    """A process has other threads, such as those of linear algebra, and Linux gives the signal to any of them."""
    replace, over = Path.replace, threading.Event()

    def interrupted(path: Path, target: Path) -> Path:
        os.kill(os.getpid(), number)
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", interrupted)
    (tmp_path / "old").write_text("old")
    before, other = signal.signal(number, signal.default_int_handler), threading.Thread(target=over.wait)
    other.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            _write_all(tmp_path, "abc", {"o*"})
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, before)
        over.set()
        other.join()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "c"]


def test_a_signal_before_all_are_put_off_loses_no_later_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before, put_off = {number: signal.getsignal(number) for number in SIGNALS}, signal.signal

    def interrupted(number: int, handler: signal.Handlers) -> None:
        put_off(number, handler)
        monkeypatch.undo()
        raise KeyboardInterrupt

    monkeypatch.setattr(signal, "signal", interrupted)
    with pytest.raises(KeyboardInterrupt):
        _write_all(tmp_path, "a")
    after = {number: signal.getsignal(number) for number in SIGNALS}
    for number, handler in before.items():
        put_off(number, handler)
    assert after == before


def test_a_signal_that_is_ignored_stays_ignored_and_other_threads_may_write(tmp_path: Path) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        other = threading.Thread(target=_write_all, args=(tmp_path, "a"))
        other.start()
        other.join()
        _write_all(tmp_path, "b")
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def test_obsolete_files_are_removed_with_the_move_and_new_ones_of_the_pattern_stay(tmp_path: Path) -> None:
    for name in ("map_1", "map_2", "note"):
        (tmp_path / name).write_text("old")
    with pytest.raises(KeyboardInterrupt), written_whole(tmp_path, {"map_*"}) as part:
        _begin_and_raise(part / "map_1", KeyboardInterrupt())
    assert len(list(tmp_path.iterdir())) == 3
    obsolete = set[str]()
    with written_whole(tmp_path, obsolete) as part:
        (part / "map_1").write_text("new")
        obsolete.add("map_*")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"map_1": "new", "note": "old"}


def test_a_text_is_written_through_a_link_and_into_a_pipe(tmp_path: Path) -> None:
    """As --out /dev/stdout, and a file that is a link to the one on another disk."""
    (tmp_path / "disk").mkdir()
    (tmp_path / "disk" / "file").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "disk" / "file")
    write_whole(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "disk" / "file").read_text() == "new"
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_whole(tmp_path / "pipe", "text")
        assert os.read(reader, 100) == b"text"
    finally:
        os.close(reader)
    assert (tmp_path / "pipe").is_fifo()


def test_a_text_for_standard_output_joins_what_is_printed_to_the_same_file(tmp_path: Path) -> None:
    """As --out /dev/stdout > FILE: a new file in its place would lose all that is printed."""
    program = (
        "from pathlib import Path\nfrom auv_lse_common.support.atomic_files import write_whole\n"
        "print('before')\nwrite_whole(Path('/dev/stdout'), 'text\\n')\nprint('after')\n"
    )
    with (tmp_path / "file").open("w") as file:
        subprocess.run([sys.executable, "-c", program], stdout=file, check=True)
    assert (tmp_path / "file").read_text() == "before\ntext\nafter\n"


def test_a_replaced_text_keeps_its_permissions(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("old")
    (tmp_path / "file").chmod(0o640)
    write_whole(tmp_path / "file", "new")
    assert (tmp_path / "file").stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize("name", ["file", "file/below", "file/below/it", "broken"])
def test_a_file_in_the_way_of_a_folder_is_named(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "broken").symlink_to(tmp_path / "nowhere")
    with pytest.raises(NotADirectoryError) as caught:
        check_folder(tmp_path / name)
    assert caught.value.filename == str(tmp_path / name.split("/", maxsplit=1)[0])


def test_a_name_that_is_too_long_is_named(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="File name too long") as caught:
        check_folder(tmp_path / ("a" * 300) / "b")
    assert caught.value.errno == errno.ENAMETOOLONG


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(atomic_files.os, "access", lambda path, mode: False)  # the tests may run as root
    with pytest.raises(PermissionError) as caught:
        check_folder(tmp_path / "new")
    assert caught.value.filename == str(tmp_path)


@pytest.mark.parametrize("name", ["", "new", "new/newer", "link", "link/new", "with space/ü"])
def test_folders_that_can_be_written_pass_and_are_not_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "there")
    before = sorted(tmp_path.rglob("*"))
    check_folder(tmp_path / name)
    monkeypatch.chdir(tmp_path)
    check_folder(Path(name))
    assert sorted(tmp_path.rglob("*")) == before


def test_a_file_that_cannot_be_written_is_named_before_the_work(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"--csv .*: this is a folder; name a file in it"):
        check_file(tmp_path, "--csv")
    with pytest.raises(ValueError, match=r"--csv .*: there is no folder .*/no\. Create it"):
        check_file(tmp_path / "no" / "a.csv", "--csv")
    with pytest.raises(ValueError, match=r"--csv no/a\.csv: there is no folder no\. Create it"):
        check_file(Path("no/a.csv"), "--csv")
    (tmp_path / "link").symlink_to("/nosuch/a.csv")
    with pytest.raises(ValueError, match=r"--csv .*/link: there is no folder /nosuch\. Create it"):
        check_file(tmp_path / "link", "--csv")
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(
        ValueError, match=r"--csv .*/loop: this is a symbolic link that leads to itself; choose another"
    ):
        check_file(tmp_path / "loop", "--csv")


def test_new_and_existing_files_links_and_devices_can_be_written(tmp_path: Path) -> None:
    (tmp_path / "old").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "old")
    (tmp_path / "new link").symlink_to(tmp_path / "new")
    os.mkfifo(tmp_path / "pipe")
    for name in ("new", "old", "link", "new link", "pipe"):
        check_file(tmp_path / name, "--csv")
    check_file(Path("/dev/stdout"), "--csv")
    check_file(Path("/dev/null"), "--csv")


WRITER = """\
import sys, time
from pathlib import Path
from auv_lse_common.support.atomic_files import written_whole
with written_whole(Path(sys.argv[1])) as part:
    (part / "mine").write_text("new")
    print("there", flush=True)
    sys.stdin.read()
"""


def test_what_a_killed_command_left_is_removed_and_what_a_running_one_writes_is_not(tmp_path: Path) -> None:
    def age() -> list[Path]:
        found = [path for path in tmp_path.iterdir() if "part" in path.name]
        for path in found:
            os.utime(path, (1e9, 1e9))
        return found

    (tmp_path / ".part-download").mkdir()
    (tmp_path / ".auv_lse.part-aabbccdd").write_text("a file of the user")
    command = [sys.executable, "-c", WRITER, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        running.stdout.readline()
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as killed:
            assert killed.stdout is not None
            killed.stdout.readline()
            assert len(age()) == 4
            killed.kill()
        age()
        write_whole(tmp_path / "text", "text")
        assert len(age()) == 3
        running.communicate()
    assert running.returncode == 0
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [".auv_lse.part-aabbccdd", ".part-download", "mine", "text"]


def test_what_another_process_has_just_made_and_not_yet_locked_stays(tmp_path: Path) -> None:
    (tmp_path / ".auv_lse.part-00112233").mkdir()
    write_whole(tmp_path / "text", "text")
    assert (tmp_path / ".auv_lse.part-00112233").is_dir()


def _write_as(user: int, folder: Path, monkeypatch: pytest.MonkeyPatch, obsolete: Collection[str] = ()) -> None:
    monkeypatch.setattr(atomic_files.os, "geteuid", lambda: user)
    _write_all(folder, "ab", obsolete)


@pytest.mark.parametrize("name", ["b", "map_1"])
def test_a_file_that_only_another_user_may_replace_is_named_before_anything_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """As in /tmp, where everybody may write."""
    tmp_path.chmod(0o1777)
    (tmp_path / name).write_text("old")
    with pytest.raises(PermissionError, match="belongs to another user") as caught:
        _write_as(54321, tmp_path, monkeypatch, {"map_*"})
    assert caught.value.filename == str(tmp_path / name)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {name: "old"}


@pytest.mark.parametrize(
    ("mode", "user", "old"),
    [
        (0o1777, os.geteuid(), "b"),
        (0o777, 54321, "b"),
        (0o1777, 0, "b"),
        (0o1777, 54321, "map_1"),
        (0o1777, 54321, "c"),
    ],
)
def test_files_of_others_that_may_be_replaced_or_are_not_in_the_way_stop_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: int, user: int, old: str
) -> None:
    tmp_path.chmod(mode)
    (tmp_path / old).write_text("old")
    _write_as(user, tmp_path, monkeypatch)
    assert [(tmp_path / name).read_text() for name in "ab"] == ["new", "new"]


def test_a_folder_is_written_whole_within_another_one_and_twice_in_one_process(tmp_path: Path) -> None:
    began_s = time.monotonic()
    with written_whole(tmp_path) as outer, written_whole(outer / "inner") as inner, written_whole(tmp_path) as twice:
        _write_all(outer, "e")
        (inner / "a").touch()
        (twice / "b").touch()
        write_whole(outer / "c", "text")
        write_whole(tmp_path / "d", "text")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b", "c", "d", "e", "inner"]
    assert [path.name for path in (tmp_path / "inner").iterdir()] == ["a"]
    assert time.monotonic() - began_s < 5.0, "a process does not wait for its own locks"


def test_a_folder_that_something_else_keeps_locked_is_written_after_a_while(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As `flock DIR auv_lse export RUN --out DIR` does."""
    monkeypatch.setattr(atomic_files, "_WAIT_S", 0.1)
    with subprocess.Popen(["flock", str(tmp_path), "cat"], stdin=subprocess.PIPE) as other:
        time.sleep(0.2)
        _write_all(tmp_path, "ab")
        other.communicate()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def test_two_processes_do_not_move_files_into_a_folder_at_the_same_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each has all its files there in the end, or none: another one moves its own after these, or before."""
    replace, waits = Path.replace, []
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        begin, ready = other.stdin, other.stdout
        assert begin is not None
        assert ready is not None
        ready.readline()

        def slow(path: Path, target: Path) -> Path:
            if not waits:
                begin.close()
            with pytest.raises(subprocess.TimeoutExpired):
                other.wait(timeout=0.5)
            waits.append(path.name)
            return replace(path, target)

        monkeypatch.setattr(Path, "replace", slow)
        _write_all(tmp_path, "ab")
        assert other.wait(timeout=30) == 0
    assert waits == ["a", "b"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "mine"]


def test_a_file_system_without_locks_is_written_all_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def lacking(file: int, how: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("fcntl.flock", lacking)
    (tmp_path / ".auv_lse.part-aabbccdd").mkdir()
    os.utime(tmp_path / ".auv_lse.part-aabbccdd", (1e9, 1e9))
    _write_all(tmp_path, "ab")
    write_whole(tmp_path / "c", "text")
    assert sorted(path.name for path in tmp_path.iterdir()) == [".auv_lse.part-aabbccdd", "a", "b", "c"]
