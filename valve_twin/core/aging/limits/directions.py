# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Directions of a valve of which no cycle ever told anything, while the other one is followed."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping


def mute_direction(estimated: Mapping[str, bool]) -> tuple[str, ...]:
    """Return the followed parameters of a direction that never gave an estimate.

    Parameters of two directions have one name but for its end, as `x_up`, `x_down`.
    One of them without estimates may not be shown, such as a limit of the speed. A direction of
    which none has any while the other one has is not judged.

    Parameters
    ----------
    estimated : mapping of str to bool
        Of each followed parameter, whether any cycle gave an estimate.
    """
    groups: dict[str, dict[str, bool]] = {}  # by direction: stem -> ever estimated
    for name, known in estimated.items():
        stem, _, way = name.rpartition("_")
        if stem:
            groups.setdefault(way, {})[stem] = known
    for way, stems in groups.items():
        others = (v for w, v in groups.items() if w != way)
        told = any(v.get(stem, False) for v in others for stem in stems)
        if told and not any(stems.values()):
            return tuple(f"{stem}_{way}" for stem in stems)
    return ()
