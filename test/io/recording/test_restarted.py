# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A recording that is begun again under its name goes on beside and stays bounded in total."""

import threading

import pytest

from test.io.recording.test_recorder import message, opened
from valve_twin.io.bags.read import bag_info
from valve_twin.io.bags.rolling import SplitRule
from valve_twin.io.errors import BagError
from valve_twin.io.recording.recorder import Recording
from valve_twin.io.recording.restarted import earlier_files, mark, next_folder


def begun(folder, keep=0, messages=1, first=0):
    recording = opened(next_folder(folder / "bag"), split=SplitRule(keep=keep))
    recording.follow(folder / "bag")
    recording.write([message(first + i) for i in range(messages)])
    return recording


def messages(bag):
    return sum(t.count for t in bag_info(bag).topics)


def names(folder):
    return sorted(p.name for p in folder.rglob("*.mcap"))


def test_each_recording_of_a_name_has_a_folder_of_its_own(tmp_path):
    for number in range(3):
        begun(tmp_path, first=number).close()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bag", "bag_002", "bag_003"]
    assert [messages(p) for p in sorted(tmp_path.iterdir())] == [1, 1, 1]
    assert next_folder(tmp_path / "bag").name == "bag_004"
    assert next_folder(tmp_path / "other").name == "other"


def test_a_gap_in_the_numbers_is_not_filled(tmp_path):
    """Else a later recording would be taken for an earlier one."""
    for name in ("bag_002", "bag_1000"):
        (tmp_path / name).mkdir()
        mark(tmp_path / name, tmp_path / "bag")
    assert next_folder(tmp_path / "bag").name == "bag_1001"


def test_the_files_kept_count_over_restarts(tmp_path):
    for number in range(6):
        begun(tmp_path, keep=3, first=number).close()
        assert len(names(tmp_path)) <= 3
    assert names(tmp_path) == ["bag_004_0.mcap", "bag_005_0.mcap", "bag_006_0.mcap"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bag_004", "bag_005", "bag_006"]


def test_of_an_earlier_recording_its_oldest_files_go_first(tmp_path):
    first = begun(tmp_path)
    for number in range(1, 4):
        first.split()
        first.write([message(number)])
    first.close()
    begun(tmp_path, keep=3, first=9).close()
    assert names(tmp_path) == ["bag_002_0.mcap", "bag_2.mcap", "bag_3.mcap"]
    assert messages(tmp_path / "bag") == 2, "what is left is read without metadata.yaml"


def test_what_a_recorder_left_that_died_at_its_start_displaces_nothing(tmp_path):
    begun(tmp_path).close()
    for _ in range(5):
        begun(tmp_path, keep=3, messages=0)._let_go()  # as a kill does
    begun(tmp_path, keep=3, first=1).close()
    assert "bag_0.mcap" in names(tmp_path)
    assert len(names(tmp_path)) == 2


def test_a_bag_that_took_the_place_of_an_earlier_recording_meanwhile_is_left_alone(tmp_path):
    """Its file of the same name was deleted, and its metadata."""
    begun(tmp_path).close()
    later = begun(tmp_path, keep=2, first=1)
    (tmp_path / "bag").rename(tmp_path / "moved")
    (tmp_path / "else").mkdir()
    begun(tmp_path / "else").close()
    (tmp_path / "else" / "bag").rename(tmp_path / "bag")
    for number in range(2, 5):
        later.split()
        later.write([message(number)])
    later.close()
    assert messages(tmp_path / "bag") == messages(tmp_path / "moved") == 1
    assert names(tmp_path / "bag_002") == ["bag_002_2.mcap", "bag_002_3.mcap"]


def test_files_that_another_recorder_writes_are_none_of_its_own(tmp_path):
    running = begun(tmp_path)
    begun(tmp_path, keep=1, first=1).close()
    assert names(tmp_path) == ["bag_0.mcap", "bag_002_0.mcap"]
    running.close()
    assert messages(tmp_path / "bag") == 1


def test_names_that_only_look_alike_are_left_alone(tmp_path):
    for name in ("bag_monday", "bag_01", "bagpipe_002", "bag_002_003"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.mcap").write_bytes(b"mine")
    (tmp_path / "bag").mkdir()
    assert next_folder(tmp_path / "bag").name == "bag_002"
    assert earlier_files(tmp_path / "bag_002", tmp_path / "bag") == []
    assert len(names(tmp_path)) == 4


def test_the_folder_of_another_valve_is_left_alone(tmp_path):
    """Valves press and press_101 record beside each other."""
    for _ in range(2):
        opened(next_folder(tmp_path / "bag_003"))._let_go()
    other = opened(next_folder(tmp_path / "bag_101"))
    other.follow(tmp_path / "bag_101")
    other.write([message(0)])
    other.close()
    for number in range(4):
        begun(tmp_path, keep=2, first=number).close()
    assert messages(tmp_path / "bag_101") == 1
    assert names(tmp_path)[-1] == "bag_101_0.mcap"
    kept = {p.name for p in tmp_path.iterdir()} - {"bag_101", "bag_003", "bag_003_002"}
    assert kept == {"bag_004", "bag_005"}


def test_no_thread_is_left_of_a_recording_that_cannot_begin(tmp_path):
    before = threading.active_count()
    (tmp_path / "bag").write_text("a file")
    for path in (tmp_path / "bag", tmp_path / "bag" / "below"):
        with pytest.raises(BagError):
            Recording(path, in_background=True)
    assert threading.active_count() == before


def test_a_name_that_was_given_counts_and_no_other(tmp_path):
    """Two recordings of the same day, named by the clock, are not one."""
    for name in ("valve_twin_20261122", "valve_twin_20261122_101500", "press_101"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.mcap").write_bytes(b"mine")
    late = tmp_path / "valve_twin_20261122_151515"
    assert earlier_files(late, late) == []
    assert earlier_files(tmp_path / "press_102", tmp_path / "press_102") == []
    assert len(names(tmp_path)) == 3


@pytest.mark.parametrize("length", [2**40, 2**63 + 1])
def test_a_damaged_file_of_an_earlier_recording_is_kept(tmp_path, length):
    """A length that lies hides the messages behind it: `recover` may read them."""
    begun(tmp_path).close()
    (path,) = (tmp_path / "bag").glob("*.mcap")
    data = bytearray(path.read_bytes())
    data[9:17] = length.to_bytes(8, "little")  # of the first record
    path.write_bytes(data)
    again = begun(tmp_path)
    again.close()
    assert path in earlier_files(tmp_path / "bag_002", tmp_path / "bag")
    assert path.exists()


def test_a_file_of_an_earlier_recording_that_has_gone_keeps_none_from_recording(tmp_path):
    begun(tmp_path).close()
    (tmp_path / "bag" / "bag_1.mcap").symlink_to(tmp_path / "unplugged" / "bag_1.mcap")
    begun(tmp_path, keep=2, first=1).close()
    assert messages(tmp_path / "bag_002") == 1
    assert names(tmp_path) == ["bag_0.mcap", "bag_002_0.mcap", "bag_1.mcap"]
