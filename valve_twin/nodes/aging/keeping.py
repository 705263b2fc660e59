# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a monitor knows of one valve, kept in a file for its next start.

The file saves asking for the whole history and decides nothing: the twin is asked for the newest
estimates that it holds as well, and for all maintenance events. Where the answer differs from the
file in either, all is asked for anew.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from valve_twin.core.past.stored import freeze
from valve_twin.io.errors import StoreError, unwritable
from valve_twin.io.history.aging.file import load, origin_of, pack, write

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.aging.cutting.memory import Memory
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.io.history.aging.file import Known
    from valve_twin.nodes.aging.estimate_buffer import EstimateBuffer

WORTH = 1000
"""Estimates from which on a file is kept [1], assumed: as many are asked for within a second."""

EVERY = 200
"""Estimates after which it is written again [1], assumed: what came since is asked for."""


AGAIN = 10
"""Estimates after which it is tried again where it could not be written [1], assumed."""


class Keeper:
    """The file of one valve.

    Parameters
    ----------
    folder : str
        Where it lies, made where it is missing; empty = nothing is kept.
    config : ValveConfig
        The valve.

    Attributes
    ----------
    trouble : str
        Why the folder cannot be used now, empty where it can: what is known is kept all the same
        as soon as it can be.
    """

    def __init__(self, folder: str, config: ValveConfig) -> None:
        self._config, self._kept, self._written = config, 0, 0
        self._path: Path | None = None
        self.trouble = ""
        if folder:
            place = Path(folder).absolute()
            try:
                place.mkdir(parents=True, exist_ok=True)
            except OSError as err:
                self.trouble = (
                    f"state_folder {unwritable(place, err)}; nothing is kept for the next start"
                    " meanwhile"
                )
            self._path = place / f"aging{config.name.replace('/', '.')}"

    def load(self, tell: Callable[[str], object]) -> Known | None:
        """Return what was kept, None where nothing was or it is of no use.

        Parameters
        ----------
        tell : callable
            Gets one line where it is of no use.
        """
        if self.trouble:
            tell(self.trouble)
        if self.trouble or self._path is None:
            return None
        try:
            known = load(self._path, self._origin(), self._config.aging)
        except StoreError as err:
            tell(str(err))
            return None
        self._kept = self._written = sum(known.place["counts"].values()) if known else 0
        return known

    def outdated(self) -> None:
        """Have the file written anew as soon as all is known again: it holds too little."""
        self._kept = self._written = 0

    def done(self, *, failed: bool) -> None:
        """Note how the last work ended."""
        if failed:
            self._kept -= EVERY - AGAIN
        else:
            self._written = self._kept

    def due(self, buffer: EstimateBuffer, *, ends: bool = False) -> bool:
        """Return whether it is to be written: so many are new, or any where the monitor ends."""
        count = sum(buffer.counts.values())
        is_new = count > self._written if ends else count >= self._kept + EVERY
        return self._path is not None and count >= WORTH and is_new

    def saving(self, buffer: EstimateBuffer, memory: Memory) -> Callable[[], None]:
        """Return the work that writes what is known now; what comes meanwhile is not in it.

        Parameters
        ----------
        buffer : EstimateBuffer
            What is known.
        memory : Memory
            What was found in it; read when the work is done.
        """
        self._kept = sum(buffer.counts.values())
        return partial(self._save, freeze(buffer.state), buffer.place(), memory)

    def _save(self, state: tuple[Any, Any], place: dict[str, Any], memory: Memory) -> None:
        if self._path is not None:
            content = pack(state, memory, place, self._origin(), self._config.aging)
            try:
                self._path.parent.mkdir(parents=True, exist_ok=True)  # where somebody removed it
                write(self._path, content)
            except OSError as err:
                raise StoreError(unwritable(self._path, err)) from err

    def _origin(self) -> dict[str, Any]:
        return origin_of(self._config.name, self._config.model)
