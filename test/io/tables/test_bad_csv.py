# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Bad files and mistaken mappings of a press valve: each is named in one line, none is fitted."""

import json
from dataclasses import replace

import numpy as np
import pytest

from valve_twin.cli import main
from valve_twin.core.simulation import simulate_cycles
from valve_twin.core.valves.registry import get_simulation
from valve_twin.io.errors import BagError
from valve_twin.io.tables.csv import read_table

CYCLES = 2
CONFIG = """\
model: press_cartridge
period_s: 0.03
signals.v_in.column: up
signals.v_out.column: down
signals.spool_position.column: x
cycles.start_signal: v_in
cycles.rearm_signal: v_out
csv.time_column: t
"""
NAMES = ("t", "up", "down", "x")


@pytest.fixture(scope="module")
def table():
    """Return the (N, 4) columns t, up, down, x of two cycles of a press valve."""
    config = get_simulation("press_cartridge")
    layer = replace(config.measurement, noise=1e-3, delay=1)
    blocks = list(simulate_cycles(replace(config, measurement=layer), CYCLES, seed=2))
    stamps = np.concatenate([b.stamp_ns for b in blocks])
    inputs = np.concatenate([b.inputs for b in blocks])
    position = np.concatenate([b.position for b in blocks])
    return np.column_stack([(stamps - stamps[0]) * 1e-9, inputs, position])


def text_of(table, names=NAMES):
    rows = "".join(",".join(f"{v:.9g}" for v in row) + "\n" for row in table)
    return ",".join(names) + "\n" + rows


@pytest.fixture
def run(tmp_path, yaml_file, capsys):
    """Return a function that imports a file: run(content, config) -> exit code, standard error."""

    def run_import(content, config=CONFIG):
        path = tmp_path / "run.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        code = main(
            ["import", str(path), "--config", str(yaml_file(config)), "--out", str(tmp_path / "b")]
        )
        return code, capsys.readouterr().err

    return run_import


@pytest.fixture
def estimate(run, tmp_path, capsys):
    """Return a function that imports and estimates: (import's lines, estimates, estimate's)."""

    def import_and_estimate(content, config=CONFIG):
        code, imported = run(content, config)
        assert code == 0, imported
        main(["estimate", str(tmp_path / "b"), "--config", str(tmp_path / "valve.yaml")])
        out, said = capsys.readouterr()
        objects = [json.loads(line) for line in out.splitlines()]
        return imported, [o for o in objects if o["kind"] == "estimate"], said

    return import_and_estimate


def test_a_good_file_is_estimated_without_a_word(estimate, table):
    imported, estimates, said = estimate(text_of(table))
    assert "run.csv" not in imported
    assert said == ""
    assert {e["cycle"] for e in estimates} == {1, 2}
    assert all(e["status"] != "REFUSED" for e in estimates if e["used_by_trend"])


def backwards(table):
    return text_of(table[::-1])


def milliseconds(table):
    return text_of(table * [1000.0, 1.0, 1.0, 1.0])


REFUSED_FILES = {
    "reverse time order": (backwards, "the rows run backwards in time, column 't' from"),
    "time in another unit": (
        milliseconds,
        "column 't': the rows are 30 s apart, period_s is 0.03; correct period_s or csv.time_sc",
    ),
    "another sampling time": (
        lambda table: text_of(table[::3]),
        "column 't': the rows are 0.09 s apart, period_s is 0.03; correct period_s",
    ),
    "column twice": (
        lambda table: text_of(table[:, [0, 1, 2, 3, 3]], (*NAMES, "x")),
        "column 'x' stands 2 times in the header; write the number of the right one instead, "
        "counted from 0: 3 and 4",
    ),
    "header only": (lambda _: "t,up,down,x\n", "has a header but no rows; export the data"),
    "header only, blank lines": (lambda _: "t,up,down,x\n\n  \n", "has a header but no rows"),
    "empty": (lambda _: "", "is empty; give a CSV file with rows"),
    "byte-order mark only": (lambda _: b"\xef\xbb\xbf", "is empty; give a CSV file with rows"),
    "text in a column": (
        lambda table: text_of(table[:5]) + "0.15,open,0,0\n",
        "run.csv:7: column 'up': 'open' is no number",
    ),
}


@pytest.mark.parametrize(("content", "says"), REFUSED_FILES.values(), ids=REFUSED_FILES)
def test_a_bad_file_is_refused_in_one_line_and_leaves_no_bag(run, tmp_path, table, content, says):
    code, said = run(content(table))
    assert code == 1
    assert says in said
    assert "run.csv" in said
    assert said.count("\n") == 1
    assert not (tmp_path / "b").exists()


@pytest.mark.parametrize("mark", [b"\xef\xbb\xbf", b"\xef\xbb\xbf\xef\xbb\xbf"])
def test_a_byte_order_mark_belongs_to_no_name(estimate, table, mark):
    _, estimates, said = estimate(mark + text_of(table).encode())
    assert said == ""
    assert {e["cycle"] for e in estimates} == {1, 2}


def test_a_configuration_with_a_byte_order_mark_is_read(run, tmp_path, table, yaml_file, capsys):
    assert run(text_of(table))[0] == 0
    path = yaml_file(CONFIG)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert main(["estimate", str(tmp_path / "b"), "--config", str(path)]) == 0
    assert capsys.readouterr().err == ""


def test_a_column_that_stands_twice_can_be_named_by_its_number(run, table):
    content = text_of(table[:, [0, 1, 2, 3, 3]], (*NAMES, "x"))
    code, said = run(content, CONFIG.replace("column: x", 'column: "4"'))
    assert (code, "run.csv" in said) == (0, False)


def test_a_bag_of_the_files_before_a_bad_one_is_named(tmp_path, yaml_file, table, capsys):
    for name, content in (("a.csv", text_of(table)), ("b.csv", "t,up,down,x\n")):
        (tmp_path / name).write_text(content, encoding="utf-8")
    files = [str(tmp_path / "a.csv"), str(tmp_path / "b.csv")]
    config = ["--config", str(yaml_file(CONFIG)), "--out", str(tmp_path / "bag")]
    assert main(["import", *files, *config]) == 1
    said = capsys.readouterr().err
    assert "b.csv: has a header but no rows" in said
    assert f"{tmp_path / 'bag'} holds only the 1 files before it: remove it" in said


def scaled(*factors):
    return lambda table: text_of(table * [1.0, *factors])


def still(column, value):
    def content(table):
        table = table.copy()
        table[:, column] = value
        return text_of(table)

    return content


MISTAKES = {
    # what is wrong: (content, said by import, said by estimate)
    "commands exchanged": (
        lambda table: text_of(table, ("t", "down", "up", "x")),
        "",
        "spool_position falls while v_in is on and rises while v_out is on: exchange",
    ),
    "position inverted": (
        lambda table: text_of(table * [1.0, 1.0, 1.0, -1.0] + [0.0, 0.0, 0.0, 1.0]),
        "",
        "the position is inverted: turn the sign of signals.spool_position.scale",
    ),
    "position in percent": (
        scaled(1.0, 1.0, 100.0),
        "column 'x': spool_position runs from",
        "it is to be 0 to 1: correct signals.spool_position.scale (0.01 for percent)",
    ),
    "commands in percent": (
        scaled(100.0, 100.0, 1.0),
        "column 'up': v_in runs from 0 to 80",
        "it is to be 0 to 1: correct signals.v_in.scale (0.01 for percent)",
    ),
    "position frozen": (
        still(3, 0.25),
        "column 'x' is 0.25 in all",
        "cycles give no estimate: the position stays at 0.25",
    ),
    "returning command dead": (still(2, 0.0), "column 'down' is 0 in all", ""),
    "starting command dead": (still(1, 0.0), "column 'up' is 0 in all", "no cycle found by rule"),
}


@pytest.mark.parametrize(("content", "imported", "said"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_named_and_nothing_is_fitted(estimate, table, content, imported, said):
    lines, estimates, told = estimate(content(table))
    assert imported in lines
    assert said in told
    for line in (lines + told).splitlines():
        assert line.startswith(("valve-twin: ", "/"))
    if "commands" in said or "spool_position" in said or "stays at" in said:
        assert estimates
        assert {e["status"] for e in estimates} == {"REFUSED"}
        assert not any(value for e in estimates for value in e["values"])  # null


def test_a_dead_command_gives_no_gain_of_its_own(estimate, table):
    _, estimates, _ = estimate(still(2, 0.0)(table))
    for found in estimates:
        status = dict(zip(found["names"], found["parameter_status"], strict=True))
        assert status.get("K_out") != "OK"


def test_rows_without_a_time_column_that_run_backwards_are_not_fitted(estimate, table):
    content = text_of(table[::-1, 1:], NAMES[1:])
    _, estimates, said = estimate(content, CONFIG.replace("csv.time_column: t\n", ""))
    assert "(or the record runs backwards)" in said
    assert {e["status"] for e in estimates} == {"REFUSED"}


def test_a_wrong_period_is_named_where_the_bag_is_estimated(
    run, tmp_path, table, yaml_file, capsys
):
    assert run(text_of(table))[0] == 0
    wrong = yaml_file(CONFIG.replace("0.03", "0.02"))
    main(["estimate", str(tmp_path / "b"), "--config", str(wrong)])
    said = capsys.readouterr().err
    assert "the stamps are 0.03 s apart (median) but period_s is 0.02 s: correct period_s" in said


def told(tmp_path, text, names=("0", "1"), **more):
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(BagError) as caught:
        read_table(path, list(names), **more)
    return str(caught.value)


def test_a_sign_of_inches_opens_no_quote(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text('t,note,x\n0,5" pipe,1\n1,"3 m, dn 50",2\n', encoding="utf-8")
    table = read_table(path, ["t", "x"])
    np.testing.assert_array_equal(table.columns[1], [1.0, 2.0])


def test_a_comma_in_quotes_belongs_to_its_cell(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text('t;note;x\n0;"a; 1,234";1,5\n1;"b; 7";2,25\n', encoding="utf-8")
    np.testing.assert_array_equal(read_table(path, ["x"]).columns[0], [1.5, 2.25])


@pytest.mark.parametrize(
    ("header", "row", "line"), [("t,x", "1,0,5", 3), ("x", "0,1", 2), ("t,x", '"1,5",2,5', 3)]
)
def test_a_row_of_more_cells_than_the_first_is_told(header, row, line, tmp_path):
    first = row if line == 2 else "0,1"
    text = told(tmp_path, f"{header}\n{first}\n{row}\n2,3\n", ("x",), separator=",")
    assert f":{line}: the row has {len(row.replace('1,5', '').split(','))} cells" in text


@pytest.mark.parametrize("text", ["t,x\n0,1,\n1,2, ,\n", 't,x\n0,"1"\n1,2\n'])
def test_empty_cells_at_the_end_of_a_row_are_none(text, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(text)
    assert read_table(path, ["t", "x"], separator=",").columns[1].tolist() == [1.0, 2.0]


def test_a_quote_that_is_not_closed_swallows_nothing(tmp_path):
    rows = [f"{i},{i}" for i in range(100)]
    rows[3] = '3,"3'
    rows[97] = '97,97"'
    text = told(tmp_path, "\n".join(rows))
    assert ":4: a quote is opened" in text


@pytest.mark.parametrize("cell", ["1_000", "0x10", "1:30", "{}", "0b1", "1d5", "١٢", "1 000"])
def test_what_only_a_program_takes_for_a_number_is_told(cell, tmp_path):
    text = told(tmp_path, f"t,x\n0,1\n1,{cell}\n2,3\n", ("t", "x"))
    assert f":3: column 'x': '{cell}' is no number" in text


@pytest.mark.parametrize("cells", [("999.5", "1,000"), ("999", "1,000"), ("1,000", "0.5")])
def test_a_comma_of_two_meanings_is_told(cells, tmp_path):
    text = told(tmp_path, "t;x\n" + "".join(f"{i};{c}\n" for i, c in enumerate(cells)), ("t", "x"))
    assert "between thousands" in text
    assert "column 'x'" in text


@pytest.mark.parametrize("cells", [("0,5", "1"), ("1,25", "2,125"), ("1,000", "1,001")])
def test_a_decimal_comma_is_read(cells, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t;x\n" + "".join(f"{i};{c}\n" for i, c in enumerate(cells)))
    table = read_table(path, ["x"])
    assert table.columns[0].tolist() == [float(c.replace(",", ".")) for c in cells]


@pytest.mark.parametrize(("zone", "count"), [("", 1), ("+00:00", 0)])
def test_the_hour_that_a_clock_without_zone_skips_is_told(zone, count, tmp_path):
    before = [f"2026-03-29 01:{m:02d}:00{zone},{m}" for m in range(60)]
    after = [f"2026-03-29 03:{m:02d}:00{zone},{m}" for m in range(60)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["t,x", *before, *after]))
    table = read_table(path, ["t", "x"], dates=True)
    assert len(table.notices) == count
    assert all(":62: the clock skips the hour" in n for n in table.notices)
