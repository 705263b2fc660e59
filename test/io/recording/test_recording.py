# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A recorder whose folder is replaced by another bag of the same name harms neither of them."""

import pytest

from test.io.recording.test_recorder import Clock, message, metadata, opened, values
from valve_twin.io.bags.rolling import FileEvents, SplitRule


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
