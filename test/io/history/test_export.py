# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Copies that somebody else asks for stay in their folder, in number and in size."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess

import pytest

from test.io.history.test_fleet import record
from valve_twin.io.errors import StoreError
from valve_twin.io.history import export
from valve_twin.io.history.export import BackupRules
from valve_twin.io.history.store import History


@pytest.fixture
def history(tmp_path):
    with History(tmp_path / "history.sqlite") as made:
        made.store("/v", record(1))
        yield made


def test_a_copy_goes_beside_the_database_or_where_it_is_configured(history, tmp_path):
    beside = history.backup_for(BackupRules("", 5), "")
    assert beside.parent == tmp_path / "backups"
    assert beside.name.startswith("history-2")
    other = history.backup_for(BackupRules(str(tmp_path / "a" / "b"), 5), "x.sqlite")
    assert other == tmp_path / "a" / "b" / "x.sqlite"
    with History(other, read_only=True) as copy:
        assert copy.last_cycle("/v") == 1


@pytest.mark.parametrize("folder", ["", "copies"])
def test_a_copy_is_named_from_the_root_wherever_it_was_asked_for(tmp_path, monkeypatch, folder):
    monkeypatch.chdir(tmp_path)
    with History("history.sqlite") as made:
        made.store("/v", record(1))
        assert (
            made.backup_for(BackupRules(folder, 5), "x") == tmp_path / (folder or "backups") / "x"
        )


@pytest.mark.parametrize(
    "name", ["/etc/x", "../x", "a/b", "x\ny", ".hidden", "", " x", "x" * 121, "-rf", "x\0"]
)
def test_only_a_name_is_taken(history, tmp_path, name):
    rules = BackupRules("", 5)
    if not name:
        assert history.backup_for(rules, name).exists()
        return
    with pytest.raises(StoreError, match="is no name for a backup") as found:
        history.backup_for(rules, name)
    assert "\n" not in str(found.value)
    assert not (tmp_path / "backups").exists()


def test_an_export_is_there_as_a_whole_or_as_it_was_before(history, tmp_path, monkeypatch):
    """Some of its files were of now, the others of the time before."""
    folder = tmp_path / "csv"
    names = {p.name: p.read_bytes() for p in history.export(folder)}
    history.store("/v", record(2))

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as harm:
        harm.setattr(export, "_write_json_lines", refuse)  # the last one
        with pytest.raises(StoreError, match="csv: cannot be written: No space left on device"):
            history.export(folder)
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == names
    history.export(folder)
    assert (folder / "cycles.csv").read_bytes() != names["cycles.csv"]


def test_an_export_replaces_nothing_where_a_file_cannot_be_put(history, tmp_path):
    """The files before it were of now, those behind of the time before."""
    folder = tmp_path / "csv"
    names = {p.name: p.read_bytes() for p in history.export(folder)}
    history.store("/v", record(2))
    (folder / "history.jsonl").unlink()
    (folder / "history.jsonl").mkdir()
    with pytest.raises(StoreError, match=r"csv: cannot be written: history.jsonl is a folder"):
        history.export(folder)
    left = {p.name: p.read_bytes() for p in folder.glob("*.csv")}
    assert left == {name: data for name, data in names.items() if name in left}
    assert not list(folder.glob(".*"))


def test_an_export_that_ends_half_way_says_which_files_are_of_now(history, tmp_path):
    """By a real refusal: a file that is mounted by itself cannot be replaced."""
    folder = tmp_path / "csv"
    names = {p.name: p.read_bytes() for p in history.export(folder)}
    history.store("/v", record(2))
    (tmp_path / "other").write_text("another disk's")
    taken = str(folder / "maintenance.csv")
    mount = ["mount", "--bind", str(tmp_path / "other"), taken]
    if os.geteuid() or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("no right to mount a file")
    said = (
        "csv: cannot be written: Device or resource busy: .*; of now are cycles.csv, estimates.csv"
        ", as before maintenance.csv, condensates.csv, history.jsonl$"
    )
    try:
        with pytest.raises(StoreError, match=said):
            history.export(folder)
    finally:
        subprocess.run(["umount", taken], check=True)
    new = {p.name for p in folder.iterdir() if p.read_bytes() != names[p.name]}
    assert new <= {"cycles.csv", "estimates.csv"}
    assert "cycles.csv" in new
    assert not list(folder.glob(".*"))


def test_a_link_is_not_followed(history, tmp_path):
    (tmp_path / "backups").mkdir()
    elsewhere = tmp_path / "elsewhere.sqlite"
    os.symlink(elsewhere, tmp_path / "backups" / "x.sqlite")
    with pytest.raises(StoreError, match="exists already"):
        history.backup_for(BackupRules("", 5), "x.sqlite")
    assert not elsewhere.exists()


def test_there_are_no_more_than_may_be(history):
    rules = BackupRules("", 2)
    for name in ("a", "b"):
        history.backup_for(rules, name)
    with pytest.raises(StoreError, match="2 files are there, backups_kept is 2: take some away"):
        history.backup_for(rules, "c")


def test_what_ended_backups_left_is_told_where_it_takes_the_place_of_others(
    history, tmp_path, monkeypatch
):
    """Nobody sees hidden files: "2 files are there" in a folder that shows one, or none."""
    rules = BackupRules("", 2)
    history.backup_for(rules, "a")
    monkeypatch.setattr(export, "_seal", lambda *_: os._exit(9))
    child = os.fork()
    if not child:
        try:
            history.backup_for(rules, "b")
        finally:
            os._exit(1)
    os.waitpid(child, 0)
    with pytest.raises(StoreError, match=r"2 files .* away, first the 1 of backups that were end"):
        history.backup_for(rules, "c")
    assert (tmp_path / "backups" / "a").exists()


def test_the_disk_is_not_filled(history, monkeypatch):
    usage = shutil.disk_usage("/")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=1 << 20))
    with pytest.raises(StoreError, match="1 MB are free, the backup needs 0: make room"):
        history.backup_for(BackupRules("", 5), "a")
