# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The state of a running twin in a file beside its SQLite history, for its restart.

A file and not a row: it is written every second without a flush and without the database's write
lock, no migration keeps old ones, and the only death after which it is worth something, the
process's, loses nothing of a file. It is written beside its place and renamed, and carries a check
sum: whatever a power cut leaves is whole or refused. Estimates are not in it but in the history.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from functools import cache, partial
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from valve_twin.core import state as states
from valve_twin.core.cycle_rules import RuleState
from valve_twin.core.estimation.cycle.memory import InForce, memory_from_history
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.types import Cycle, Frames
from valve_twin.io.errors import StoreError
from valve_twin.io.sealed import framed, read_sealed, seal, unsealed, write_sealed

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from _typeshed import DataclassInstance

    from valve_twin.core.state import TwinState
    from valve_twin.core.types import Estimate

_RECORDS = {
    record.__name__: record
    for record in (
        *(states.TwinState, states.AlignerState, states.TrackState, states.SegmenterState),
        *(states.Resume, states.Announced, states.Part, RuleState, Frames, Cycle, InForce),
    )
}
"""All that a state is made of beside numbers, words and arrays."""

_PLAIN = (int, float, str, bool, type(None))

_MAGIC = b"valve_twin snapshot "


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a snapshot comes from; one of another origin is of no use.

    Attributes
    ----------
    software : str
        Version of valve_twin.
    valve, configuration : str
        Name of the valve; its model, signals, period, cycle rule and options.
    cycle, start_ns : int
        Number and first stamp [ns] of the last stored cycle, 0 where none is.
    build : str
        What the code is that gives a state its meaning: versions have many builds.
    """

    software: str
    valve: str
    configuration: str
    cycle: int = 0
    start_ns: int = 0
    build: str = ""


_MEANING = {
    "software": "it is of another version of valve_twin",
    "valve": "it is of another valve",
    "configuration": "the valve was configured otherwise",
    "cycle": "the history ends with another cycle",
    "start_ns": "the history ends with another cycle",
    "build": "it is of another build of valve_twin or of the model",
}


def save_snapshot(path: Path, origin: Origin, state: TwinState) -> None:
    """Put a state in the place of the one before, at once or not at all.

    Parameters
    ----------
    path : Path
        The file.
    origin : Origin
        Where the state comes from; the history holds all that was learnt by then.
    state : TwinState
        The state.
    """
    learnt = [
        [ordinal, memory.estimates[-1].cycle if memory.estimates else 0, len(memory.estimates)]
        for ordinal, memory in state.memory_after
    ]
    arrays: list[np.ndarray[Any, Any]] = []
    head = {
        **asdict(origin),
        "layout": _layout(),
        "learnt": learnt,
        "state": _encode(replace(state, memory_after=()), arrays),
    }
    content = framed(head, arrays)
    write_sealed(path, path.with_name(f".{path.name}.part"), _MAGIC, content)


def load_snapshot(
    path: Path, origin: Origin, recent: Callable[[], Sequence[Estimate]]
) -> TwinState | None:
    """Return the state that was saved last, None where there is none.

    Parameters
    ----------
    path : Path
        The file.
    origin : Origin
        Where it is to come from.
    recent : callable
        Returns the newest estimates of the history, some cycles more than a memory holds.

    Raises
    ------
    StoreError
        If it cannot be used; one line that says why.
    """
    refused = partial(_refused, path)
    content = read_sealed(path, _MAGIC, refused, "it is no snapshot of a twin")
    if content is None:
        return None
    head, data = content
    if head.get("layout") != _layout():
        raise _refused(path, _MEANING["software"])
    for name, wanted in asdict(origin).items():
        if head[name] != wanted:
            raise _refused(path, _MEANING[name])
    state: TwinState = _decode(head["state"], BytesIO(data))
    return replace(state, memory_after=_memories(path, head["learnt"], recent()))


def save_cycle(path: Path, cycle: Cycle) -> None:
    """Write one cycle to a file with a check sum.

    Parameters
    ----------
    path : Path
        The file.
    cycle : Cycle
        The cycle.

    Raises
    ------
    OSError
        If the disk does not take it.
    """
    arrays: list[np.ndarray[Any, Any]] = []
    content = framed(_encode(cycle, arrays), arrays)
    path.write_bytes(seal(_MAGIC, content) + content)


def load_cycle(path: Path) -> Cycle | None:
    """Return the cycle that was saved, None where the file is gone or damaged."""
    try:
        content = unsealed(_MAGIC, path.read_bytes())
    except OSError:
        return None
    if content is None:
        return None
    head, data = content
    cycle: Cycle = _decode(head, BytesIO(data))
    return cycle


def _memories(path: Path, learnt: list[list[int]], recent: Sequence[Estimate]) -> Any:  # noqa: ANN401
    """Return what was learnt after which cycles, from the history that holds it."""
    found = []
    for ordinal, newest, count in learnt:
        memory = memory_from_history([e for e in recent if e.cycle <= newest])
        if len(memory.estimates) != count:
            raise _refused(path, "the history lacks estimates of that time")
        found.append((ordinal, memory))
    return tuple(found)


def _refused(path: Path, why: str) -> StoreError:
    return StoreError(f"{path}: is not used: {why}: cycles go on after the last stored one")


@cache
def _layout() -> str:
    """Return what changes with the fields of a state."""
    records = (Origin, *_RECORDS.values())
    names = [[record.__name__, *(f.name for f in fields(record))] for record in records]
    return hashlib.sha256(json.dumps(names).encode()).hexdigest()


@cache
def _names(record: type[DataclassInstance]) -> tuple[str, ...]:
    return tuple(f.name for f in fields(record))


def _encode(value: Any, arrays: list[np.ndarray[Any, Any]]) -> Any:  # noqa: ANN401
    """Return a state as JSON; its arrays are put behind it in their order."""
    if type(value) in _PLAIN:
        return value
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return {"array": value.dtype.str, "shape": value.shape}
    if is_dataclass(value):
        values = [_encode(getattr(value, name), arrays) for name in _names(value.__class__)]
        return {"record": type(value).__name__, "values": values}
    if isinstance(value, tuple):
        return [_encode(v, arrays) for v in value]
    if isinstance(value, Refusal):
        return {"refusal": value.code.value, "text": str(value)}
    plain = value.item() if isinstance(value, np.generic) else value
    if type(plain) not in _PLAIN:
        msg = f"a state holds a {type(value).__name__}, which a snapshot cannot keep"
        raise TypeError(msg)
    return plain


def _decode(value: Any, data: BytesIO) -> Any:  # noqa: ANN401
    """Return what was encoded; the arrays lie in the order in which they are met."""
    if isinstance(value, list):
        return tuple(_decode(v, data) for v in value)
    if not isinstance(value, dict):
        return value
    if "record" in value:
        return _RECORDS[value["record"]](*(_decode(v, data) for v in value["values"]))
    if "refusal" in value:
        return Refusal(RefusalCode(value["refusal"]), value["text"])
    kind, shape = np.dtype(value["array"]), tuple(value["shape"])
    size = kind.itemsize * int(np.prod(shape, dtype=np.int64))
    return np.frombuffer(data.read(size), kind).reshape(shape).copy()
