# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The end of a message about a name that is not known; numbers that are not what they seem."""

from __future__ import annotations

import re
from difflib import get_close_matches
from functools import lru_cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

ODD_NUMBER = re.compile(r"[-+]?(\d[\d_]*(:\d+)+(\.\d*)?|.*_.*|0[xXbBoO].*|0\d+)")
"""Numbers of YAML 1.1 that people write as something else: 1:30, 1_000, 0x10, 010."""


def suggest(name: str, known: Iterable[str], *, shown: int = 12) -> str:
    """Say which known name is nearest to a wrong one, or which there are.

    Parameters
    ----------
    name : str
        The name that is not known.
    known : iterable of str
        Valid names.
    shown : int
        How many names are listed at most where none is near.

    Returns
    -------
    str
        "did you mean 'x'?", "there are a, b, c" or "there are none".
    """
    names = tuple(dict.fromkeys(known))
    near = nearest(name, names)
    if near is not None:
        return f"did you mean '{near}'?"
    if not names:
        return "there are none"
    return f"there are {listed(names, shown)}"


def listed(names: Sequence[str], shown: int) -> str:
    """Return names as a list: so many at the most, then how many more."""
    more = f" and {len(names) - shown} more" if len(names) > shown else ""
    return ", ".join(names[:shown]) + more


def nearest(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that is nearest, None if none is near."""
    return _nearest(name, tuple(dict.fromkeys(known)))


@lru_cache(maxsize=1024)  # a twin asks again and again for each topic that is missing
def _nearest(name: str, names: tuple[str, ...]) -> str | None:
    return next(iter(get_close_matches(name, names, n=1, cutoff=0.5)), None)
