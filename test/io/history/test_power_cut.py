# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A power cut at any moment leaves every cycle that was flushed, and no part of another one.

What is done to the disk is recorded. Of each beginning of the record the states are made that a
power cut may leave: what was not flushed is there, in part, as zeros, or not at all.
"""

import errno
import os
import random
from pathlib import Path
from typing import Any

import pytest

from test.io.history.test_store import VALVE, both, record
from valve_twin.io.history.unsaved import UnsavedCycle, UnsavedCycles

HISTORY = "postgresql://valve@/db"


def kept_of(cycle):
    return UnsavedCycle(record(cycle), both(cycle))


class RecordedDisk:
    """Every write, rename, removal, new folder and flush, in its order."""

    def __init__(self, monkeypatch):
        self.done = []
        self._note(monkeypatch, Path, "write_bytes", lambda path, data: ("write", path, data))
        self._note(monkeypatch, Path, "unlink", lambda path, **_: ("unlink", path))
        self._note(monkeypatch, os, "replace", lambda old, new: ("rename", old, new))
        self._note(monkeypatch, os, "mkdir", lambda path, *_: ("mkdir", Path(path)))
        self._note(monkeypatch, os, "fsync", lambda n: ("sync", Path(f"/proc/self/fd/{n}")))

    def _note(self, monkeypatch, of, name, told):
        whole = getattr(of, name)

        def call(*args, **kwargs):
            what = told(*args, **kwargs)
            if what[0] == "sync":
                what = ("sync", what[1].readlink())
            found = whole(*args, **kwargs)
            self.done.append(what)
            return found

        monkeypatch.setattr(of, name, call)

    def acknowledge(self, paths):
        self.done.append(("acknowledged", set(paths)))


def cut_after(done, rng):
    """Return what a power cut may leave: folders, content by path; and what was promised."""
    content, whole = {}, {}  # whole: what lies under a name while power lasts
    pending: list[Any] = []
    entries: dict[Path, int] = {}
    folders, promised = set(), set()
    flushed = set()

    def settle(folder=None):
        """Let names reach the disk: all of a folder, or any of those that were not flushed."""
        nonlocal pending
        left = []
        for parent, change in pending:
            if folder == parent or (folder is None and rng.random() < 0.5):
                change()
            elif folder is not None:
                left.append((parent, change))
        pending = left

    for number, (what, *args) in enumerate(done):
        if what == "write":
            path, data = args
            whole[path], content[number] = number, data
            pending.append((path.parent, lambda p=path, n=number: entries.__setitem__(p, n)))
        elif what == "rename":
            old, new = args
            whole[new] = moved = whole.pop(old)

            def rename(old=old, new=new, moved=moved):
                entries.pop(old, None)
                entries[new] = moved

            pending.append((new.parent, rename))
        elif what == "unlink":
            whole.pop(args[0], None)
            promised.discard(args[0])
            pending.append((args[0].parent, lambda p=args[0]: entries.pop(p, None)))
        elif what == "mkdir":
            pending.append((args[0].parent, lambda p=args[0]: folders.add(p)))
        elif what == "sync":
            flushed.add(whole.get(args[0]))
            settle(args[0])
        else:
            promised |= args[0] & set(whole)
    settle()
    return (
        folders,
        {p: _left_of(content[n], n in flushed, rng) for p, n in entries.items()},
        promised,
    )


def _left_of(data, is_flushed, rng):
    """Return what a power cut leaves of the content of a file."""
    if is_flushed:
        return data
    place = rng.randrange(len(data))
    return rng.choice([data, b"", data[:place], data[:place] + bytes(len(data) - place)])


def check(done, rng, after):
    """Read what is left as the next twin would."""
    folders, files, promised = cut_after(done, rng)
    state = after / "state"
    for folder in sorted(folders):
        (after / folder.relative_to(after.parent / "before")).mkdir(parents=True, exist_ok=True)
    for path, data in files.items():
        place = after / path.relative_to(after.parent / "before")
        if place.parent.is_dir():
            place.write_bytes(data)
    unsaved = UnsavedCycles(state, HISTORY)
    found = {p.name: unsaved.read(VALVE, p) for p in unsaved.waiting(VALVE)}
    assert all(found.get(path.name) is not None for path in promised)
    for name, cycle in found.items():
        assert cycle is None or cycle == kept_of(int(name.rpartition(".")[2]))


def is_kept(seed, tmp_path, monkeypatch):
    """Put, flush and remove cycles at random; cut the power after each step, five times."""
    rng = random.Random(seed)
    before = tmp_path / "before"
    before.mkdir()
    with monkeypatch.context() as patch:
        disk = RecordedDisk(patch)
        unsaved = UnsavedCycles(before / "state", HISTORY)
        waiting: list[Path] = []
        put: list[Path] = []
        for cycle in range(1, 9):
            put.append(unsaved.put(VALVE, kept_of(cycle)))
            if rng.random() < 0.4:
                disk.acknowledge(unsaved.flush(put))
                waiting, put = waiting + put, []
            if waiting and rng.random() < 0.3:
                waiting.pop(0).unlink()
        disk.acknowledge(unsaved.flush(put))
    for length in range(len(disk.done) + 1):
        for again in range(5):
            after = tmp_path / f"after_{length}_{again}"
            after.mkdir()
            check(disk.done[:length], rng, after)


@pytest.mark.parametrize("seed", range(6))
def test_a_power_cut_leaves_what_was_flushed_and_no_part_of_a_cycle(seed, tmp_path, monkeypatch):
    is_kept(seed, tmp_path, monkeypatch)


@pytest.mark.parametrize("seed", range(6))
def test_the_oracle_sees_a_folder_and_a_file_that_are_not_flushed(seed, tmp_path, monkeypatch):
    monkeypatch.setattr(UnsavedCycles, "flush", lambda _, paths: set(paths))
    with pytest.raises(AssertionError):
        is_kept(seed, tmp_path, monkeypatch)


def test_a_disk_that_does_not_flush_promises_nothing(tmp_path, monkeypatch):
    unsaved = UnsavedCycles(tmp_path / "state", HISTORY)
    one, two = (unsaved.put(VALVE, kept_of(n)) for n in (1, 2))
    sync = os.fsync

    def refuse(number):
        if Path(f"/proc/self/fd/{number}").readlink() == one:
            raise OSError(5, "Input/output error")
        sync(number)

    monkeypatch.setattr(os, "fsync", refuse)
    assert unsaved.flush([one, two]) == {two}
    two.unlink()
    assert unsaved.flush([two]) == {two}, "what is stored meanwhile needs none"


@pytest.mark.parametrize(("number", "kept"), [(errno.EINVAL, True), (errno.EIO, False)])
def test_a_file_system_that_flushes_no_folder_loses_no_waiting_cycle(
    number, kept, tmp_path, monkeypatch
):
    """Files whose flush failed are written anew: without an end where no folder can be flushed."""
    unsaved = UnsavedCycles(tmp_path / "state", HISTORY)
    one = unsaved.put(VALVE, kept_of(1))
    sync = os.fsync

    def refuse(of):
        if Path(f"/proc/self/fd/{of}").readlink().is_dir():
            raise OSError(number, os.strerror(number))
        sync(of)

    monkeypatch.setattr(os, "fsync", refuse)
    assert (one in unsaved.flush([one])) is kept
