# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a verdict tells beside the trends, such as a direction of which no cycle told anything."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from valve_twin.core.types import Parameter


class Beside(NamedTuple):
    """What is known beside the trends.

    Attributes
    ----------
    since : int
        First cycle that the newest ones are compared with.
    mute : tuple of str
        Followed parameters of a direction of which no cycle told anything.
    short : mapping
        By parameter, the reason of its trend without what else is to be known of it.
    """

    since: int = 1
    mute: tuple[str, ...] = ()
    short: Mapping[str, str] = MappingProxyType({})


ALONE = Beside()
"""Nothing is known beside them."""


def mute_direction(estimated: Iterable[tuple[Parameter, bool]]) -> tuple[str, ...]:
    """Return the followed parameters of a direction that never gave an estimate.

    One of them without estimates may not be shown, such as a limit of the speed. A direction of
    which none has any while the other one has is not judged.

    Parameters
    ----------
    estimated : iterable of (Parameter, bool)
        Each followed parameter, and whether any cycle gave an estimate of it.
    """
    groups: dict[str, dict[str, tuple[str, bool]]] = {}  # by direction and what: name, estimated?
    for parameter, known in estimated:
        if parameter.sided:
            what, way = parameter.sided
            groups.setdefault(way, {})[what] = parameter.name, known
    for way, own in groups.items():
        others = [v for w, v in groups.items() if w != way]
        told = any(other[what][1] for other in others for what in own if what in other)
        if told and not any(known for _, known in own.values()):
            return tuple(name for name, _ in own.values())
    return ()
