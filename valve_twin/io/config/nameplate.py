# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The nameplate of a valve: what a maintenance department calls it and where it is."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from valve_twin.core.quantity import setting


@dataclass(frozen=True, slots=True)
class Nameplate:
    """What stands on the plate, as text; empty = not given."""

    tag: str = setting("", "Tag of the plant, such as FV-1205.")
    serial: str = setting("", "Serial number.")
    type: str = setting("", "Type of the maker.")
    place: str = setting("", "Where it is built in.")
    maker: str = setting("", "Who made it.")

    @property
    def given(self) -> dict[str, str]:
        """What is given, by name."""
        return {name: str(value) for name, value in asdict(self).items() if value}
