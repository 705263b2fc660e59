# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Records as the messages that our nodes publish, made without ROS: same types, same fields."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from valve_twin.core.aging.verdict import Trend, Verdict
from valve_twin.core.records import flat
from valve_twin.core.types import Estimate, ParameterStatus
from valve_twin.io.bags.definitions import definition

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from rosbags.typesys.store import Typestore

ESTIMATE, TREND, VERDICT = (f"valve_twin_msgs/msg/{n}" for n in ("Estimate", "Trend", "Verdict"))
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"

_STATUS, _PAIR = "diagnostic_msgs/msg/DiagnosticStatus", "diagnostic_msgs/msg/KeyValue"
_TIME, _HEADER = "builtin_interfaces/msg/Time", "std_msgs/msg/Header"
_SECOND_NS = 1_000_000_000
_LAST_NS = (2**31 - 1) * _SECOND_NS
_OF = {Trend: TREND, Verdict: VERDICT}


class Condition(NamedTuple):
    """Condition of one thing, as a DiagnosticStatus says it.

    Attributes
    ----------
    name, hardware_id : str
        What is watched, and the valve.
    level : int
        0 = ok, 1 = warning, 2 = error, 3 = stale.
    message : str
        Why, in one line.
    values : mapping
        Figures by name.
    """

    name: str
    hardware_id: str
    level: int
    message: str
    values: Mapping[str, str]


def aging_bytes(record: Trend | Verdict) -> bytes:
    """Return a trend or a verdict as its message (CDR)."""
    return _serialized(_OF[type(record)], _named(record))


def estimate_bytes(valve: str, estimate: Estimate, units: Mapping[str, str]) -> bytes:
    """Return a stored estimate as the message that its twin published.

    Parameters
    ----------
    valve : str
        Its name.
    estimate : Estimate
        The estimate.
    units : mapping
        Unit by name of the parameter; "1" where one is not named.
    """
    found = _named(estimate)
    parameters = estimate.parameters
    found |= {
        "header": found["end"],
        "valve": valve,
        "units": [units.get(p.name, "1") for p in parameters],
        "at_bound": [p.status is ParameterStatus.AT_BOUND for p in parameters],
        "stored": True,
        "wall_time": 0.0,
    }
    return _serialized(ESTIMATE, found)


def diagnostics_bytes(stamp_ns: int, conditions: Iterable[Condition]) -> bytes:
    """Return conditions as a DiagnosticArray.

    Parameters
    ----------
    stamp_ns : int
        When this is said [ns since 1970].
    conditions : iterable of Condition
        One a thing that is watched.
    """
    types = _store(DIAGNOSTICS).types
    status = [
        types[_STATUS](
            level=c.level,
            name=c.name,
            message=c.message,
            hardware_id=c.hardware_id,
            values=[types[_PAIR](key=k, value=v) for k, v in c.values.items()],
        )
        for c in conditions
    ]
    return _serialized(DIAGNOSTICS, {"header": stamp_ns, "status": status})


def _named(record: object) -> dict[str, Any]:
    """Return the columns of a record by the names of their fields in the message."""
    found = {name.removesuffix("_ns"): value for name, value in flat(record).items()}
    if "stamp" in found:
        found["header"] = found.pop("stamp")
    return found


def _serialized(type_name: str, values: Mapping[str, Any]) -> bytes:
    store = _store(type_name)
    fields = {n: _put(store, kind, values[n]) for n, kind in store.fielddefs[type_name][1]}
    return bytes(store.serialize_cdr(store.types[type_name](**fields), type_name))


@cache
def _store(type_name: str) -> Typestore:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition(type_name), type_name))
    return store


def _put(store: Typestore, kind: Any, value: Any) -> Any:  # noqa: ANN401  of any field
    """Return a value as a field of a kind takes it."""
    node, about = kind
    if node is Nodetype.NAME:
        if about == _HEADER:
            return store.types[_HEADER](stamp=_put(store, (node, _TIME), value), frame_id="")
        sec, nanosec = divmod(min(max(int(value), 0), _LAST_NS), _SECOND_NS)
        return store.types[_TIME](sec=sec, nanosec=nanosec)
    if node is Nodetype.SEQUENCE:
        (inner, name), _ = about
        numbers = inner is Nodetype.BASE and name[0] != "string"
        return np.array(value, dtype=np.dtype(name[0])) if numbers else list(value)
    return value
