# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Make the views: names, times and units instead of keys, nanoseconds and texts.

They stand in a schema of their own, made by whom they are for and not by a revision of the tables:
a reader needs no right on a table, and whoever drops the schema loses nothing that is stored.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import sqlalchemy as sa

from valve_twin.core.aging.verdict import VerdictKind
from valve_twin.core.faults.ne107 import Ne107
from valve_twin.core.records import columns
from valve_twin.core.types import Estimate, EstimateStatus, ParameterStatus
from valve_twin.io.errors import ConfigError
from valve_twin.io.history.valves.names import DAMAGED_NAME, DIGEST_BITS, UNSEALED

if TYPE_CHECKING:
    from collections.abc import Iterable
    from enum import IntEnum

    from valve_twin.io.history.database import Database

SCHEMA = "valve_twin"
"""Schema that holds the views."""

_HOUR_NS = "3.6e12"
_NOT_FINITE = "('nan', 'inf', '-inf')"


def _time(column: str) -> str:
    """Return a stamp [ns] as a time; 0 = none."""
    return f"to_timestamp(nullif({column}, 0) / 1e9)"


def _digest(column: str) -> str:
    """Return the digest of a name, as `digest_of` computes it, in SQL."""
    bits = f"('x' || left(encode(sha256(convert_to({column}, 'UTF8')), 'hex'), 16))::bit(64)"
    return f"(({bits} >> {64 - DIGEST_BITS})::bigint)"


def _words(column: str, kinds: Iterable[IntEnum]) -> str:
    cases = " ".join(f"WHEN {int(k)} THEN '{k.name.lower().replace('_', ' ')}'" for k in kinds)
    return f"CASE {column} {cases} END"


def _numbers() -> str:
    """Return the numbers of a parameter, in the order in which its text holds them."""
    found = [c.part for c in columns(Estimate) if c.field == "parameters" and c.kind is float]
    return ", ".join(
        f"CASE WHEN p.text -> 'values' -> (n.i - 1)::int ->> {k} NOT IN {_NOT_FINITE} "
        f"THEN (p.text -> 'values' -> (n.i - 1)::int ->> {k})::float8 END AS {name}"
        for k, name in enumerate(found)
    )


_NAMES = f"""(SELECT id, CASE WHEN check_sum IN ({UNSEALED}, id + {_digest("name")})
            THEN name ELSE '{DAMAGED_NAME}' || id END AS name FROM valve OFFSET 0)"""
"""The valves, each digest computed once (OFFSET keeps the planner from doing it for each row)."""

VIEWS = {
    "cycles": f"""
        SELECT v.name AS valve, {_time("c.end_ns")} AS time, c.cycle,
            (c.end_ns - c.start_ns) / 1e9::float8 AS length_s, c.samples, c.lost, c.missed_cycles,
            c.accepted, c.reason
        FROM cycle c JOIN {_NAMES} v ON v.id = c.valve_id""",
    "estimates": f"""
        SELECT v.name AS valve, {_time("e.end_ns")} AS time, e.cycle, e.model, e.estimator,
            {_words("e.status", EstimateStatus)} AS status, e.reason, e.reason_code,
            e.fit_test, e.fit_train, sqrt(e.mse_test) AS residual, e.noise_sigma,
            e.condition_number, e.lag, e.samples_used, e.used_by_trend
        FROM estimate e JOIN {_NAMES} v ON v.id = e.valve_id""",
    "parameters": f"""
        SELECT v.name AS valve, {_time("e.end_ns")} AS time, e.cycle, e.estimator,
            e.used_by_trend, n.name AS parameter, {_numbers()},
            {_words("(p.text -> 'status' ->> (n.i - 1)::int)::int", ParameterStatus)} AS status,
            p.text -> 'reasons' ->> (n.i - 1)::int AS reason
        FROM estimate e JOIN {_NAMES} v ON v.id = e.valve_id
            CROSS JOIN LATERAL (SELECT e.parameters::jsonb AS text) p
            CROSS JOIN LATERAL jsonb_array_elements_text(p.text -> 'names')
                WITH ORDINALITY AS n (name, i)""",
    "verdicts": f"""
        SELECT v.name AS valve, {_time("w.stamp_ns")} AS time, w.cycle,
            {_words("w.verdict", VerdictKind)} AS verdict, w.verdict AS number, w.evidence, w.fault
        FROM verdict w JOIN {_NAMES} v ON v.id = w.valve_id""",
    "events": f"""
        SELECT v.name AS valve, {_time("e.stamp_ns")} AS time, e.id, e.cycle, e.code, e.status,
            e.text, NOT e.acknowledged AND e.status <> '{Ne107.GOOD.value}' AS is_open,
            e.acknowledged_by, e.acknowledged_note,
            {_time("e.acknowledged_at_ns")} AS acknowledged_at
        FROM event e JOIN {_NAMES} v ON v.id = e.valve_id""",
    "maintenance": f"""
        SELECT v.name AS valve, {_time("m.stamp_ns")} AS time, m.cycle, m.note, m.new_reference,
            m.withdrawn, m.withdrawn_note
        FROM maintenance m JOIN {_NAMES} v ON v.id = m.valve_id""",
    "condensates": f"""
        SELECT v.name AS valve, {_time("c.start_ns")} AS time, c.span_s, c.cycle, c.last_cycle,
            nullif(c.estimator, '') AS estimator, c.parameter, c.count, c.usable, c.minimum,
            c.maximum, c.mean, c.quantile_05, c.quantile_25, c.median, c.quantile_75, c.quantile_95
        FROM condensate c JOIN {_NAMES} v ON v.id = c.valve_id""",
    "counters": f"""
        SELECT v.name AS valve, {_time("c.end_ns")} AS time, {_time("c.since_ns")} AS since,
            c.cycle, c.cycles, c.reversals + (c.direction <> 0)::int AS movements, c.reversals,
            c.starts, t.travel, t.travel / nullif(c.stroke, 0) AS strokes,
            c.length_ns / {_HOUR_NS}::float8 AS hours,
            c.open_ns / {_HOUR_NS}::float8 AS hours_open,
            c.closed_ns / {_HOUR_NS}::float8 AS hours_closed,
            c.near_ns / {_HOUR_NS}::float8 AS hours_near_closed
        FROM counters c JOIN {_NAMES} v ON v.id = c.valve_id
            CROSS JOIN LATERAL (SELECT c.done + CASE WHEN c.direction <> 0
                THEN abs(c.level - c.begin) ELSE 0 END AS travel) t""",
}
"""What each view selects, by its name."""

_READERS = sa.text(
    "SELECT DISTINCT grantee FROM information_schema.role_table_grants WHERE table_schema = :s "
    "AND privilege_type = 'SELECT' AND grantee <> current_user"
)


def make_views(database: Database, reader: str = "") -> list[str]:
    """Make all views anew; who could read them before still can.

    Parameters
    ----------
    database : Database
        Of PostgreSQL, open for writing.
    reader : str
        A role of the server that may read the views and nothing else; empty = nobody new.

    Returns
    -------
    list of str
        Names of the views with their schema.

    Raises
    ------
    ConfigError
        If the database is not one of PostgreSQL.
    StoreError
        If they cannot be made, or there is no such role.
    """
    if database.is_sqlite:
        msg = (
            f"{database.where}: views are made on PostgreSQL only: a file of SQLite is read by "
            "`valve-twin history export`"
        )
        raise ConfigError(msg)
    with database.write() as connection:
        quote = connection.dialect.identifier_preparer.quote_identifier
        readers = {row[0] for row in connection.execute(_READERS, {"s": SCHEMA})}
        connection.exec_driver_sql(f"CREATE SCHEMA IF NOT EXISTS {SCHEMA}")
        for name, select in VIEWS.items():
            connection.exec_driver_sql(f"DROP VIEW IF EXISTS {SCHEMA}.{name}")
            connection.exec_driver_sql(f"CREATE VIEW {SCHEMA}.{name} AS {select}")
        for role in sorted(readers | ({reader} if reader else set())):
            who = "PUBLIC" if role == "PUBLIC" else quote(role)
            connection.exec_driver_sql(f"GRANT USAGE ON SCHEMA {SCHEMA} TO {who}")
            for name in VIEWS:
                connection.exec_driver_sql(f"GRANT SELECT ON {SCHEMA}.{name} TO {who}")
    return [f"{SCHEMA}.{name}" for name in VIEWS]
