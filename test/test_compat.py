# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What stands in for interfaces that others keep private."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from valve_twin import compat


@pytest.mark.parametrize("arguments", [("m", {"i": 1}), (("m", {"i": 1}),)])
def test_message_and_info_come_with_either_executor(arguments):
    assert compat.message_and_info(arguments) == ("m", {"i": 1})


def test_an_answer_is_intercepted_and_can_be_sent():
    sent, seen = [], []
    service = SimpleNamespace(send_response=lambda *answer: sent.append(answer))
    send = compat.intercept_responses(service, lambda *answer: seen.append(answer))
    service.send_response("response", "header")
    assert (sent, seen) == ([], [("response", "header")])
    send(*seen[0])
    assert sent == seen


def test_the_interpreter_is_shared():
    before = sys.getswitchinterval()
    try:
        compat.share_interpreter()
        assert sys.getswitchinterval() == pytest.approx(compat.SWITCH_S)
    finally:
        sys.setswitchinterval(before)


KERNELS_ALONE = """
import sys
from valve_twin import compat

compat.load_kernels_alone()
import numpy as np
from valve_twin.core.estimation.cycle.movement import find_moves
from valve_twin.kernels import njit

assert find_moves(np.linspace(0.0, 1.0, 8)).travel > 0.9
early = {"cffi", "numba.np.linalg"} & sys.modules.keys()
solve = njit(lambda a, b: np.linalg.solve(a, b))(2.0 * np.eye(2), np.ones(2))
assert solve.tolist() == [0.5, 0.5]
print(*early, *({"scipy.linalg"} & sys.modules.keys()), "was needed")
"""


def test_a_kernel_comes_from_its_cache_without_the_compiler_and_one_of_none_is_compiled():
    """What a compiler needs is not there before; what BLAS needs comes with its first call."""
    assert programmed(KERNELS_ALONE).split()[-3:] == ["scipy.linalg", "was", "needed"]
    assert programmed(KERNELS_ALONE) == "scipy.linalg was needed\n"  # now it is in the cache


TYPES_ALONE = """
import sys
from valve_twin import compat

compat.load_types_alone()
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


def programmed(program):
    """Return what a program of its own prints."""
    command = [sys.executable, "-c", program]
    root = Path(__file__).parents[1]
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd=root).stdout
