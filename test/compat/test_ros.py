# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What stands in for what rclpy keeps private."""

from types import SimpleNamespace

import pytest

from test.programmed import programmed
from valve_twin.compat import ros


@pytest.mark.parametrize("arguments", [("m", {"i": 1}), (("m", {"i": 1}),)])
def test_message_and_info_come_with_either_executor(arguments):
    assert ros.message_and_info(arguments) == ("m", {"i": 1})


def test_an_answer_is_intercepted_and_can_be_sent():
    sent, seen = [], []
    service = SimpleNamespace(send_response=lambda *answer: sent.append(answer))
    send = ros.intercept_responses(service, lambda *answer: seen.append(answer))
    service.send_response("response", "header")
    assert (sent, seen) == ([], [("response", "header")])
    send(*seen[0])
    assert sent == seen


TYPES_ALONE = """
import sys
from valve_twin.compat import ros

ros.load_types_alone()
from std_msgs.msg import Int64
from rclpy.type_support import check_for_type_support

check_for_type_support(Int64)
assert "lark" not in sys.modules
import rosidl_generator_py.generate_py_impl
print("lark" in sys.modules)
"""


def test_a_message_type_finds_its_library_without_what_generates_it():
    pytest.importorskip("rclpy", reason="needs ROS 2")
    assert programmed(TYPES_ALONE) == "True\n"
