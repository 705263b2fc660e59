# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Tables of the history database and how values become rows and come back exactly.

The tables are derived from the records (`core.records`): a new field of `Estimate` is a new column
and needs a migration, a new field of one of its parts stands in the text of that part. Columns of
floating-point numbers hold NaN as NULL (SQLite knows no NaN); arrays are JSON text with Python's
shortest exact decimals, in which numbers that are not finite stand as the strings "nan", "inf" and
"-inf".
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from dataclasses import fields as dataclass_fields
from enum import IntEnum
from functools import lru_cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np
from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    Double,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    Text,
    UniqueConstraint,
    false,
)

from valve_twin.core.aging.verdict import Verdict
from valve_twin.core.operation.counters import Counters
from valve_twin.core.operation.events import Event
from valve_twin.core.past.condensate import Condensate, Condensed
from valve_twin.core.records import columns, fields, once_a_record, read_all
from valve_twin.core.types import (
    Cycle,
    Estimate,
    Maintenance,
    MaskCounts,
    ParameterStatus,
    ParameterValue,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from valve_twin.core.records import Column as RecordColumn
    from valve_twin.core.records import Field
    from valve_twin.core.types import Guard

SCHEMA_VERSION = "0011"
"""Revision of the schema of this code: the newest file in `migrations/versions`."""

SCHEMA_TABLE = "valve_twin_schema"
"""Table of alembic's revision, named so that it is not another application's."""

CHECK_SUM = "check_sum"
"""Column of the check sum of a row, see `check_sums`."""

UNSUMMED = {"maintenance": ("withdrawn", "withdrawn_note")}
"""Columns by table that came after the check sums: in a row's sum where they say something, so
that the sums of older rows hold."""

_ENCODER = json.JSONEncoder(separators=(",", ":"), allow_nan=False)

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class CycleRecord:
    """What the history keeps of a cycle: the fields of CycleSummary.msg and who computed it.

    Attributes
    ----------
    cycle : int
        Cycle number.
    start_ns, end_ns : int
        First and last stamp [ns].
    samples, lost : int
        Position samples in the cycle and samples known to be missing [1].
    missed_cycles : int
        Cycles missed before this one; -1 = unknown.
    accepted, reason : bool, str
        Whether it was handed to estimation, and why in one line.
    reproducible : bool
        All inputs carried header stamps and none was lost.
    software : str
        Version of valve_twin that stored it; empty where it was not yet recorded.
    """

    cycle: int
    start_ns: int
    end_ns: int
    samples: int
    lost: int = 0
    missed_cycles: int = 0
    accepted: bool = True
    reason: str = ""
    reproducible: bool = True
    software: str = ""


def cycle_record(cycle: Cycle, software: str = "") -> CycleRecord:
    """Return what the history keeps of `cycle`."""
    return CycleRecord(
        cycle=cycle.number,
        start_ns=cycle.start_ns,
        end_ns=cycle.end_ns,
        samples=len(cycle.frames),
        lost=cycle.lost,
        missed_cycles=cycle.missed_cycles,
        accepted=cycle.accepted,
        reason=cycle.reason,
        reproducible=cycle.reproducible,
        software=software,
    )


def _to_json(x: Any) -> Any:  # noqa: ANN401  a number, a word or a truth value
    return str(x) if isinstance(x, float) and not math.isfinite(x) else x


def number_of(x: float | str) -> float:
    """Return a number from how it stands in a text."""
    # numpy's one NaN object: == between dataclasses holds as it does between fresh ones
    return np.nan if x == "nan" else float(x)


def _or_null(x: float) -> float | None:
    return None if math.isnan(x) else float(x)


def _or_nan(x: float | None) -> float:
    return np.nan if x is None else x


@once_a_record
def _plain(record: type) -> tuple[RecordColumn, ...]:
    """Return the values of a record that have a column of their own, not a place in a text."""
    elsewhere = _ELSEWHERE.get(record, ())
    return tuple(c for c in columns(record) if not c.many and c.name not in elsewhere)


_ELSEWHERE = {
    Estimate: {"trend_reason", *(f"samples_masked_{m}" for m in MaskCounts.__slots__[1:])},
    Verdict: {"valve", "text", "held_back"},
    Event: {"valve"},
}
"""Columns of a record that stand in a text, or follow from others."""


METADATA = MetaData()
_Id = BigInteger().with_variant(Integer, "sqlite")
_SQL = {float: Double, int: BigInteger, bool: Boolean, str: Text}

_OF_COUNTERS = {"int": BigInteger, "float": Double, "bool": Boolean}
"""Columns of the counters by the annotation of a field; the bins are a text."""


def _id() -> Column[Any]:
    return Column("id", _Id, primary_key=True, autoincrement=True)


def _valve(*, key: bool = False, index: bool = False) -> Column[Any]:
    options: dict[str, Any] = {"primary_key": True, "autoincrement": False}
    options = options if key else {"index": index}
    return Column("valve_id", _Id, ForeignKey("valve.id"), nullable=False, **options)


def _sum() -> Column[Any]:
    return Column(CHECK_SUM, BigInteger, nullable=False, server_default="0")


def _columns(record: type, *but: str) -> list[Column[Any]]:
    """Return the columns of the plain values of a record but those that are declared by hand."""
    return [
        Column(c.name, _SQL.get(c.kind, Integer), nullable=c.kind is float)
        for c in _plain(record)
        if c.name not in but
    ]


META = Table(
    "meta",
    METADATA,
    Column("name", String(64), primary_key=True),
    Column("value", Text, nullable=False),
)
VALVE = Table(
    "valve", METADATA, _id(), Column("name", String(255), nullable=False, unique=True), _sum()
)
CYCLE = Table(
    "cycle",
    METADATA,
    _valve(key=True),
    Column("cycle", BigInteger, primary_key=True, autoincrement=False),
    *_columns(CycleRecord, "cycle", "software"),
    Column("software", Text, nullable=False, server_default=""),
    _sum(),
)
_LATER = ("reason_code",)
_HEAD = ("model", "start_ns", "end_ns", "status", "reason")
ESTIMATE = Table(
    "estimate",
    METADATA,
    _id(),
    _valve(),
    Column("cycle", BigInteger, nullable=False),
    Column("position", Integer, nullable=False),
    Column("estimator", String(64), nullable=False),
    *(c for c in _columns(Estimate) if c.name in _HEAD),
    Column("parameters", Text, nullable=False),
    *_columns(Estimate, "cycle", "estimator", *_HEAD, *_LATER),
    Column("samples_masked", Text, nullable=False),
    Column("findings", Text, nullable=False, server_default=""),
    *(Column(name, Text, nullable=False, server_default="") for name in _LATER),
    _sum(),
    UniqueConstraint("valve_id", "cycle", "estimator", name="uq_estimate_cycle"),
    Index("ix_estimate_estimator", "valve_id", "estimator", "cycle"),
)
MAINTENANCE = Table(
    "maintenance",
    METADATA,
    _id(),
    _valve(index=True),
    *_columns(Maintenance, *UNSUMMED["maintenance"]),
    Column("withdrawn", Boolean, nullable=False, server_default=false()),
    Column("withdrawn_note", Text, nullable=False, server_default=""),
    _sum(),
)
VERDICT = Table(
    "verdict",
    METADATA,
    _id(),
    _valve(index=True),
    *_columns(Verdict, "fault"),
    Column("fault", Text, nullable=False, server_default=""),
    _sum(),
)
EVENT = Table("event", METADATA, _id(), _valve(index=True), *_columns(Event, "id"), _sum())
CONDENSATE = Table(
    "condensate",
    METADATA,
    _id(),
    _valve(),
    *_columns(Condensate),
    _sum(),
    Index("ix_condensate", "valve_id", "estimator", "parameter", "span_s", "cycle"),
)
CONDENSED = Table(
    "condensed",
    METADATA,
    _valve(key=True),
    *_columns(Condensed),
    Column("state", Text, nullable=False),
    _sum(),
)
COUNTERS = Table(
    "counters",
    METADATA,
    _valve(key=True),
    *(
        Column(f.name, _OF_COUNTERS.get(str(f.type), Text), nullable=f.type == "float")
        for f in dataclass_fields(Counters)
    ),
    _sum(),
)


def to_row(value: object, valve_id: int) -> dict[str, Any]:
    """Return the row of a record in its table; of an estimate the values outside the texts."""
    names, read, put = _writing(type(value))
    row = {n: to_sql(x) for n, to_sql, x in zip(names, put, read(value), strict=True)}
    row["valve_id"] = valve_id
    return row


def from_row(record: type[T], row: Mapping[str, Any], **more: object) -> T:
    """Return the record of a row; `more` = the fields that have no column of their own."""
    for name, field, from_sql in _reading(record):
        more[field] = row[name] if from_sql is None else from_sql(row[name])
    make: Callable[..., T] = record
    return make(**more)


@once_a_record
def _writing(record: type) -> tuple[list[str], Callable[[object], tuple[Any, ...]], list[Any]]:
    """Return names of the columns, what reads all values, and what turns each into SQL's."""
    found = _plain(record)
    put = [_or_null if c.kind is float else _base(c.kind) for c in found]
    return [c.name for c in found], read_all([c.path for c in found]), put


@once_a_record
def _reading(record: type) -> list[tuple[str, str, Any]]:
    """Return name of the column, field, and what turns a value of SQL into ours if needed."""
    special = {float: _or_nan, int: None, bool: None, str: None}
    return [(c.name, c.field, special.get(c.kind, c.kind)) for c in _plain(record) if not c.part]


def _base(kind: type) -> type:
    return int if issubclass(kind, IntEnum) else kind


def estimate_row(valve_id: int, position: int, estimate: Estimate) -> dict[str, Any]:
    """Return the row of table `estimate`.

    Parameters
    ----------
    valve_id : int
        Key of the valve.
    position : int
        Place of the estimate among those of its cycle.
    estimate : Estimate
        The estimate.
    """
    row = to_row(estimate, valve_id)
    row["position"] = position
    row["parameters"] = _encode_parameters(estimate.parameters)
    row["samples_masked"] = _ENCODER.encode([int(n) for n in _MASKS(estimate.counts)])
    row["findings"] = _encode_findings(estimate)
    return row


def row_estimate(row: Mapping[str, Any]) -> Estimate:
    """Return the estimate of a row of table `estimate`, equal to the one stored in every field."""
    return from_row(
        Estimate,
        row,
        parameters=_decode_parameters(row["parameters"]),
        counts=MaskCounts(row["samples_used"], *_decode_masks(row["samples_masked"])),
        **_decode_findings(row["findings"]),
    )


@lru_cache(maxsize=1000)
def _decode_masks(text: str) -> tuple[int, ...]:
    return tuple(json.loads(text))


_MASKS = attrgetter(*MaskCounts.__slots__[1:])
_NUMBERS = attrgetter(
    *(c.part for c in columns(Estimate) if c.field == "parameters" and c.kind is float)
)
_FOUND = {f.name: f for f in fields(Estimate) if f.many and f.name != "parameters"}
"""The tuples of parts that stand in column `findings`."""

_READ = {name: attrgetter(*(c.part for c in f.columns)) for name, f in _FOUND.items()}


def _encode_parameters(parameters: Sequence[ParameterValue]) -> str:
    return _ENCODER.encode(
        {
            "names": [p.name for p in parameters],
            "status": [int(p.status) for p in parameters],
            "reasons": [p.reason for p in parameters],
            "values": [[_to_json(float(x)) for x in _NUMBERS(p)] for p in parameters],
        }
    )


def _decode_parameters(text: str) -> tuple[ParameterValue, ...]:
    data = json.loads(text)
    values = data["values"]
    if any(word in text for word in NOT_FINITE):
        values = [[number_of(x) for x in row] for row in values]
    return tuple(
        ParameterValue(name, v, _STATUS[status], reason, *rest)
        for name, status, reason, (v, *rest) in zip(
            data["names"], data["status"], data["reasons"], values, strict=True
        )
    )


NOT_FINITE = {'"nan"': "NaN", '"inf"': "Infinity", '"-inf"': "-Infinity"}
"""How numbers that are none stand in a text, and what Python's JSON reads as such; in a text
without them all are what JSON says."""

_STATUS = {int(status): status for status in ParameterStatus}


def _encode_findings(estimate: Estimate) -> str:
    """Return what was checked and compared as text; nothing as the empty text."""
    found: dict[str, Any] = {name: getattr(estimate, name) for name in _FOUND}
    if not estimate.trend_reason and not any(found.values()):
        return ""
    texts = {
        n: [[_to_json(x) for x in _READ[n](v)] for v in values] for n, values in found.items()
    }
    return _ENCODER.encode({"trend": estimate.trend_reason, **texts})


def decode_guards(rows: Sequence[Sequence[Any]]) -> tuple[Guard, ...]:
    """Return the checks of an estimate from how they stand in `findings`."""
    return cast("tuple[Guard, ...]", _decode_parts(_FOUND["guards"], rows))


def _decode_findings(text: str) -> dict[str, Any]:
    if not text:
        return _NOTHING_FOUND
    data = json.loads(text)
    found = {name: _decode_parts(field, data.get(name, ())) for name, field in _FOUND.items()}
    return {"trend_reason": data["trend"], **found}


_NOTHING_FOUND: dict[str, Any] = {"trend_reason": "", **dict.fromkeys(_FOUND, ())}


def _decode_parts(field: Field, rows: Sequence[Sequence[Any]]) -> tuple[object, ...]:
    """Return the parts of one field; a row from before the last fields takes their defaults."""
    assert field.part is not None
    kinds = [number_of if c.kind is float else c.kind for c in field.columns]
    return tuple(
        field.part(*(kind(x) for kind, x in zip(kinds, row, strict=False))) for row in rows
    )
