# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is rewritten of a damaged bag is sound, whole and read by others."""

import hashlib
import shutil

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from test.bag_samples import write_sample
from valve_twin.io.bags.read import BagWriter, QosProfile, bag_info, read_signals
from valve_twin.io.bags.report import bag_report, report_lines
from valve_twin.io.cdr.signals import STAMPED_TYPE, SignalSource
from valve_twin.io.errors import BagError
from valve_twin.io.offline.recover import Digests, recover, verify
from valve_twin.io.salvage.read import salvage_file

START_NS = 1_577_836_800_000_000_000
LATCHED = QosProfile(reliability="best_effort", durability="transient_local", depth=3)
POSITION = SignalSource("position", "/press/position")


def write(path, first=0, count=400):
    with BagWriter(path, chunk_size=2000) as bag:
        bag.note({"valve": "/press/valve_1"})
        bag.add_topic("/press/position", STAMPED_TYPE, qos=(LATCHED,))
        for i in range(first, first + count):
            write_sample(bag, "/press/position", START_NS + i, float(i))
            write_sample(bag, "/press/command", START_NS + i, -float(i))
    return path / f"{path.name}_0.mcap"


@pytest.fixture
def bag(tmp_path):
    write(tmp_path / "bag")
    return tmp_path / "bag"


def damage(file, share=0.3, flip=0x55):
    data = bytearray(file.read_bytes())
    chunks = salvage_file(file).summary.chunks
    chunk = chunks[int(len(chunks) * share)]
    data[chunk.offset + chunk.length // 2] ^= flip
    file.write_bytes(data)


def lost(found):
    assert found.lost_count is not None
    return found.lost_count


def digest(folder):
    return {p.name: hashlib.sha256(p.read_bytes()).digest() for p in folder.iterdir()}


def test_a_recovered_bag_is_read_whole_by_others(bag, tmp_path):
    damage(bag / "bag_0.mcap")
    before = digest(bag)
    found = recover(bag, tmp_path / "new")
    assert digest(bag) == before
    assert 0 < lost(found) < 40
    assert found.count == 800 - lost(found)
    assert found.unverified == 0
    with AnyReader([tmp_path / "new"]) as reader:
        assert reader.message_count == found.count
        positions = [
            reader.deserialize(raw, c.msgtype).value  # type: ignore[attr-defined]
            for c, _, raw in reader.messages()
            if c.topic == "/press/position"
        ]
        position = next(c for c in reader.connections if "position" in c.topic)
        (offer,) = position.ext.offered_qos_profiles  # type: ignore[union-attr]
        assert (offer.depth, offer.durability.name) == (3, "TRANSIENT_LOCAL")
    with (tmp_path / "new" / "new_0.mcap").open("rb") as stream:
        assert sum(1 for _ in make_reader(stream).iter_messages()) == found.count
    assert set(positions) <= set(np.arange(400.0).tolist())
    assert len(positions) == found.topics["/press/position"]


def test_a_recovered_bag_keeps_its_own_values_and_says_what_it_lost(bag, tmp_path):
    damage(bag / "bag_0.mcap")
    found = recover(bag, tmp_path / "new")
    custom = bag_info(tmp_path / "new").custom
    assert custom["valve"] == "/press/valve_1"
    assert custom["recovered_from"] == "bag"
    assert custom["recovered_lost_messages"] == str(found.lost_count)
    (loss,) = found.losses
    line = loss.line()
    for part in ("bag_0.mcap: byte ", "chunk", "/press/position (", "from 2020-01-01T00:00:00.0"):
        assert part in line


def test_a_sound_bag_is_rewritten_whole(bag, tmp_path):
    found = recover(bag, tmp_path / "new")
    assert (found.count, found.lost_count, found.losses) == (800, 0, ())


def test_files_of_a_split_bag_become_one_bag(tmp_path):
    first, second = write(tmp_path / "a"), write(tmp_path / "b", first=400)
    split = tmp_path / "split"
    split.mkdir()
    shutil.copy(first, split / "split_0.mcap")
    shutil.copy(second, split / "split_1.mcap")
    damage(split / "split_1.mcap")
    found = recover(split, tmp_path / "new")
    assert found.count == 1600 - lost(found)
    (block, *rest) = read_signals(tmp_path / "new", [POSITION])
    assert not rest
    assert np.all(np.diff(block.stamp_ns) > 0)


def test_a_cut_bag_counts_by_the_metadata_beside_it(bag, tmp_path):
    file = bag / "bag_0.mcap"
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 3])
    found = recover(bag, tmp_path / "new")
    assert found.count + lost(found) == 800
    assert found.lost == {
        name: 400 - found.topics[name] for name in ("/press/position", "/press/command")
    }


def test_damaged_metadata_is_not_believed(bag, tmp_path):
    path = bag / "metadata.yaml"
    text = path.read_text(encoding="utf-8")
    sound = text.index("message_count: 400")
    path.write_text(text[:sound] + "message_count: 900" + text[sound + 18 :], encoding="utf-8")
    data = (bag / "bag_0.mcap").read_bytes()
    (bag / "bag_0.mcap").write_bytes(data[: len(data) // 3])
    found = recover(bag, tmp_path / "new")
    assert found.lost_count is None
    assert "unknown" in found.losses[-1].line()


@pytest.mark.parametrize("place", range(0, 700, 23))
def test_any_byte_of_the_metadata_may_be_wrong(bag, tmp_path, place):
    path = bag / "metadata.yaml"
    data = bytearray(path.read_bytes())
    data[place] ^= 0x15
    path.write_bytes(data)
    assert recover(bag, tmp_path / "new").count == 800


def test_a_missing_file_is_told(bag, tmp_path):
    path = bag / "metadata.yaml"
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["rosbag2_bagfile_information"]["relative_file_paths"].append("bag_1.mcap")
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    found = recover(bag, tmp_path / "new")
    assert found.count == 800
    assert found.lost_count is None
    assert "bag_1.mcap: the file is missing" in found.notes[0]


def test_nothing_to_recover_is_one_line_and_no_bag(bag, tmp_path):
    file = bag / "bag_0.mcap"
    file.write_bytes(file.read_bytes()[:60])
    with pytest.raises(BagError, match=r"nothing in it can be recovered; .*byte 45") as caught:
        recover(bag, tmp_path / "new")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "new").exists()


def test_an_existing_folder_is_left_alone(bag, tmp_path):
    with pytest.raises(BagError, match="exists already"):
        recover(bag, bag)
    assert bag_info(bag).message_count == 800


def test_what_does_not_read_back_is_refused(bag):
    expected = Digests()
    expected.add("/press/position", START_NS, START_NS, b"other")
    with pytest.raises(BagError, match="does not read back as it was written"):
        verify(bag, expected)


def test_a_report_says_what_is_damaged(bag):
    sound = bag_report(bag, verify=True)
    assert not sound["damaged"]
    assert sound["topics"][1]["rate_hz"] == pytest.approx(1e9)
    assert sound["topics"][1]["qos"][0]["durability"] == "transient_local"
    damage(bag / "bag_0.mcap")
    assert not bag_report(bag)["damaged"]
    report = bag_report(bag, verify=True)
    assert report["damaged"]
    assert report["messages"] is not None
    assert report["lost_messages"] is not None
    assert report["messages"] + report["lost_messages"] == 800
    lines = report_lines(report)
    assert lines[-1].endswith("rewrite the bag with 'valve-twin recover'")
    assert any(line.startswith("damage: ") and ": byte " in line for line in lines)


@pytest.mark.parametrize("name", ["convert_b", "multiple_files", "cdr_test", "wbag", "array_msgs"])
def test_bags_of_real_recorders_are_rewritten_whole(measured, tmp_path, name):
    path = measured / "rosbag2_bags" / name
    found = recover(path, tmp_path / "new")
    assert (found.lost_count, found.losses, found.notes) == (0, (), ())
    assert found.count == bag_info(path).message_count
    assert bag_info(tmp_path / "new").message_count == found.count
