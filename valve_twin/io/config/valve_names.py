# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Names of many valves in a few words: press/valve_{01..50} stands for fifty."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

MOST_VALVES = 1000
"""Most valves in one list: more is a slip of the pen, assumed."""

_RANGE = re.compile(r"\{(\d+)\.\.(\d+)\}")


def expand_names(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names with each {first..last} written out, in their order.

    Parameters
    ----------
    names : sequence of str
        Such as "press/valve_{01..50}"; leading zeros are kept, empty names are left out.

    Returns
    -------
    tuple of str
        One name a valve.

    Raises
    ------
    ValueError
        If a range runs backwards or is too long; one line with the name and what to do.
    """
    found: list[str] = []
    for name in names:
        if name:
            found += _expanded(name)
        if len(found) > MOST_VALVES:
            msg = f"'{name}' makes more than {MOST_VALVES} valves; write a shorter range"
            raise ValueError(msg)
    return tuple(found)


def _expanded(name: str) -> list[str]:
    match = _RANGE.search(name)
    if match is None:
        return [name]
    first, last = int(match[1]), int(match[2])
    if last < first or last - first >= MOST_VALVES:
        msg = (
            f"'{name}': write {{first..last}} with first <= last and at most {MOST_VALVES} "
            "valves, such as valve_{01..50}"
        )
        raise ValueError(msg)
    width = len(match[1]) if match[1].startswith("0") else 0
    written = [
        f"{name[: match.start()]}{number:0{width}d}{name[match.end() :]}"
        for number in range(first, last + 1)
    ]
    return [one for text in written for one in _expanded(text)]
