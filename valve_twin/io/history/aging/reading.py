# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read what a verdict on a valve rests on, of a long history only what came since.

What was read is kept beside a SQLite history, also one that is open for reading only, by the
user that the history belongs to: nobody else leaves files there. It is used only where the history
still holds the very row that was read last and no row came behind it for a cycle before: else all
is read anew.
"""

from __future__ import annotations

import os
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import sqlalchemy as sa

from valve_twin.core.aging.cutting.memory import Memory
from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.past.stored import freeze
from valve_twin.core.refusal import RefusalCode
from valve_twin.io.errors import StoreError
from valve_twin.io.history.aging import WORTH
from valve_twin.io.history.aging.bulk import add_rows
from valve_twin.io.history.aging.file import Known, load, origin_of, pack, write
from valve_twin.io.history.tables import CHECK_SUM, ESTIMATE, MAINTENANCE
from valve_twin.io.history.tiers.extent import condensed_until
from valve_twin.io.history.tiers.reading import LAST_PLACE, begun_state, undisturbed
from valve_twin.io.history.valves.names import of_valve, own_key

if TYPE_CHECKING:
    from collections.abc import Iterator

    from valve_twin.core.aging.config import AgingConfig
    from valve_twin.io.history.check_sums import Rows
    from valve_twin.io.history.store import History

PAGE = 5000
"""Estimates that are read at a time [1]."""

_NEW = 500  # estimates, or rows of all valves times 100, after which it is written again


def trend_model(history: History, valve: str) -> str:
    """Return the name of the model of the newest estimate that feeds the trend, empty = none."""
    query = of_valve(ESTIMATE, valve).with_only_columns(ESTIMATE.c.model)
    query = query.where(ESTIMATE.c.used_by_trend == sa.true())
    found = history.select(query.order_by(ESTIMATE.c.cycle.desc()).limit(1))
    return str(found[0]["model"]) if found else ""


def read_known(history: History, valve: str, model: str, config: AgingConfig) -> Known:
    """Return what a verdict on a valve rests on: estimates of the trend, and features.

    Parameters
    ----------
    history : History
        Where the estimates are.
    valve, model : str
        Names of the valve and of its model.
    config : AgingConfig
        Rules of aging.
    """
    return undisturbed(history, valve, partial(_read, history, valve, model, config))


def _read(history: History, valve: str, model: str, config: AgingConfig) -> Known:
    path, events = history.snapshot_path(valve, "aging"), history.maintenance(valve)
    newest = _newest(history)
    known = None
    if path is not None:
        with suppress(StoreError):  # which is told nobody: reading anew gives the same
            known = load(path, origin_of(valve, model), config)
    if known is not None and not _holds(history, valve, known.place):
        known = None
    known = known or _begin(history, valve)
    if known.place.get("events", "") != _digest(history, valve, known.place["at"][0]):
        known = _begin(history, valve)
    known.state.maintenance = events
    for rows in _pages(history, valve, known.place["at"], newest):
        add_rows(known.state, rows)
        known.place |= {
            "at": [rows[-1]["cycle"], rows[-1]["position"]],
            "id": rows[-1]["id"],
            "sum": rows[-1][CHECK_SUM],
            "rows": known.place["rows"] + len(rows),
        }
    known.place["newest"] = newest
    known.place["events"] = _digest(history, valve, known.place["at"][0])
    return known


def _begin(history: History, valve: str) -> Known:
    """Return what is known before the first cycle that is not condensed."""
    state, until = begun_state(history, valve), condensed_until(history, valve)
    place = {"at": [until, LAST_PLACE if until else -1], "rows": 0, "looked": 0}
    return Known(state, Memory(), {**place, "events": _digest(history, valve, until)})


def is_worth_keeping(history: History, valve: str, known: Known) -> bool:
    """Return whether what was read is to be kept: enough of it is new, and there is a place.

    Parameters
    ----------
    history : History
        Where it was read.
    valve : str
        Name of the valve.
    known : Known
        What was read.
    """
    place = known.place
    if place["rows"] < WORTH or history.snapshot_path(valve, "aging") is None:
        return False
    new = place["rows"] - place.get("kept", 0)
    return (new >= _NEW or place["newest"] - place["looked"] >= 100 * _NEW) and _is_own(history)


def keep_known(
    history: History, valve: str, model: str, config: AgingConfig, known: Known
) -> None:
    """Keep what was read, if the folder takes it.

    Parameters
    ----------
    history : History
        Where it was read.
    valve, model : str
        Names of the valve and of its model.
    config : AgingConfig
        Rules of aging.
    known : Known
        What was read.
    """
    path, place = history.snapshot_path(valve, "aging"), known.place
    assert path is not None
    newest = place.pop("newest")
    known.place = {**place, "kept": place["rows"], "looked": newest}
    origin = origin_of(valve, model)
    with suppress(OSError):  # a folder that takes nothing: it is read anew
        write(path, pack(freeze(known.state), known.memory, known.place, origin, config))


def _is_own(history: History) -> bool:
    """Return whether the file of a SQLite history belongs to the user of this process.

    Windows does not tell: nothing is left beside a history that is only read there.
    """
    if not hasattr(os, "geteuid"):
        return False
    try:
        return Path(history.where).stat().st_uid == os.geteuid()
    except OSError:
        return False


def _pages(history: History, valve: str, at: list[int], newest: int) -> Iterator[Rows]:
    """Yield pages of the rows that a verdict rests on behind a cycle and position, in order."""
    judged = sa.or_(
        ESTIMATE.c.used_by_trend == sa.true(),
        ESTIMATE.c.estimator == FEATURES,
        ESTIMATE.c.reason_code == RefusalCode.IMPLAUSIBLE,
    )
    while True:
        cycle, position = at
        behind = sa.or_(
            ESTIMATE.c.cycle > cycle,
            sa.and_(ESTIMATE.c.cycle == cycle, ESTIMATE.c.position > position),
        )
        query = of_valve(ESTIMATE, valve).where(
            judged,
            ESTIMATE.c.cycle >= cycle,
            behind,
            ESTIMATE.c.id + 0 <= newest,  # what comes meanwhile is new the next time
        )
        query = query.order_by(ESTIMATE.c.cycle, ESTIMATE.c.position).limit(PAGE)
        rows = history.sound(ESTIMATE, query, PAGE)
        if rows:
            yield rows
        if len(rows) < PAGE:
            return
        at = [rows[-1]["cycle"], rows[-1]["position"]]


def _newest(history: History) -> int:
    """Return the newest key of any estimate, 0 = none."""
    (row,) = history.select(sa.select(sa.func.max(ESTIMATE.c.id).label("id")))
    return int(row["id"] or 0)


def _holds(history: History, valve: str, place: dict[str, Any]) -> bool:
    """Return whether the history holds the row read last, and none came later for before it.

    What was condensed behind it cannot be read any more.
    """
    if place["at"][0] < condensed_until(history, valve):
        return False
    last = sa.select(ESTIMATE.c.cycle, ESTIMATE.c.position, ESTIMATE.c[CHECK_SUM])
    found = history.select(last.where(ESTIMATE.c.id == place["id"]))
    if [[r["cycle"], r["position"], r[CHECK_SUM]] for r in found] != [
        [*place["at"], place["sum"]]
    ]:
        return False
    late = sa.select(ESTIMATE.c.id).where(
        ESTIMATE.c.id > place["looked"],
        ESTIMATE.c.valve_id + 0 == own_key(valve),  # by the key, which says what is new
        ESTIMATE.c.cycle <= place["at"][0],
    )
    return not history.select(late.limit(1))


def _digest(history: History, valve: str, cycle: int) -> str:
    """Return what tells the events up to a cycle, as they are marked now."""
    query = of_valve(MAINTENANCE, valve).where(MAINTENANCE.c.cycle <= cycle)
    query = query.order_by(MAINTENANCE.c.cycle, MAINTENANCE.c.id)
    found = history.sound(MAINTENANCE, query)
    return repr([(r[CHECK_SUM], r["withdrawn"]) for r in found]) if found else ""
