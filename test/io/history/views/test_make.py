# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The views on a real PostgreSQL say what the history says; so does every query of Grafana."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any

import pytest
import sqlalchemy as sa

from test.io.history.test_fleet import START_NS, STEP_NS, estimate, record
from valve_twin.cli import main
from valve_twin.core.aging.verdict import Verdict, VerdictKind
from valve_twin.core.operation.counters import Counters
from valve_twin.core.past.condensate import DAY_S, Condensate
from valve_twin.core.types import EstimateStatus, Maintenance, ParameterStatus, ParameterValue
from valve_twin.io.history.check_sums import sealed
from valve_twin.io.history.store import History
from valve_twin.io.history.tables import CONDENSATE, to_row
from valve_twin.io.history.valves.names import digest_of
from valve_twin.io.history.views.make import SCHEMA, VIEWS, _digest

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

VALVES = ("/press/valve_1", '/press/it\'s % "odd"')
LAST = 12
DAY = Condensate(DAY_S, START_NS, START_NS + STEP_NS, 1, 9, "e", "leak", 9, 0, *[math.nan] * 8)
COUNTERS = Counters(
    LAST, START_NS, START_NS + LAST * STEP_NS, LAST, 30, 4, 10**12, 6 * 10**11, 3 * 10**11, 10**11,
    done=41.5, closed=0.0, stroke=0.5, direction=-1, begin=0.75, level=0.5,
)  # fmt: skip


def parameters(cycle: int) -> tuple[ParameterValue, ...]:
    upper = 0.0102 if cycle > 1 else math.inf
    return (
        ParameterValue("K_in", 0.01 + 1e-5 * cycle, ParameterStatus.OK, "", 1e-4, 0.0098, upper),
        ParameterValue("leak", math.nan, ParameterStatus.NOT_EXCITED, "it's at rest"),
    )


@pytest.fixture(scope="module")
def history(server: str) -> Iterator[History]:
    with History(server) as made:
        for valve in VALVES:
            for cycle in range(1, LAST + 1):
                found = replace(
                    estimate(cycle, {}, status=EstimateStatus.PARTIAL),
                    parameters=parameters(cycle),
                    fit_test=math.nan if cycle == 1 else 90.0,
                    mse_test=math.nan if cycle == 1 else 4e-6,
                )
                counted = COUNTERS if cycle == LAST else None
                made.store(valve, record(cycle), (found,), counters=counted)
            stamp = START_NS + LAST * STEP_NS
            made.add_verdict(
                valve,
                Verdict(stamp, valve, VerdictKind.VALVE, "valve", "K_in -15 %", LAST, "K_in"),
            )
            made.add_maintenance(valve, Maintenance(stamp, LAST, "new spool", True))
            with made.writing(valve) as (connection, valve_id):
                row = sealed(CONDENSATE, to_row(DAY, valve_id))
                connection.execute(CONDENSATE.insert(), row)
        yield made


@pytest.fixture(scope="module")
def database(history: History, server: str) -> Iterator[sa.Engine]:
    engine = sa.create_engine(server.replace("postgresql:", "postgresql+psycopg:"))
    with engine.begin() as connection:
        connection.exec_driver_sql('CREATE ROLE "graf\'ana" LOGIN')
    assert main(["history", "views", "--url", server, "--reader", "graf'ana"]) == 0
    yield engine
    engine.dispose()


def rows(database: sa.Engine, query: str, role: str = "") -> list[dict[str, Any]]:
    with database.connect() as connection:
        if role:
            connection.exec_driver_sql(f'SET ROLE "{role}"')
        return [
            dict(row) for row in connection.exec_driver_sql(query.replace("%", "%%")).mappings()
        ]


def seconds(time: datetime) -> float:
    return time.timestamp()


def test_a_parameter_is_a_row_with_its_numbers_words_and_time(database):
    query = (
        f"SELECT * FROM {SCHEMA}.parameters WHERE valve = '{VALVES[0]}' ORDER BY cycle, parameter"
    )
    found = rows(database, query)
    assert len(found) == 2 * LAST
    first, none = found[:2]
    assert (first["parameter"], first["value"]) == ("K_in", parameters(1)[0].value)
    assert (first["standard_error"], first["lower_95"]) == (1e-4, 0.0098)
    assert first["upper_95"] is None  # not finite
    assert (none["parameter"], none["value"], none["status"]) == ("leak", None, "not excited")
    assert none["reason"] == "it's at rest"
    assert seconds(first["time"]) == pytest.approx(record(1).end_ns * 1e-9, abs=1e-6)
    assert first["used_by_trend"] is True


def test_what_is_not_known_is_null_and_states_are_words(database):
    query = f"SELECT * FROM {SCHEMA}.estimates WHERE valve = '{VALVES[0]}' ORDER BY cycle"
    first, second = rows(database, query)[:2]
    assert (first["fit_test"], first["residual"], first["status"]) == (None, None, "partial")
    assert (second["fit_test"], second["residual"]) == (90.0, pytest.approx(2e-3, rel=1e-12))
    (verdict,) = rows(database, f"SELECT * FROM {SCHEMA}.verdicts WHERE valve = '{VALVES[0]}'")
    said = (verdict["verdict"], verdict["evidence"], verdict["fault"], verdict["cycle"])
    assert said == ("valve", "K_in -15 %", "K_in", LAST)


def test_counters_are_those_of_the_history(database):
    found = rows(database, f"SELECT * FROM {SCHEMA}.counters WHERE valve = '{VALVES[0]}'")[0]
    assert (found["movements"], found["travel"], found["strokes"]) == (
        COUNTERS.movements,
        COUNTERS.travel,
        COUNTERS.strokes,
    )
    hours = [found[n] for n in ("hours", "hours_open", "hours_closed", "hours_near_closed")]
    assert hours == pytest.approx(COUNTERS.hours, rel=1e-12)


def test_a_condensed_day_is_a_row(database):
    found = rows(database, f"SELECT * FROM {SCHEMA}.condensates WHERE valve = '{VALVES[0]}'")[0]
    assert (found["span_s"], found["cycle"], found["last_cycle"]) == (86400, 1, 9)
    assert (found["parameter"], found["count"], found["usable"]) == ("leak", 9, 0)
    assert found["maximum"] is None


def test_events_and_maintenance_are_there(database, history):
    for valve in VALVES:
        log = history.log.events(valve)
        quoted = valve.replace("'", "''")
        found = rows(database, f"SELECT * FROM {SCHEMA}.events WHERE valve = '{quoted}'")
        assert {(e["id"], e["code"], e["text"], e["is_open"]) for e in found} == {
            (e.id, e.code, e.text, e.is_open) for e in log
        }
        assert found
        (done,) = rows(database, f"SELECT * FROM {SCHEMA}.maintenance WHERE valve = '{quoted}'")
        assert (done["note"], done["new_reference"], done["withdrawn"]) == (
            "new spool",
            True,
            False,
        )


def test_the_reader_reads_views_and_no_table_also_after_they_were_made_anew(database, server):
    assert main(["history", "views", "--url", server]) == 0
    for name in VIEWS:
        assert rows(database, f"SELECT * FROM {SCHEMA}.{name}", "graf'ana")
    for query in ("SELECT * FROM estimate", "DELETE FROM maintenance"):
        with pytest.raises(sa.exc.ProgrammingError, match="permission denied"):
            rows(database, query, "graf'ana")


def expanded(query: str) -> str:
    """Return a query as Grafana sends it for all valves and the whole time."""
    quoted = ", ".join("'" + v.replace("'", "''") + "'" for v in VALVES)
    query = query.replace("${valve:sqlstring}", quoted)
    query = query.replace("${parameter:sqlstring}", "'K_in', 'leak'")
    ends = [datetime.fromtimestamp(1e-9 * START_NS + s, timezone.utc) for s in (0, 1e6)]
    between = f"BETWEEN '{ends[0].isoformat()}' AND '{ends[1].isoformat()}'"
    query = re.sub(r"\$__timeFilter\((\w+)\)", rf"\1 {between}", query)
    query = re.sub(
        r"\$__timeGroupAlias\((\w+), '1d'\)",
        r'floor(extract(epoch from \1)/86400)*86400 AS "time"',
        query,
    )
    assert "$" not in query
    return query


def test_every_query_of_the_dashboard_gives_rows_to_the_reader(database, root: Path):
    board = json.loads((root / "layouts" / "grafana_postgresql.json").read_text("utf-8"))
    targets = [t for panel in board["panels"] for t in panel["targets"]]
    targets += [note["target"] for note in board["annotations"]["list"]]
    assert len(targets) > 10
    for target in targets:
        found = rows(database, expanded(target["rawSql"]), "graf'ana")
        assert found, target
        if target["format"] == "time_series":
            assert {"time", "metric"} < set(found[0]), target
            values = [v for k, v in found[0].items() if k not in {"time", "metric"}]
            assert all(float(v) == float(v) for v in values)
    asked = {v["name"]: v["query"] for v in board["templating"]["list"] if v["type"] == "query"}
    assert [r["valve"] for r in rows(database, asked["valve"])] == sorted(VALVES)
    assert [r["parameter"] for r in rows(database, asked["parameter"])] == ["K_in", "leak"]
    used = {n for t in targets for n in re.findall(r"\${(\w+):", t["rawSql"])}
    assert used == set(asked)


@pytest.mark.parametrize("name", VIEWS)
def test_a_damaged_name_shows_as_no_valve(name, database):
    """One byte of a name, also where it becomes that of no other valve."""
    change = (
        "UPDATE valve SET name = overlay(name placing '2' from length(name)) WHERE name = '{}'"
    )
    read = sa.text(f"SELECT DISTINCT valve FROM {SCHEMA}.{name}")
    with database.connect() as connection:
        assert set(connection.scalars(read)) == set(VALVES)
        connection.exec_driver_sql(change.format(VALVES[0]))
        key = connection.scalar(sa.text("SELECT id FROM valve WHERE name = '/press/valve_2'"))
        assert set(connection.scalars(read)) == {f"/name_damaged_{key}", VALVES[1]}
        connection.rollback()


def test_names_are_digested_as_the_history_does(database):
    names = ["/a", "/Ä/ölventil", "/阀门", "/x" * 300, *(f"/v{i}" for i in range(200))]
    with database.connect() as connection:
        for name in names:
            query = sa.text(f"SELECT {_digest('CAST(:n AS text)')}")
            assert connection.scalar(query, {"n": name}) == digest_of(name)


def test_a_role_that_is_not_there_and_a_file_are_told_in_one_line(server, tmp_path, capsys):
    assert main(["history", "views", "--url", server, "--reader", "nobody"]) != 0
    (line,) = capsys.readouterr().err.splitlines()
    assert 'role "nobody" does not exist' in line
    History(tmp_path / "h.db").close()
    assert main(["history", "views", "--url", str(tmp_path / "h.db")]) != 0
    (line,) = capsys.readouterr().err.splitlines()
    assert "views are made on PostgreSQL only" in line
