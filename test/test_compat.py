# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What stands in for interfaces that others keep private."""

import argparse
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


def shaped(codec, values: bytes, *dimensions: int) -> object:
    """Return what 8-bit numbers of a message are with dimensions."""
    said = b"".join(n.to_bytes(4, "little", signed=True) for n in (len(dimensions), *dimensions))
    data = b"\xc3" + len(values).to_bytes(4, "little") + values + said
    return codec.variant_from_binary(codec.Buffer(data)).Value


def test_dimensions_of_a_message_are_those_of_its_elements():
    """Dimensions of 4 bytes filled up to a million empty lists for each value of a message."""
    codec = pytest.importorskip("asyncua.ua.ua_binary", reason="needs the extra gateway")
    compat.bound_arrays()
    assert shaped(codec, bytes(range(6)), 2, 3) == [[0, 1, 2], [3, 4, 5]]
    assert shaped(codec, bytes(2), 2) == [0, 0]
    assert shaped(codec, b"", 0, 3) == []
    for values, dimensions in ((b"", (1_000_000,)), (bytes(6), (2, 4)), (b"", (-1, 3))):
        with pytest.raises(codec.UaError, match=f"array of {len(values)} elements with dimensi"):
            shaped(codec, values, *dimensions)
    with pytest.raises(codec.UaError, match="an array of 1000 elements"):
        shaped(codec, bytes(1000), 1000, *[1] * 300)  # 300 000 lists within lists


def test_a_client_takes_parts_as_long_as_it_asked_for():
    asyncua = pytest.importorskip("asyncua", reason="needs the extra gateway")
    client = asyncua.Client("opc.tcp://127.0.0.1:1")
    compat.bound_messages(client, 4_000_000, lambda why: None)
    limits = client.uaclient._make_protocol()._connection._limits
    hello = limits.create_hello_limits(asyncua.ua.Hello())
    for other in (8192, 1_000_000):
        answer = asyncua.ua.Acknowledge(ReceiveBufferSize=other, SendBufferSize=65535)
        limits.update_client_limits(answer)
        assert limits.max_recv_buffer == hello.ReceiveBufferSize == 65535
        assert limits.max_message_size <= 4_000_000


def test_no_array_of_a_message_is_longer_than_it_and_all_together_are_bounded():
    """Elements of nothing take no byte: 9 bytes of a message made lists of 16 GB."""
    codec = pytest.importorskip("asyncua.ua.ua_binary", reason="needs the extra gateway")

    def read(elements: int, more: bytes = b"") -> object:
        data = b"\x80" + elements.to_bytes(4, "little") + more
        return codec.variant_from_binary(codec.Buffer(data)).Value

    compat.bound_arrays()
    compat.bound_arrays(5)
    try:
        assert read(3, bytes(3)) == [None] * 3
        with pytest.raises(codec.UaError, match="an array of 30000000 elements in a message of 5"):
            read(30_000_000)
        with pytest.raises(codec.UaError, match="an array of 6 elements in a message of 25 bytes"):
            read(6, bytes(20))
        doubles = codec.Buffer(b"\x8b" + (2).to_bytes(4, "little") + bytes(16))
        assert codec.variant_from_binary(doubles).Value == [0.0, 0.0]
    finally:
        compat.bound_arrays()


def test_a_number_with_an_exponent_is_no_option():
    parser = argparse.ArgumentParser()
    parser.add_argument("--at", type=float, nargs="+")
    parser.add_argument("file", nargs="?")
    compat.take_exponents(parser)
    for text in ("-5e-4", "-5E+4", "-.5e3", "-5.e3", "-5", "-0.5"):
        assert parser.parse_args(["--at", text]).at == [float(text)]
    for text in ("-5e", "-e4", "-x"):
        with pytest.raises(SystemExit):
            parser.parse_args(["--at", text])
