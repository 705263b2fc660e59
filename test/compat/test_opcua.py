# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What stands in for what asyncua keeps private."""

import pytest

from valve_twin.compat import opcua


def shaped(codec, values: bytes, *dimensions: int) -> object:
    """Return what 8-bit numbers of a message are with dimensions."""
    said = b"".join(n.to_bytes(4, "little", signed=True) for n in (len(dimensions), *dimensions))
    data = b"\xc3" + len(values).to_bytes(4, "little") + values + said
    return codec.variant_from_binary(codec.Buffer(data)).Value


def test_dimensions_of_a_message_are_those_of_its_elements():
    """Dimensions of 4 bytes filled up to a million empty lists for each value of a message."""
    codec = pytest.importorskip("asyncua.ua.ua_binary", reason="needs the extra gateway")
    opcua.bound_arrays()
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
    opcua.bound_messages(client, 4_000_000, lambda why: None)
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

    opcua.bound_arrays()
    opcua.bound_arrays(5)
    try:
        assert read(3, bytes(3)) == [None] * 3
        with pytest.raises(codec.UaError, match="an array of 30000000 elements in a message of 5"):
            read(30_000_000)
        with pytest.raises(codec.UaError, match="an array of 6 elements in a message of 25 bytes"):
            read(6, bytes(20))
        doubles = codec.Buffer(b"\x8b" + (2).to_bytes(4, "little") + bytes(16))
        assert codec.variant_from_binary(doubles).Value == [0.0, 0.0]
    finally:
        opcua.bound_arrays()
