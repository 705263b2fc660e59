# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A recorder whose folder is replaced by another bag of the same name harms neither of them."""

import errno
import os
import shutil
from pathlib import Path

import pytest

from test.io.recording.test_recorder import Clock, message, metadata, opened, values
from valve_twin.io.bags.rolling import FileEvents, SplitRule
from valve_twin.io.recording.restarted import next_folder


class Replaced:
    """A recording in `folder`/bag, and another bag that takes the place of it."""

    def __init__(self, folder, **options) -> None:
        self.folder, self.clock, self.told = folder, Clock(), list[str]()
        events = FileEvents(on_gone=self.told.append)
        self.recording = opened(folder / "bag", clock=self.clock, events=events, **options)
        self._next = 0

    def write(self, count: int = 1) -> None:
        self.recording.write([message(self._next + i) for i in range(count)])
        self._next += count

    def wait(self) -> None:
        """Let the time to flush pass."""
        self.clock.now += 0.5
        self.recording.tick()

    def replace(self, files: int = 1) -> None:
        bag = self.folder / "bag"
        other = opened(self.folder / "beside" / bag.name)
        for number in range(files):
            if number:
                other.split()
            other.write([message(900 + number)])
        other.close()
        bag.rename(self.folder / "mine")
        (self.folder / "beside" / bag.name).rename(bag)

    def other(self) -> list[list[int]]:
        """What the other bag holds, file by file, as far as it is there."""
        return [values(p) for p in sorted((self.folder / "bag").glob("*.mcap"))]


@pytest.mark.parametrize("keep", [0, 2])
def test_another_bag_with_a_file_of_the_same_name_is_left_alone(tmp_path, keep):
    case = Replaced(tmp_path, split=SplitRule(keep=keep))
    case.write()
    case.recording.split()
    case.write(9)
    case.wait()
    case.replace()
    case.write(10)
    case.wait()
    case.write()
    case.recording.split()
    case.recording.close()
    assert case.other() == [[900]]
    assert metadata(tmp_path / "bag")["message_count"] == 1
    assert values(tmp_path / "mine" / "bag_1.mcap") == list(range(1, 20))
    assert values(tmp_path / "bag_002" / "bag_002_0.mcap") == [20]
    assert case.recording.path == tmp_path / "bag_002"
    assert "bag: another bag took its place: recording to" in case.told[1]
    assert case.recording.lost == {"/a": 0}


@pytest.mark.parametrize("end", ["close", "delete"])
def test_no_file_of_another_bag_is_deleted_for_one_of_the_same_name(tmp_path, end):
    case = Replaced(tmp_path, split=SplitRule(keep=2))
    case.write()
    case.recording.split()
    case.replace(files=3)
    if end == "delete":
        case.recording._drop_oldest()
    case.recording.close()
    assert case.other() == [[900], [901], [902]]


def test_a_folder_that_was_made_anew_is_held_again(tmp_path):
    recording = opened(tmp_path / "bag")
    recording.write([message(0)])
    recording.flush()
    shutil.rmtree(tmp_path / "bag")
    for number in (1, 2):
        recording.write([message(number)])
        recording.flush()
    second = opened(next_folder(tmp_path / "bag"), split=SplitRule(keep=1))
    second.follow(tmp_path / "bag")
    assert values(tmp_path / "bag" / "bag_1.mcap") == [2]
    second.close()
    recording.close()


def test_a_folder_that_is_replaced_before_a_split_costs_no_message(tmp_path):
    case = Replaced(tmp_path, split=SplitRule(size=1500))
    case.write(10)
    case.wait()
    case.replace()
    for _ in range(40):
        case.clock.now += 0.01
        case.write(25)
        assert case.recording.trouble == ""
    case.recording.close()
    assert case.recording.lost == {"/a": 0}
    own = [*(tmp_path / "mine").glob("*.mcap"), *(tmp_path / "bag_002").glob("*.mcap")]
    assert sorted(v for p in own for v in values(p)) == list(range(1010))


def test_a_snapshot_goes_beside_where_the_folder_was_replaced(tmp_path):
    case = Replaced(tmp_path, by_snapshot=True)
    assert case.recording.snapshot([message(1)], {}) == "bag_0.mcap"
    case.replace()
    assert case.recording.snapshot([message(2)], {}) == "bag_002_0.mcap"
    case.recording.close()
    assert values(tmp_path / "bag_002" / "bag_002_0.mcap") == [2]


def test_messages_of_a_cut_file_are_not_in_the_metadata(tmp_path):
    case = Replaced(tmp_path)
    case.write(10)
    case.wait()
    os.truncate(tmp_path / "bag" / "bag_0.mcap", 100)
    case.write(10)
    case.wait()
    case.write(10)
    case.recording.close()
    assert case.recording.counts == {"/a": 10}
    found = metadata(tmp_path / "bag")
    assert found["message_count"] == 10
    assert [f["message_count"] for f in found["files"]] == [0, 10]
    assert [t["message_count"] for t in found["topics_with_message_count"]] == [10]
    assert found["starting_time"]["nanoseconds_since_epoch"] == message(20).log_ns


def test_the_folder_that_was_replaced_is_the_one_that_is_told(tmp_path):
    opened(tmp_path / "bag").close()
    told = list[str]()
    second = opened(next_folder(tmp_path / "bag"), events=FileEvents(on_gone=told.append))
    second.follow(tmp_path / "bag")
    other = opened(tmp_path / "beside" / "bag_002")
    other.write([message(900)])
    other.close()
    (tmp_path / "bag_002").rename(tmp_path / "mine")
    (tmp_path / "beside" / "bag_002").rename(tmp_path / "bag_002")
    second.write([message(1)])
    second.flush()
    second.close()
    assert told[1].startswith(f"{tmp_path / 'bag_002'}: another bag took its place: recording to")


def test_it_goes_on_in_its_folder_that_is_back_where_none_could_be_made(tmp_path, monkeypatch):
    case = Replaced(tmp_path)
    case.write()
    case.wait()
    case.replace()

    make = Path.mkdir

    def full(path, *options, **more):
        if path.name == "bag_002":
            raise OSError(errno.ENOSPC, "No space left on device")
        make(path, *options, **more)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "mkdir", full)
        case.write()
        case.wait()
    assert "No space left on device" in case.recording.trouble
    shutil.rmtree(tmp_path / "bag")
    (tmp_path / "mine").rename(tmp_path / "bag")
    case.wait()
    assert case.recording.trouble == ""
    case.write()
    case.recording.close()
    assert values(tmp_path / "bag" / "bag_1.mcap") == [2]


def test_a_later_recording_counts_no_file_of_the_bag_that_took_the_place(tmp_path):
    case = Replaced(tmp_path)
    case.write()
    case.wait()
    case.replace()
    case.write()
    case.wait()
    case.write()
    case.recording.close()
    for number in range(3):
        later = opened(next_folder(tmp_path / "bag"), split=SplitRule(keep=2))
        later.follow(tmp_path / "bag")
        later.write([message(2 * number)])
        later.split()
        later.write([message(2 * number + 1)])
        later.close()
    assert case.other() == [[900]]
    assert not (tmp_path / "bag_002").exists(), "this one is its own"
