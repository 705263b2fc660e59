# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A bag that others cut, change or replace while it is read: told, and no process ends by it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from mcap.writer import Writer

from test.bag_samples import write_sample
from valve_twin.io.bags.writer import BagWriter
from valve_twin.io.errors import BagError
from valve_twin.io.playback.choice import Stretch
from valve_twin.io.playback.player import bag_topics, read_messages
from valve_twin.io.playback.reel import Reel

if TYPE_CHECKING:
    from pathlib import Path

S = 10**9
TOPIC = "/value"
CHANGED = "was cut, changed, replaced or deleted while it was read; read it anew"
LONG = 300
"""Messages of a bag of thirty chunks [1]."""

READ_ON = """
import os, sys
from pathlib import Path
from valve_twin.io.errors import BagError
from valve_twin.io.playback.player import read_messages

path = Path(sys.argv[1])
found = read_messages(path, ["/value"])
next(found)
(file,) = path.glob("*.mcap")
os.truncate(file, 1000)
try:
    for _ in found:
        pass
except BagError as err:
    print(err)
"""
"""In a process of its own: without the check the system ends it."""

CUT_MEANWHILE = """
import os, sys
from pathlib import Path
from valve_twin.io.errors import BagError
from valve_twin.io.mcap import reader
from valve_twin.io.salvage import read, scan

path, how = Path(sys.argv[1]), sys.argv[2]
reader.STRIDE = scan.STRIDE = 0  # it is looked each time

def cut():
    os.truncate(path, 1000)

def cutting(records):
    for i, record in enumerate(records):
        if i == 500:
            cut()
        yield record

try:
    if how == "messages":
        reader._PIECE = 1 << 17
        pieces = reader.McapFile(path).loose_messages()
        next(pieces)
        cut()
        list(pieces)
    elif how == "summary":
        whole = reader.records_of
        reader.records_of = lambda data: cutting(whole(data))
        reader.McapFile(path)
    else:
        whole, steps = scan.Scan._step, cutting(iter(int, 1))  # zeros
        scan.Scan._step = lambda self, at: whole(self, at) + next(steps)
        read.salvage_file(path)
except BagError as err:
    print(err)
"""
"""The same for a file without chunks; what is read until the next check may end it still."""


def make(path: Path, first: float = 0.0, chunks: int = LONG // 10) -> Path:
    with BagWriter(path) as writer:
        for i in range(10 * chunks):
            write_sample(writer, TOPIC, i * S // 10, first + i)
            if i % 10 == 9:
                writer.flush()  # which closes a chunk
    return path


def the_file(bag: Path) -> Path:
    (file,) = bag.glob("*.mcap")
    return file


def test_a_file_that_is_cut_while_it_is_read_ends_no_process(tmp_path):
    bag = make(tmp_path / "bag")
    done = subprocess.run(
        [sys.executable, "-c", READ_ON, str(bag)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{the_file(bag)}: {CHANGED}\n"


@pytest.mark.parametrize("how", ["messages", "summary", "salvage"])
def test_a_file_without_chunks_that_is_cut_while_it_is_read_ends_no_process(tmp_path, how):
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        says = how == "messages"
        writer = Writer(stream, use_chunking=False, use_statistics=says)
        writer.start("ros2", "test")
        channel = writer.register_channel(TOPIC, "cdr", 0)
        for i in range(2000):
            writer.add_message(channel, i, bytes(1000), i)
        writer.finish()
    done = subprocess.run(
        [sys.executable, "-c", CUT_MEANWHILE, str(path), how],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{path}: {CHANGED}\n"


def test_a_file_that_is_written_anew_while_it_is_read_is_told(tmp_path):
    """What it holds now was not asked for: its times may be any."""
    bag, other = make(tmp_path / "bag"), make(tmp_path / "other", 1000.0, 40)
    found = read_messages(bag, [TOPIC])
    next(found)
    the_file(bag).write_bytes(the_file(other).read_bytes()[50:])
    with pytest.raises(BagError, match=CHANGED):
        list(found)


def test_what_is_damaged_is_not_looked_for_in_a_file_that_took_its_place(tmp_path):
    bag, other = make(tmp_path / "bag"), make(tmp_path / "other", 1000.0)
    found = read_messages(bag, [TOPIC])
    next(found)
    with the_file(bag).open("r+b") as file:
        file.seek(the_file(bag).stat().st_size // 2)
        file.write(bytes(200))
    os.replace(the_file(other), the_file(bag))
    with pytest.raises(BagError, match=CHANGED):
        list(found)


@pytest.mark.parametrize("how", ["deleted", "replaced", "grown"])
def test_what_is_open_is_read_to_its_end(tmp_path, how):
    bag = make(tmp_path / "bag")
    found = read_messages(bag, [TOPIC])
    first = next(found)
    if how == "deleted":
        shutil.rmtree(bag)
    elif how == "replaced":
        os.replace(the_file(make(tmp_path / "other", 1000.0)), the_file(bag))
    else:
        with the_file(bag).open("ab") as file:
            file.write(b"what a recorder adds")
    assert [first.log_ns, *(m.log_ns for m in found)] == [i * S // 10 for i in range(LONG)]


def test_a_reel_that_cannot_go_elsewhere_stays_where_it_is(tmp_path):
    bag = make(tmp_path / "bag")
    whole = Stretch(0, (LONG - 1) * S // 10)
    reel = Reel(bag, bag_topics(bag), whole, whole)
    taken = [reel.take() for _ in range(5)]
    shutil.rmtree(bag)
    with pytest.raises(BagError, match="there is no such file"):
        reel.go(Stretch(S, whole.end_ns))
    while reel.next is not None:
        taken.append(reel.take())
    assert [m.log_ns for m in taken if m] == [i * S // 10 for i in range(LONG)]


@pytest.mark.parametrize("how", ["file", "folder"])
def test_a_reel_plays_no_bag_that_took_the_place_of_its_own(tmp_path, how):
    """A `seek`, `play` or `loop` went on in the other one, or ended, in silence."""
    bag, other = make(tmp_path / "bag"), make(tmp_path / "other", 1000.0)
    whole = Stretch(0, (LONG - 1) * S // 10)
    (topic,) = bag_topics(bag)
    latched = replace(topic, qos=replace(topic.qos, durability="transient_local"))
    reel = Reel(bag, [latched], whole, whole)
    taken = [reel.take()]
    if how == "file":
        os.replace(the_file(other), the_file(bag))
    else:
        bag.rename(tmp_path / "moved")
        other.rename(bag)  # whose files have another name
    with pytest.raises(BagError, match=f"{bag}: {CHANGED}"):
        reel.go(Stretch(S, whole.end_ns))
    with pytest.raises(BagError, match=f"{bag}: {CHANGED}"):
        reel.state_before(S)
    while reel.next is not None:
        taken.append(reel.take())
    assert [m.log_ns for m in taken if m] == [i * S // 10 for i in range(LONG)]
