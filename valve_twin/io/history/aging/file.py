# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is known of one valve's aging in a file, with a check sum.

The file saves reading the history and changes nothing: every writer writes it beside its place
under a name of his own and renames it, and one that is damaged, of another build, valve or layout
is not used.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from valve_twin import __version__
from valve_twin.core.aging.cutting.memory import Memory
from valve_twin.core.past.stored import thaw
from valve_twin.io.errors import StoreError
from valve_twin.io.history.restart import build_of
from valve_twin.io.sealed import framed, read_sealed, write_sealed

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from valve_twin.core.aging.config import AgingConfig
    from valve_twin.core.past.state import AgingState

_MAGIC = b"valve_twin aging "
_LAYOUT = 2


@dataclass(slots=True)
class Known:
    """What is known of one valve.

    Attributes
    ----------
    state : AgingState
        Its estimates.
    memory : Memory
        What was found in them.
    place : dict
        How far the history was read; words and numbers of whoever reads it.
    """

    state: AgingState
    memory: Memory
    place: dict[str, Any]


def origin_of(valve: str, model: str) -> dict[str, Any]:
    """Return what a file must agree in to be used.

    Parameters
    ----------
    valve, model : str
        Names of the valve and of its model.
    """
    return {
        "layout": _LAYOUT,
        "software": __version__,
        "valve": valve,
        "model": model,
        "build": build_of(model),
    }


def pack(
    frozen: tuple[dict[str, Any], list[NDArray[Any]]],
    memory: Memory,
    place: dict[str, Any],
    origin: dict[str, Any],
    config: AgingConfig,
) -> bytes:
    """Return the content of a file.

    Parameters
    ----------
    frozen : tuple
        What `freeze` returned of a state.
    memory : Memory
        What was found in it.
    place : dict
        See `Known`.
    origin : dict
        See `origin_of`.
    config : AgingConfig
        The rules that the memory is of.
    """
    state, arrays = frozen
    searches, found = memory.freeze()
    head = {
        "origin": origin,
        "place": place,
        "config": repr(config),
        "state": state,
        "memory": searches,
        "arrays": [[a.dtype.str, len(a)] for a in (*arrays, *found)],
        "of_state": len(arrays),
    }
    return framed(head, (*arrays, *found))


def write(path: Path, content: bytes) -> None:
    """Put what was packed in the place of the file before, at once or not at all.

    Parameters
    ----------
    path : Path
        The file.
    content : bytes
        What `pack` returned.

    Raises
    ------
    OSError
        If the disk does not take it.
    """
    part = path.with_name(f".{path.name}.{secrets.token_hex(8)}.part")
    write_sealed(path, part, _MAGIC, content)


def load(path: Path, origin: dict[str, Any], config: AgingConfig) -> Known | None:
    """Return what was stored, None where there is none.

    Parameters
    ----------
    path : Path
        The file.
    origin : dict
        What it must agree in.
    config : AgingConfig
        The rules; searches by others are not taken over.

    Raises
    ------
    StoreError
        If it is not used; one line that says why.
    """
    content = read_sealed(path, _MAGIC, partial(_refused, path))
    if content is None:
        return None
    head, data = content
    for name, wanted in origin.items():
        if head["origin"].get(name) != wanted:
            raise _refused(path, f"it is of another {name}")
    arrays, at = [], 0
    for kind, size in head["arrays"]:
        dtype = np.dtype(kind)
        arrays.append(np.frombuffer(data, dtype, size, at))
        at += dtype.itemsize * size
    count, memory = head["of_state"], Memory()
    if head["config"] == repr(config):
        memory.thaw(head["memory"], arrays[count:])
    return Known(thaw(head["state"], arrays[:count]), memory, head["place"])


def _refused(path: Path, why: str) -> StoreError:
    return StoreError(f"{path}: is not used: {why}: the history is read anew")
