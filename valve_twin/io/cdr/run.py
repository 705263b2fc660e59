# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read many serialized Float64Stamped at once; their layout stands in `cdr`."""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import FloatArray, IntArray

_LITTLE = b"\x00\x01\x00\x00"
_SECOND_NS = 1_000_000_000
_TEXT = struct.Struct("<I")
_TEXT_AT = 12


def decode_stamped_run(messages: Sequence[bytes]) -> tuple[IntArray, FloatArray] | None:
    """Read many Float64Stamped of one layout at once.

    Parameters
    ----------
    messages : sequence of bytes
        N serialized messages, N >= 1.

    Returns
    -------
    (N,) int64 array, (N,) array
        Stamps [ns] and values; None where the messages differ in layout or are big-endian.
    """
    first = messages[0]
    size = len(first)
    if size < _TEXT_AT + 4 or first[:4] != _LITTLE:
        return None
    (text,) = _TEXT.unpack_from(first, _TEXT_AT)
    at = _TEXT_AT + 4 + text
    at += -(at - len(_LITTLE)) % 8
    data = b"".join(messages)
    if at + 8 > size or len(data) != size * len(messages):
        return None
    rows = np.frombuffer(data, dtype=_row(size, at))
    alike = (rows["kind"] == rows["kind"][0]) & (rows["text"] == text)
    if not (alike.all() and all(len(m) == size for m in messages)):
        return None
    stamps: IntArray = rows["sec"].astype(np.int64) * _SECOND_NS + rows["nanosec"]
    return stamps, rows["value"].astype(np.float64)


@lru_cache(maxsize=64)
def _row(size: int, value_at: int) -> np.dtype[np.void]:
    names = ["kind", "sec", "nanosec", "text", "value"]
    formats, offsets = ["<u4", "<i4", "<u4", "<u4", "<f8"], [0, 4, 8, 12, value_at]
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})
