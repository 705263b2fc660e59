# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A sealed file comes back whole or not at all."""

import numpy as np
import pytest

from valve_twin.io.sealed import framed, seal, unsealed

MAGIC = b"valve_twin test "
CONTENT = framed({"n": 3}, [np.arange(3.0), np.array([10], dtype=np.uint8)])  # 10 is a line end
WHOLE = seal(MAGIC, CONTENT) + CONTENT


def test_head_and_arrays_come_back():
    found = unsealed(MAGIC, WHOLE)
    assert found is not None
    assert found[0] == {"n": 3}
    assert found[1] == np.arange(3.0).tobytes() + b"\n"


@pytest.mark.parametrize("at", [0, 20, len(WHOLE) - 30, len(WHOLE) - 1])
def test_a_changed_byte_a_missing_end_and_another_kind_are_damage(at):
    changed = bytearray(WHOLE)
    changed[at] ^= 1
    assert unsealed(MAGIC, bytes(changed)) is None
    assert unsealed(MAGIC, WHOLE[:at]) is None
    assert unsealed(b"valve_twin other ", WHOLE) is None
