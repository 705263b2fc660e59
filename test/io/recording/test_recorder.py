# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A recording on a disk that is slow to sync, low, full, and free again."""

import errno
import itertools
import os
import shutil
import subprocess
import threading
import time
from contextlib import suppress

import pytest
import yaml
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader

from valve_twin.io.bags.qos import QosProfile
from valve_twin.io.bags.read import bag_info
from valve_twin.io.bags.rolling import FileEvents, SplitRule
from valve_twin.io.cdr.codec import encode_stamped
from valve_twin.io.cdr.signals import STAMPED_TYPE
from valve_twin.io.errors import BagError
from valve_twin.io.recording.recorder import MARGIN_BYTES, DiskRule, Recording
from valve_twin.io.recording.ring_buffer import RecordedMessage

MB = 1_000_000
PERIOD_NS = 5_000_000


class Clock:
    """A steady clock that a test turns on."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def message(number: int, topic: str = "/a") -> RecordedMessage:
    stamp = number * PERIOD_NS
    return RecordedMessage(topic, encode_stamped(stamp, float(number)), stamp, stamp)


def opened(path, *topics, **options) -> Recording:
    recording = Recording(path, **options)
    for topic in topics or ("/a",):
        recording.add_topic(topic, STAMPED_TYPE, (QosProfile(),))
    return recording


def records(path):
    """Yield the records of a file until it ends, anywhere."""
    with path.open("rb") as stream, suppress(EndOfFile):
        yield from StreamReader(stream, validate_crcs=True).records


def values(path, size: int | None = None) -> list[int]:
    """Read the values of a whole file, or of its first bytes, with another reader."""
    part = path.with_suffix(".part")
    part.write_bytes(path.read_bytes()[:size])
    found = [r.log_time // PERIOD_NS for r in records(part) if isinstance(r, Message)]
    part.unlink()
    return found


def metadata(path):
    return yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


def test_what_is_older_than_the_time_to_flush_is_synced(tmp_path):
    clock = Clock()
    synced: list[int] = [0]
    recording = opened(
        tmp_path / "bag",
        flush_s=0.5,
        clock=clock,
        sync=lambda number: synced.append(os.fstat(number).st_size),
    )
    file = tmp_path / "bag" / "bag_0.mcap"
    for i in range(1000):
        clock.now = i * PERIOD_NS * 1e-9
        recording.write([message(i)])
        if i % 37 == 0:
            on_disk = values(file, synced[-1])
            assert on_disk == list(range(len(on_disk)))
            assert len(on_disk) * PERIOD_NS * 1e-9 >= clock.now - 0.51
    recording.close()


def test_the_last_messages_are_synced_when_no_more_come(tmp_path):
    clock = Clock()
    synced: list[int] = []
    recording = opened(tmp_path / "bag", clock=clock, sync=synced.append)
    recording.write([message(1)])
    before = len(synced)
    clock.now = 0.25
    recording.tick()
    assert len(synced) == before
    assert values(tmp_path / "bag" / "bag_0.mcap") == [1]
    clock.now = 0.5
    recording.tick()
    assert len(synced) == before + 1
    assert values(tmp_path / "bag" / "bag_0.mcap") == [1]
    recording.close()


def test_below_the_floor_it_stops_and_goes_on_when_there_is_space(tmp_path):
    clock = Clock()
    free = [10 * MB]
    recording = opened(
        tmp_path / "bag",
        clock=clock,
        disk=DiskRule(floor=5 * MB),
        free=lambda _: free[0],
    )
    recording.write([message(i) for i in range(10)])
    free[0] = 4 * MB
    clock.now = 1.0
    recording.tick()
    assert "4 MB free, the floor is 5 MB; free some space" in recording.trouble
    recording.write([message(i) for i in range(10, 30)])
    assert recording.lost == {"/a": 20}
    free[0] = 5 * MB + MARGIN_BYTES
    clock.now = 2.0
    recording.tick()
    assert recording.trouble == ""
    assert recording.missed == 20
    recording.write([message(i) for i in range(30, 35)])
    recording.close()
    assert recording.counts == {"/a": 15}
    assert recording.files == ("bag_0.mcap", "bag_1.mcap")
    with AnyReader([tmp_path / "bag"]) as reader:
        assert [t // PERIOD_NS for _, t, _ in reader.messages()] == [*range(10), *range(30, 35)]


def interrupted(tmp_path, harm):
    """Record 30 messages; somebody does harm after 10, which the flush after 20 notices."""
    clock, told = Clock(), list[str]()
    events = FileEvents(on_gone=told.append)
    recording = opened(tmp_path / "bag", clock=clock, events=events)
    for part in range(3):
        recording.write([message(10 * part + i) for i in range(10)])
        clock.now += 0.5
        if part == 0:
            recording.tick()
            harm(tmp_path / "bag")
        recording.tick()
        assert recording.trouble == ""
    recording.close()
    return recording, told


@pytest.mark.parametrize("target", ["bag_0.mcap", "."])
def test_what_somebody_deletes_is_noticed_counted_and_recording_goes_on(tmp_path, target):
    def harm(bag):
        shutil.rmtree(bag) if target == "." else (bag / target).unlink()

    recording, told = interrupted(tmp_path, harm)
    first = tmp_path / "bag" / "bag_0.mcap"
    assert told == [
        f"{first}: somebody deleted the file while 20 messages were in it: they count as lost"
    ]
    assert recording.files == ("bag_1.mcap",)
    assert values(tmp_path / "bag" / "bag_1.mcap") == list(range(20, 30))
    assert recording.counts == {"/a": 10}
    assert recording.lost == {"/a": 20}
    assert metadata(tmp_path / "bag")["relative_file_paths"] == ["bag_1.mcap"]


def test_what_somebody_cuts_is_noticed_counted_and_recording_goes_on(tmp_path):
    recording, told = interrupted(tmp_path, lambda bag: os.truncate(bag / "bag_0.mcap", 100))
    assert len(told) == 1
    assert "somebody cut the file while 20 messages were in it: they count as lost" in told[0]
    assert values(tmp_path / "bag" / "bag_1.mcap") == list(range(20, 30))
    assert recording.lost == {"/a": 20}
    assert metadata(tmp_path / "bag")["relative_file_paths"] == ["bag_0.mcap", "bag_1.mcap"]


def moved_away(bag):
    bag.rename(bag.with_name("elsewhere"))


def replaced_by_an_empty_one(bag):
    moved_away(bag)
    bag.mkdir()
    (bag / "mine.txt").write_text("nothing of a bag")


def replaced_by_another_bag(bag):
    other = opened(bag.with_name("other"))
    other.write([message(99)])
    other.close()
    moved_away(bag)
    bag.with_name("other").rename(bag)


@pytest.mark.parametrize("harm", [moved_away, replaced_by_an_empty_one, replaced_by_another_bag])
def test_a_folder_that_is_moved_or_replaced_costs_no_message(tmp_path, harm):
    recording, told = interrupted(tmp_path, harm)
    assert "or another one has its name while 20 messages were in it: it is" in told[0]
    assert values(tmp_path / "elsewhere" / "bag_0.mcap") == list(range(20))
    assert recording.lost == {"/a": 0}
    if harm is not replaced_by_another_bag:
        assert values(tmp_path / "bag" / "bag_1.mcap") == list(range(20, 30))
        assert metadata(tmp_path / "bag")["message_count"] == 10
        return
    bag, later = tmp_path / "bag", tmp_path / "bag_002"
    assert told[1:] == [f"{bag}: another bag took its place: recording to {later}"]
    assert recording.path == later
    assert values(tmp_path / "bag_002" / "bag_002_0.mcap") == list(range(20, 30))
    assert metadata(tmp_path / "bag_002")["message_count"] == 10
    assert metadata(tmp_path / "bag")["message_count"] == 1  # nobody wrote there


def test_a_disk_that_comes_back_with_its_files_is_the_same_bag(tmp_path):
    def harm(bag):
        shutil.copytree(bag, bag.with_name("copy"))
        shutil.rmtree(bag)

    clock = Clock()
    recording = opened(tmp_path / "bag", clock=clock, split=SplitRule(keep=9))
    recording.write([message(0)])
    recording.split()
    recording.write([message(1)])
    clock.now = 0.5
    recording.tick()
    harm(tmp_path / "bag")
    (tmp_path / "copy" / "bag_1.mcap").unlink()
    (tmp_path / "copy").rename(tmp_path / "bag")
    clock.now = 1.0
    recording.write([message(2)])
    recording.flush()
    recording.write([message(3)])
    recording.close()
    assert metadata(tmp_path / "bag")["relative_file_paths"] == ["bag_0.mcap", "bag_2.mcap"]
    assert bag_info(tmp_path / "bag").message_count == 2


def test_it_does_not_go_on_by_itself_where_this_is_not_wanted(tmp_path):
    clock = Clock()
    free = [0]
    rule = DiskRule(floor=MB, resume=False)
    recording = opened(tmp_path / "bag", clock=clock, disk=rule, free=lambda _: free[0])
    recording.write([message(0)])
    clock.now = 1.0
    recording.tick()
    free[0] = 100 * MB
    clock.now = 100.0
    recording.tick()
    assert recording.trouble
    recording.close()
    assert bag_info(tmp_path / "bag").message_count == 1


def test_the_oldest_files_give_way_where_this_is_wanted(tmp_path):
    clock = Clock()
    bag = tmp_path / "bag"
    rule = DiskRule(floor=MB, delete_oldest=True)
    recording = opened(
        bag,
        clock=clock,
        split=SplitRule(duration_s=0.1),
        disk=rule,
        free=lambda _: MB if len(list(bag.glob("*.mcap"))) <= 3 else MB - 1,
    )
    for i in range(100):
        clock.now = 0.6 * i
        recording.write([message(i)])
    assert recording.trouble == ""
    recording.close()
    left = sorted(p.name for p in bag.glob("*.mcap"))
    assert left == ["bag_2.mcap", "bag_3.mcap", "bag_4.mcap"]
    assert metadata(bag)["relative_file_paths"] == left
    assert bag_info(bag).message_count == metadata(bag)["message_count"] == 60
    with AnyReader([bag]) as reader:
        assert [t // PERIOD_NS for _, t, _ in reader.messages()] == list(range(40, 100))


@pytest.mark.parametrize("seed", range(6))
def test_a_full_disk_ends_the_file_soundly(tmp_path, monkeypatch, seed):
    """The disk takes so many bytes, in the middle of a record, and later more."""
    clock = Clock()
    room = [9_000 + 1_117 * seed]
    write = os.write

    def limited(number, data):
        if room[0] == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        size = min(len(data), room[0])
        room[0] -= size
        return write(number, bytes(data[:size]))

    monkeypatch.setattr("valve_twin.io.bags.file.os.write", limited)
    recording = opened(tmp_path / "bag", clock=clock, flush_s=0.05)
    for i in range(2000):
        clock.now = 0.01 * i
        recording.write([message(i)])
    assert "No space left on device" in recording.trouble
    file = tmp_path / "bag" / "bag_0.mcap"
    written = values(file)
    assert written == list(range(len(written)))
    assert recording.counts == {"/a": len(written)}
    assert recording.lost == {"/a": 2000 - len(written)}
    room[0] = 10 * MB
    clock.now += 60.0
    recording.tick()
    assert recording.trouble == ""
    recording.write([message(i) for i in range(2000, 2010)])
    recording.close()
    wanted = [*written, *range(2000, 2010)]
    with AnyReader([tmp_path / "bag"]) as reader:
        assert [t // PERIOD_NS for _, t, _ in reader.messages()] == wanted
    assert bag_info(tmp_path / "bag").message_count == len(wanted)


def test_a_bag_that_is_closed_on_a_full_disk_can_be_read_to_its_last_chunk(tmp_path, monkeypatch):
    room = [20_000]
    write = os.write

    def limited(number, data):
        size = min(len(data), room[0])
        room[0] -= size
        if size == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(number, bytes(data[:size]))

    monkeypatch.setattr("valve_twin.io.bags.file.os.write", limited)
    clock = Clock()
    recording = opened(tmp_path / "bag", clock=clock, flush_s=0.0)
    for i in range(500):
        recording.write([message(i)])
    written = recording.counts["/a"]
    assert 0 < written < 500
    recording.close()
    assert values(tmp_path / "bag" / "bag_0.mcap") == list(range(written))


def test_a_disk_of_two_megabytes_fills_and_is_recorded_to_again(tmp_path):
    place = tmp_path / "small"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=2m", "none", str(place)]
    if os.geteuid() or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("no right to mount a small file system")
    try:
        clock = Clock()
        ballast = place / "ballast"
        recording = opened(place / "bag", clock=clock, flush_s=0.1)
        ballast.write_bytes(bytes(MARGIN_BYTES + 512 * 1024))
        count = itertools.count()
        while not recording.trouble:
            clock.now += 0.01
            recording.write([RecordedMessage("/a", os.urandom(2000), next(count), 0)])
        assert "No space left on device" in recording.trouble
        ballast.unlink()
        clock.now += 60.0
        recording.write([message(1)])
        assert recording.trouble == ""
        recording.write([message(2)])
        recording.close()
        assert recording.files == ("bag_0.mcap", "bag_1.mcap")
        counts = []
        for name in recording.files:
            with (place / "bag" / name).open("rb") as stream:
                counts.append(sum(1 for _ in make_reader(stream).iter_messages()))
        assert sum(counts) == recording.counts["/a"]
        assert counts[1] == 1
        assert metadata(place / "bag")["message_count"] == sum(counts)
    finally:
        subprocess.run(["umount", str(place)], check=True)


def test_a_snapshot_is_a_file_of_its_own_with_its_reason(tmp_path):
    recording = opened(tmp_path / "bag", by_snapshot=True, split=SplitRule(keep=2))
    assert list(recording.files) == []
    for k in range(3):
        batch = [message(10 * k + i) for i in range(5)]
        name = recording.snapshot(batch, {"snapshot": {"trigger": f"number {k}"}})
        assert name == f"bag_{k}.mcap"
        assert bag_info(tmp_path / "bag").message_count == 5 * min(k + 1, 2)
    recording.close()
    assert recording.files == ("bag_1.mcap", "bag_2.mcap")
    with (tmp_path / "bag" / "bag_2.mcap").open("rb") as stream:
        notes = {m.name: m.metadata for m in make_reader(stream).iter_metadata()}
    assert notes["snapshot"] == {"trigger": "number 2"}


def test_a_snapshot_that_the_disk_refuses_is_named(tmp_path):
    recording = opened(
        tmp_path / "bag", by_snapshot=True, disk=DiskRule(floor=MB), free=lambda _: 0
    )
    with pytest.raises(BagError, match="0 MB free, the floor is 1 MB"):
        recording.snapshot([message(1)], {})
    recording.close()


def test_losses_stand_in_the_metadata_of_every_file(tmp_path):
    lost = itertools.count(1)
    recording = opened(
        tmp_path / "bag",
        split=SplitRule(duration_s=0.05),
        events=FileEvents(noted=lambda: {"lost_transport /a": next(lost)}),
    )
    recording.note({"serial": "4711"})
    recording.write([message(i) for i in range(25)])
    recording.close()
    found = []
    for name in recording.files:
        with (tmp_path / "bag" / name).open("rb") as stream:
            notes = {m.name: m.metadata for m in make_reader(stream).iter_metadata()}
        found.append(notes["valve_twin"])
    assert [f["lost_transport /a"] for f in found] == ["1", "2", "3"]
    assert {f["serial"] for f in found} == {"4711"}
    assert metadata(tmp_path / "bag")["custom_data"]["lost_transport /a"] == "4"


def test_a_sync_that_takes_long_does_not_hold_up_writing(tmp_path):
    """What comes during the sync is the kernel's within the time to flush all the same."""
    clock = Clock()
    disk = threading.Event()
    recording = opened(
        tmp_path / "bag", clock=clock, sync=lambda _: disk.wait(20), in_background=True
    )
    for i in range(400):
        clock.now = i * PERIOD_NS * 1e-9
        recording.write([message(i)])
    assert len(values(tmp_path / "bag" / "bag_0.mcap")) >= 300
    disk.set()
    recording.close()
    assert bag_info(tmp_path / "bag").message_count == 400


def test_the_error_of_a_late_sync_is_trouble_at_the_next(tmp_path):
    clock = Clock()
    failing = threading.Event()

    def sync(_number):
        if failing.is_set():
            failed.set()
            raise OSError(errno.EIO, "Input/output error")

    failed = threading.Event()
    recording = opened(tmp_path / "bag", clock=clock, sync=sync, in_background=True)
    failing.set()
    recording.write([message(0)])
    clock.now = 1.0
    recording.tick()
    assert failed.wait(20)
    failing.clear()
    end = time.monotonic() + 20.0
    while not recording.trouble and time.monotonic() < end:
        clock.now += 1.0
        recording.write([message(1)])
        recording.tick()
    assert "Input/output error" in recording.trouble
    recording.close()
