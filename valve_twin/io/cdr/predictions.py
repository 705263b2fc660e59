# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Many serialized Predictions as columns at once, for who looks at all of them live."""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

_LITTLE = b"\x00\x01\x00\x00"
_TEXT_AT = 12
_TEXT = struct.Struct("<I")
_COLUMNS = ("measured", "predicted", "simulated", "residual", "residual_sigma")


def decode_prediction_run(messages: Sequence[bytes]) -> NDArray[np.void] | None:
    """Read many Prediction messages of one layout at once.

    Parameters
    ----------
    messages : sequence of bytes
        N serialized messages, N >= 1.

    Returns
    -------
    (N,) structured array or None
        Fields `sec`, `nanosec`, `cycle`, `measured`, `predicted`, `simulated`, `residual` and
        `residual_sigma`; None where they have to be read one by one.
    """
    size = len(messages[0])
    if size < _TEXT_AT + 4 or messages[0][:4] != _LITTLE:
        return None
    (text,) = _TEXT.unpack_from(messages[0], _TEXT_AT)
    at = _TEXT_AT + 4 + text
    at += -(at - len(_LITTLE)) % 8
    if at + 50 > size or any(len(m) != size for m in messages):
        return None
    rows: NDArray[np.void] = np.frombuffer(b"".join(messages), dtype=_row(size, at))
    alike = (rows["kind"] == rows["kind"][0]) & (rows["text"] == text)
    return rows if alike.all() else None


@lru_cache(maxsize=64)
def _row(size: int, at: int) -> np.dtype[np.void]:
    names = ["kind", "sec", "nanosec", "text", "cycle", *_COLUMNS]
    formats = ["<u4", "<i4", "<u4", "<u4", "<u8", *["<f8"] * len(_COLUMNS)]
    offsets = [0, 4, 8, 12, at, *(at + 8 * k for k in range(1, len(_COLUMNS) + 1))]
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})
