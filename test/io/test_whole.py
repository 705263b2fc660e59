# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A file is whole or what it was: on a full disk, read only, behind a link, in a pipe."""

from __future__ import annotations

import errno
import fcntl
import os
import resource
import threading
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from test.small_disk import small_disk
from valve_twin.cli.common import check_writable
from valve_twin.io.sealed import flush
from valve_twin.io.whole import part_of, placed, sync_file, write_all, write_whole

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def full_disk(room: int) -> Iterator[None]:
    """Let no file of this process grow beyond a size [B]; the error is another than ENOSPC."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_what_is_written_is_on_the_disk_before_it_gets_the_name(tmp_path, monkeypatch):
    done: list[str] = []
    sync, replace = os.fsync, os.replace

    def synced(file: int) -> None:
        done.append("fsync")
        sync(file)

    def replaced(part: Path, target: Path) -> None:
        done.append("replace")
        replace(part, target)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", replaced)
    write_whole(tmp_path / "a.txt", "content")
    assert done == ["fsync", "replace", "fsync"]  # the name, too
    assert (tmp_path / "a.txt").read_text() == "content"


def test_a_full_disk_leaves_what_was_there_and_nothing_else(tmp_path):
    path = tmp_path / "a.txt"
    write_whole(path, "before")
    with full_disk(1000), pytest.raises(OSError, match="too large") as caught:
        write_whole(path, "x" * 5000)
    assert caught.value.filename == str(path)
    assert path.read_text() == "before"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_files_that_belong_together_are_all_new_or_all_as_before(tmp_path, monkeypatch):
    first, last = tmp_path / "a.txt", tmp_path / "z.txt"
    write_all({first: "a, before", last: "z, before"})
    with full_disk(1000), pytest.raises(OSError, match="too large") as caught:
        write_all({first: "a, after", last: "z" * 5000})
    assert caught.value.filename == str(last)

    def ends(part: Path, target: Path) -> None:  # while the last one is written
        del part, target
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("shutil.copymode", ends)
        with pytest.raises(KeyboardInterrupt):
            write_all({first: "a, after", last: "z, after"})
    assert (first.read_text(), last.read_text()) == ("a, before", "z, before")
    assert sorted(os.listdir(tmp_path)) == ["a.txt", "z.txt"]
    write_all({first: "a, after", last: b"z, after"})
    assert (first.read_text(), last.read_text()) == ("a, after", "z, after")


def test_one_that_cannot_be_written_leaves_those_beside_it(tmp_path):
    """A folder in the place of the last one: the first was of now by then."""
    first, last = tmp_path / "a.txt", tmp_path / "z.txt"
    first.write_text("a, before")
    last.mkdir()
    with pytest.raises(IsADirectoryError) as caught:
        write_all({first: "a, after", last: "z, after"})
    assert caught.value.filename == str(last)
    assert first.read_text() == "a, before"
    assert sorted(os.listdir(tmp_path)) == ["a.txt", "z.txt"]


def test_names_that_begin_alike_are_kept_apart(tmp_path):
    both = [tmp_path / f"{'n' * 60}{k}" for k in range(2)]
    write_all({path: path.name for path in both})
    assert [path.read_text() for path in both] == [path.name for path in both]


def test_parts_of_names_that_begin_alike_are_kept_apart(tmp_path):
    """Two backups at a time in one process, or in two containers with one process id."""
    alike = "press_cartridge_line_three_station_twelve_history_of_2026"
    parts = {part_of(tmp_path / f"{alike}_{k}.sqlite") for k in range(2)}
    assert len(parts) == 2


def test_a_file_is_flushed_by_a_handle_that_may_write(tmp_path, monkeypatch):
    """Windows refuses another one: no table could be written there."""
    flushed: list[int] = []

    def windows(file: int) -> None:
        if fcntl.fcntl(file, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        flushed.append(file)

    (tmp_path / "a.csv").write_text("a\n1\n")
    monkeypatch.setattr(os, "fsync", windows)
    sync_file(tmp_path / "a.csv")
    assert len(flushed) == 1
    assert (tmp_path / "a.csv").read_text() == "a\n1\n"


def test_a_file_that_takes_no_more_is_flushed(tmp_path, monkeypatch):
    """A disk that became read-only still holds what is to be kept."""
    (tmp_path / "a.cycle").write_text("kept")
    opened = Path.open

    def refused(path: Path, mode: str) -> object:
        if "+" in mode:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        return opened(path, mode)

    monkeypatch.setattr(Path, "open", refused)
    assert flush([tmp_path / "a.cycle", tmp_path / "gone.cycle"]) == {
        tmp_path / "a.cycle",
        tmp_path / "gone.cycle",
    }


def test_a_read_only_folder_is_told_with_the_file_that_was_asked_for(tmp_path):
    with small_disk(tmp_path / "disk", "1m") as disk:
        disk.mount("remount,ro")
        path = disk.place / "a.txt"
        with pytest.raises(OSError, match="Read-only") as caught:
            write_whole(path, "x")
        assert caught.value.filename == str(path)


def test_a_link_is_followed_and_access_rights_stay(tmp_path):
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_text("before")
    target.chmod(0o640)
    link.symlink_to(target)
    write_whole(link, "after")
    assert link.is_symlink()
    assert target.read_text() == "after"
    assert target.stat().st_mode & 0o777 == 0o640
    link.unlink()
    link.symlink_to(tmp_path / "nowhere" / "deep")
    with pytest.raises(FileNotFoundError):
        write_whole(link, "after")
    assert not (tmp_path / "nowhere").exists()


def test_a_private_file_is_private_while_it_is_written(tmp_path):
    """Until it was complete, what took its place could be read by whoever the umask lets."""
    target, seen = tmp_path / "users", []
    target.write_text("old")
    target.chmod(0o600)

    def look(number: int) -> None:
        seen.append(os.fstat(number).st_mode & 0o777)

    before = os.umask(0)
    try:
        write_whole(target, "new", look)
    finally:
        os.umask(before)
    assert seen[0] == 0o600
    assert target.read_text() == "new"


def test_a_pipe_is_written_in_place(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    found: list[str] = []
    reader = threading.Thread(target=lambda: found.append(pipe.read_text()))
    reader.start()
    write_whole(pipe, "through")
    reader.join(30.0)
    assert found == ["through"]
    assert pipe.is_fifo()


def test_a_folder_is_no_file(tmp_path):
    with pytest.raises(IsADirectoryError):
        write_whole(tmp_path, "x")


def test_a_pipe_that_only_an_open_file_leads_to_is_written_in_place():
    ours, theirs = os.pipe()
    try:
        for path in (f"/dev/fd/{theirs}", f"/proc/self/fd/{theirs}"):  # as /dev/stdout | ...
            check_writable(path)
            write_whole(path, "through")
            assert os.read(ours, 100) == b"through"
    finally:
        os.close(ours)
        os.close(theirs)


def test_a_file_that_standard_output_leads_to_keeps_its_place(tmp_path):
    with (tmp_path / "a.txt").open("w") as file:
        write_whole(f"/dev/fd/{file.fileno()}", "redirected")
        assert os.fstat(file.fileno()).st_nlink == 1  # else what is printed later were lost
    assert (tmp_path / "a.txt").read_text() == "redirected"


@pytest.mark.parametrize("code", [errno.EBUSY, errno.EPERM])
def test_a_file_that_keeps_its_place_is_written_there(tmp_path, monkeypatch, code):
    """As one that a container mounts, or another's in a folder of all."""

    def refuse(*_: object) -> None:
        raise OSError(code, os.strerror(code))

    path = tmp_path / "a.txt"
    path.write_text("before")
    monkeypatch.setattr(os, "replace", refuse)
    write_whole(path, "after")
    assert path.read_text() == "after"
    assert os.listdir(tmp_path) == ["a.txt"]
    with pytest.raises(OSError, match=os.strerror(code)):
        write_whole(tmp_path / "new.txt", "x")


def test_a_file_that_may_not_be_written_is_not_replaced(tmp_path, monkeypatch):
    path = tmp_path / "a.txt"
    path.write_text("before")
    number = path.stat().st_ino
    monkeypatch.setattr(os, "access", lambda asked, _: Path(asked) != path)
    write_whole(path, "by root, who may")
    assert path.stat().st_ino == number


def test_the_longest_name_is_written(tmp_path):
    path = tmp_path / ("ü" * 127)
    for content in ("before", "after"):
        write_whole(path, content)
    assert path.read_text() == "after"


def test_what_fails_on_its_way_to_its_place_leaves_nothing(tmp_path):
    path = tmp_path / "a.db"
    path.write_text("before")

    def fail() -> None:
        with placed(path, part_of(path)) as part:
            part.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert path.read_text() == "before"
    assert os.listdir(tmp_path) == ["a.db"]


def test_a_file_has_its_place_once_it_is_complete(tmp_path):
    path = tmp_path / "a.db"
    path.write_text("before")
    with placed(path, part_of(path)) as part:
        part.write_text("after")
        assert path.read_text() == "before"
    assert path.read_text() == "after"
    assert os.listdir(tmp_path) == ["a.db"]
