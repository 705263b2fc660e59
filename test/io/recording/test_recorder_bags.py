# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Bags that real ROS 2 recorders and tools wrote open whole, or one line says why not."""

import pytest
from mcap.reader import make_reader

from test.bag_samples import read_texts
from valve_twin.io.bags.read import bag_info, bag_types, read_signals
from valve_twin.io.cdr.bag_types import BagTypes
from valve_twin.io.cdr.signals import SignalSource
from valve_twin.io.errors import BagError
from valve_twin.io.playback.player import read_messages

BAGS = {
    "array_msgs": 2,
    "bag_with_topics_and_service_events": 10,
    "cdr_test": 7,
    "convert_b": 75,
    "multiple_files": 3177,
    "only_topics.mcap": 7,
    "rewriter_b": 75,
    "test_bag_for_seek": 5,
    "wbag": 6074,
}
UNREADABLE = {"/test_service1/_service_event", "/test_service2/_service_event"}
"""Events of services: their recorder wrote the definition of the service, not of the event."""


@pytest.fixture
def bags(measured):
    return measured / "rosbag2_bags"


@pytest.mark.parametrize(("name", "count"), BAGS.items())
def test_every_message_is_counted(bags, name, count):
    info = bag_info(bags / name)
    assert info.message_count == count
    assert sum(t.count for t in info.topics) == count


def test_every_bag_of_the_folder_is_tested(bags):
    assert {p.name for p in bags.iterdir()} - {"PROVENANCE.txt"} == set(BAGS)


@pytest.mark.parametrize(("name", "count"), BAGS.items())
def test_every_message_is_there_and_decoded_or_one_line_says_why_not(bags, name, count):
    info = bag_info(bags / name)
    topics = [t.name for t in info.topics]
    found = list(read_messages(bags / name, topics))
    assert len(found) == count
    for topic in info.topics:
        mine = [m for m in found if m.topic == topic.name]
        assert len(mine) == topic.count
        if topic.name in UNREADABLE:
            line = f"topic '{topic.name}': the bag holds no readable definition of [^\n]*$"
            with pytest.raises(BagError, match=line):
                bag_types(bags / name, topic.name)
            continue
        types = bag_types(bags / name, topic.name)
        assert isinstance(types, BagTypes)
        for message in mine:
            assert types.decode(message.data, message.log_ns) is not None


@pytest.mark.parametrize("name", ["multiple_files", "wbag"])
def test_split_bags_are_read_whole_and_in_order(bags, name):
    info = bag_info(bags / name)
    for topic in info.topics:
        texts = read_texts(bags / name, topic.name)
        assert len(texts) == topic.count
    assert len(info.files) > 1


def test_a_joint_state_is_read_through_the_mapping(bags):
    source = SignalSource(
        "x", "/one_shot/joint_state", "sensor_msgs/msg/JointState", "position[1]"
    )
    (block,) = read_signals(bags / "array_msgs", [source])
    assert block.values.tolist() == [-0.5]
    assert len(block.stamp_ns) == 1


def test_numbers_agree_with_another_decoder(bags):
    mcap_ros2 = pytest.importorskip(
        "mcap_ros2.decoder", reason="mcap-ros2-support is not installed"
    )
    path = bags / "cdr_test" / "cdr_test_0.mcap"
    source = SignalSource("x", "/test_topic", "test_msgs/msg/BasicTypes", "float64_value")
    found = [float(v) for b in read_signals(path, [source]) for v in b.values]
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[mcap_ros2.DecoderFactory()])
        expected = [
            m.float64_value for _, c, _, m in reader.iter_decoded_messages(["/test_topic"])
        ]
    assert found == expected
    assert len(found) == 3


def test_log_times_that_begin_at_zero_are_times(bags):
    info = bag_info(bags / "rewriter_b")
    assert (info.start_ns, info.end_ns) == (0, 222_000_000)
