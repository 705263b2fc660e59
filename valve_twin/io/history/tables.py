# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Tables of the history database and how values become rows and come back exactly.

Floating-point columns hold NaN as NULL (SQLite knows no NaN); arrays are JSON text with Python's
shortest exact decimals, in which numbers that are not finite stand as the strings "nan", "inf" and
"-inf".
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypedDict

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
)

from valve_twin.core.types import (
    Condition,
    Cycle,
    Disagreement,
    Estimate,
    EstimateStatus,
    Guard,
    Maintenance,
    MaskCounts,
    ParameterStatus,
    ParameterValue,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

SCHEMA_VERSION = "0004"
"""Revision of the schema of this code: the newest file in `migrations/versions`."""

SCHEMA_TABLE = "valve_twin_schema"
"""Table of alembic's revision, named so that it is not another application's."""

_ENCODER = json.JSONEncoder(separators=(",", ":"), allow_nan=False)

METADATA = MetaData()
_Id = BigInteger().with_variant(Integer, "sqlite")

META = Table(
    "meta",
    METADATA,
    Column("name", String(64), primary_key=True),
    Column("value", Text, nullable=False),
)
VALVE = Table(
    "valve",
    METADATA,
    Column("id", _Id, primary_key=True, autoincrement=True),
    Column("name", String(255), nullable=False, unique=True),
)
CYCLE = Table(
    "cycle",
    METADATA,
    Column("valve_id", _Id, ForeignKey("valve.id"), primary_key=True, autoincrement=False),
    Column("cycle", BigInteger, primary_key=True, autoincrement=False),
    Column("start_ns", BigInteger, nullable=False),
    Column("end_ns", BigInteger, nullable=False),
    Column("samples", BigInteger, nullable=False),
    Column("lost", BigInteger, nullable=False),
    Column("missed_cycles", BigInteger, nullable=False),
    Column("accepted", Boolean, nullable=False),
    Column("reason", Text, nullable=False),
    Column("reproducible", Boolean, nullable=False),
    Column("software", Text, nullable=False, server_default=""),
)
ESTIMATE = Table(
    "estimate",
    METADATA,
    Column("id", _Id, primary_key=True, autoincrement=True),
    Column("valve_id", _Id, ForeignKey("valve.id"), nullable=False),
    Column("cycle", BigInteger, nullable=False),
    Column("position", Integer, nullable=False),
    Column("estimator", String(64), nullable=False),
    Column("model", Text, nullable=False),
    Column("start_ns", BigInteger, nullable=False),
    Column("end_ns", BigInteger, nullable=False),
    Column("status", Integer, nullable=False),
    Column("reason", Text, nullable=False),
    Column("parameters", Text, nullable=False),
    Column("mse_test", Double),
    Column("mse_train", Double),
    Column("fit_test", Double),
    Column("fit_train", Double),
    Column("condition_number", Double),
    Column("lag", BigInteger, nullable=False),
    Column("noise_sigma", Double),
    Column("samples_used", BigInteger, nullable=False),
    Column("samples_masked", Text, nullable=False),
    Column("missed_cycles", BigInteger, nullable=False),
    Column("used_by_trend", Boolean, nullable=False),
    Column("reproducible", Boolean, nullable=False),
    Column("findings", Text, nullable=False, server_default=""),
    UniqueConstraint("valve_id", "cycle", "estimator", name="uq_estimate_cycle"),
    Index("ix_estimate_estimator", "valve_id", "estimator", "cycle"),
)
MAINTENANCE = Table(
    "maintenance",
    METADATA,
    Column("id", _Id, primary_key=True, autoincrement=True),
    Column("valve_id", _Id, ForeignKey("valve.id"), nullable=False, index=True),
    Column("stamp_ns", BigInteger, nullable=False),
    Column("cycle", BigInteger, nullable=False),
    Column("note", Text, nullable=False),
    Column("new_reference", Boolean, nullable=False),
)


class _Findings(TypedDict):
    """The fields of an `Estimate` that stand in column `findings`."""

    trend_reason: str
    disagreements: tuple[Disagreement, ...]
    guards: tuple[Guard, ...]
    conditions: tuple[Condition, ...]


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


def cycle_row(valve_id: int, record: CycleRecord) -> dict[str, Any]:
    """Return the row of table `cycle` for a record."""
    return {
        "valve_id": valve_id,
        "cycle": int(record.cycle),
        "start_ns": int(record.start_ns),
        "end_ns": int(record.end_ns),
        "samples": int(record.samples),
        "lost": int(record.lost),
        "missed_cycles": int(record.missed_cycles),
        "accepted": bool(record.accepted),
        "reason": record.reason,
        "reproducible": bool(record.reproducible),
        "software": record.software,
    }


def row_cycle(row: Mapping[str, Any]) -> CycleRecord:
    """Return the record of a row of table `cycle`."""
    return CycleRecord(**{name: row[name] for name in CycleRecord.__slots__})


def estimate_row(valve_id: int, position: int, estimate: Estimate) -> dict[str, Any]:
    """Return the row of table `estimate`; `position` is its place among those of its cycle."""
    counts = estimate.counts
    return {
        "valve_id": valve_id,
        "cycle": int(estimate.cycle),
        "position": position,
        "estimator": estimate.estimator,
        "model": estimate.model,
        "start_ns": int(estimate.start_ns),
        "end_ns": int(estimate.end_ns),
        "status": int(estimate.status),
        "reason": estimate.reason,
        "parameters": _encode_parameters(estimate.parameters),
        "mse_test": _or_null(estimate.mse_test),
        "mse_train": _or_null(estimate.mse_train),
        "fit_test": _or_null(estimate.fit_test),
        "fit_train": _or_null(estimate.fit_train),
        "condition_number": _or_null(estimate.condition_number),
        "lag": int(estimate.lag),
        "noise_sigma": _or_null(estimate.noise_sigma),
        "samples_used": int(counts.used),
        "samples_masked": _ENCODER.encode(
            [int(counts.seat), int(counts.stuck), int(counts.stale), int(counts.bad)]
        ),
        "missed_cycles": int(estimate.missed_cycles),
        "used_by_trend": bool(estimate.used_by_trend),
        "reproducible": bool(estimate.reproducible),
        "findings": _encode_findings(estimate),
    }


def row_estimate(row: Mapping[str, Any]) -> Estimate:
    """Return the estimate of a row of table `estimate`, equal to the one stored in every field."""
    return Estimate(
        model=row["model"],
        estimator=row["estimator"],
        cycle=row["cycle"],
        start_ns=row["start_ns"],
        end_ns=row["end_ns"],
        parameters=_decode_parameters(row["parameters"]),
        status=EstimateStatus(row["status"]),
        reason=row["reason"],
        mse_test=_or_nan(row["mse_test"]),
        mse_train=_or_nan(row["mse_train"]),
        fit_test=_or_nan(row["fit_test"]),
        fit_train=_or_nan(row["fit_train"]),
        condition_number=_or_nan(row["condition_number"]),
        lag=row["lag"],
        noise_sigma=_or_nan(row["noise_sigma"]),
        counts=MaskCounts(row["samples_used"], *json.loads(row["samples_masked"])),
        missed_cycles=row["missed_cycles"],
        used_by_trend=bool(row["used_by_trend"]),
        reproducible=bool(row["reproducible"]),
        **_decode_findings(row["findings"]),
    )


def maintenance_row(valve_id: int, event: Maintenance) -> dict[str, Any]:
    """Return the row of table `maintenance` for an event."""
    return {
        "valve_id": valve_id,
        "stamp_ns": int(event.stamp_ns),
        "cycle": int(event.cycle),
        "note": event.note,
        "new_reference": bool(event.new_reference),
    }


def row_maintenance(row: Mapping[str, Any]) -> Maintenance:
    """Return the event of a row of table `maintenance`."""
    return Maintenance(row["stamp_ns"], row["cycle"], row["note"], bool(row["new_reference"]))


def _encode_parameters(parameters: Sequence[ParameterValue]) -> str:
    numbers = [[p.value, p.standard_error, p.lower_95, p.upper_95] for p in parameters]
    return _ENCODER.encode(
        {
            "names": [p.name for p in parameters],
            "status": [int(p.status) for p in parameters],
            "reasons": [p.reason for p in parameters],
            "values": [[_to_json(float(x)) for x in row] for row in numbers],
        }
    )


def _decode_parameters(text: str) -> tuple[ParameterValue, ...]:
    data = json.loads(text)
    return tuple(
        ParameterValue(
            name, _from_json(v), ParameterStatus(status), reason, *(_from_json(x) for x in rest)
        )
        for name, status, reason, (v, *rest) in zip(
            data["names"], data["status"], data["reasons"], data["values"], strict=True
        )
    )


def _encode_findings(estimate: Estimate) -> str:
    """Return what was checked and compared as text; nothing as the empty text."""
    told = (estimate.trend_reason, estimate.disagreements, estimate.guards, estimate.conditions)
    if not any(told):
        return ""
    return _ENCODER.encode(
        {
            "trend": estimate.trend_reason,
            "disagreements": [
                [d.estimator, d.parameter, _to_json(d.difference), _to_json(d.standard_errors)]
                for d in estimate.disagreements
            ],
            "guards": [
                [g.name, g.passed, _to_json(g.value), _to_json(g.limit), g.reason]
                for g in estimate.guards
            ],
            "conditions": [[c.name, _to_json(c.value)] for c in estimate.conditions],
        }
    )


def _decode_findings(text: str) -> _Findings:
    if not text:
        return _Findings(trend_reason="", disagreements=(), guards=(), conditions=())
    data = json.loads(text)
    return _Findings(
        trend_reason=data["trend"],
        disagreements=tuple(
            Disagreement(other, name, _from_json(apart), _from_json(errors))
            for other, name, apart, errors in data["disagreements"]
        ),
        guards=tuple(
            Guard(name, passed, _from_json(value), _from_json(limit), reason)
            for name, passed, value, limit, reason in data["guards"]
        ),
        conditions=tuple(Condition(name, _from_json(value)) for name, value in data["conditions"]),
    )


def _to_json(x: float) -> float | str:
    return x if math.isfinite(x) else str(x)


def _from_json(x: float | str) -> float:
    # numpy's one NaN object: == between dataclasses holds as it does between fresh ones
    return np.nan if x == "nan" else float(x)


def _or_null(x: float) -> float | None:
    return None if math.isnan(x) else float(x)


def _or_nan(x: float | None) -> float:
    return np.nan if x is None else x
