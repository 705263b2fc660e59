# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Messages of a bag of storage sqlite3 that a query passes over are told."""

from __future__ import annotations

import shutil
import sqlite3
import time
from contextlib import closing

import pytest
import zstandard

from test.io.instruments import foreign_files as foreign
from test.io.test_limits import LAUGHS
from valve_twin.io.errors import BagError
from valve_twin.io.instruments.read import kind_of, read_recording


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sqlite") / "bag"
    foreign.sqlite_bag(folder)
    return folder


@pytest.fixture
def bag(made, tmp_path):
    return shutil.copytree(made, tmp_path / "bag")


def change(bag, *statements):
    with closing(sqlite3.connect(next(bag.glob("*.db3")))) as database, database:
        for statement in statements:
            database.execute(statement)


def rewrite(bag, before, after):
    path = bag / "metadata.yaml"
    text = path.read_text(encoding="utf-8")
    assert before in text
    path.write_text(text.replace(before, after), encoding="utf-8")


def test_of_a_sound_one_nothing_is_told(bag):
    found = read_recording(bag)
    assert found.notices == ()
    assert len(found.columns[0].values) == foreign.N


def test_a_message_without_a_topic_is_told(bag):
    change(bag, "UPDATE messages SET topic_id = 77 WHERE id = 5")
    (line,) = read_recording(bag).notices
    assert line.startswith(f"{bag}: 1 of 200 messages cannot be found: ")


def test_a_row_that_its_index_lacks_is_told(bag):
    change(bag, "PRAGMA writable_schema = ON",
           "UPDATE sqlite_master SET sql = replace(sql, '(timestamp ASC)', '(timestamp ASC)"
           " WHERE id <> 5') WHERE name = 'timestamp_idx'")  # fmt: skip
    change(bag, "REINDEX")
    change(bag, "PRAGMA writable_schema = ON",
           "UPDATE sqlite_master SET sql = replace(sql, ' WHERE id <> 5', '')"
           " WHERE name = 'timestamp_idx'")  # fmt: skip
    damaged, passed_over = read_recording(bag).notices
    assert "is damaged (" in damaged
    assert "timestamp_idx" in damaged
    assert " 1 of 200 messages cannot be found" in passed_over


def test_what_metadata_and_files_do_not_agree_upon_is_told(bag):
    change(bag, "DELETE FROM messages WHERE id > 150")
    assert read_recording(bag).notices == (
        f"{bag}: metadata.yaml counts 200 messages, its files 150",
    )


def test_a_topic_that_metadata_describes_otherwise_is_told(bag):
    change(bag, "INSERT INTO topics SELECT 2, '/q', type, serialization_format,"
           " offered_qos_profiles, type_description_hash FROM topics",
           "UPDATE messages SET topic_id = 2 WHERE id > 120")  # fmt: skip
    (line,) = read_recording(bag).notices
    assert line.startswith(f"{bag}: 80 of 200 messages cannot be found: ")


def test_a_file_that_metadata_does_not_name_is_told(bag):
    (file,) = bag.glob("*.db3")
    shutil.copy(file, bag / "more.db3")
    assert read_recording(bag).notices == (
        f"{bag / 'more.db3'}: is not named in metadata.yaml and left out",
    )


def test_messages_in_the_log_of_a_killed_recorder_are_told(bag, tmp_path):
    (file,) = bag.glob("*.db3")
    with closing(sqlite3.connect(file)) as recorder:
        recorder.execute("PRAGMA journal_mode=WAL")
        recorder.execute("INSERT INTO messages SELECT id + 1000, topic_id, timestamp, data"
                         " FROM messages")  # fmt: skip
        recorder.commit()
        left = shutil.copytree(bag, tmp_path / "left")
    told = read_recording(left).notices
    assert len(told) == 1
    assert f"{file.name}-wal beside it is not read" in told[0]


@pytest.mark.parametrize("what", ["laughs", "packed", "none", "other"])
def test_what_may_not_be_unpacked_is_refused_at_once(bag, what):
    metadata = bag / "metadata.yaml"
    if what == "laughs":
        metadata.write_text(LAUGHS)
    elif what == "none":
        metadata.unlink()
    elif what == "other":
        metadata.write_text("rosbag2_bagfile_information: [1]")
    else:
        (file,) = bag.glob("*.db3")
        rewrite(bag, "compression_mode: ''", "compression_mode: FILE")
        rewrite(bag, "compression_format: ''", "compression_format: zstd")
        rewrite(bag, file.name, f"{file.name}.zstd")
        packer = zstandard.ZstdCompressor().compressobj()
        with file.with_name(f"{file.name}.zstd").open("wb") as out:
            for _ in range(3000):
                out.write(packer.compress(bytes(1 << 20)))
            out.write(packer.flush())
        file.unlink()
    assert kind_of(bag) == "sqlite"
    begin = time.process_time()
    with pytest.raises(BagError, match=r"metadata\.yaml|packed as a whole"):
        read_recording(bag)
    assert time.process_time() - begin < 5.0
