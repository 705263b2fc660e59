# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the aging of a valve is judged by, as a text that stands in the history.

It keeps what condensed cycles said to the last bit. A version of valve_twin that cannot read it
goes on from the estimates that were kept, which are those that it holds.
"""

from __future__ import annotations

import base64
import json
import zlib
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.past.stored import freeze, thaw
from valve_twin.io.limits import CONSTRUCTORS_MEET
from valve_twin.io.sealed import framed

if TYPE_CHECKING:
    from valve_twin.core.past.state import AgingState

_MOST_BYTES = 64 << 20  # what a state unpacks to; one of a million cycles takes far less [B]


def state_text(state: AgingState) -> str:
    """Return a state as a text; it may go on afterwards."""
    head, arrays = freeze(state)
    shapes = [[a.dtype.str, len(a)] for a in arrays]
    content = framed({"state": head, "arrays": shapes}, arrays)
    return base64.b64encode(zlib.compress(content, 1)).decode()


def text_state(text: str) -> AgingState | None:
    """Return the state of a text; None where this version cannot read it."""
    try:
        packed = zlib.decompressobj()
        content = packed.decompress(base64.b64decode(text), _MOST_BYTES)
        if not packed.eof:
            return None
        line, _, data = content.partition(b"\n")
        head = json.loads(line)
        arrays, at = [], 0
        for kind, size in head["arrays"]:
            dtype = np.dtype(kind)
            arrays.append(np.frombuffer(data, dtype, size, at))
            at += dtype.itemsize * size
        return thaw(head["state"], arrays)
    except (*CONSTRUCTORS_MEET, zlib.error):
        return None
