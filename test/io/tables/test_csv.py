# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import gzip
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from valve_twin.io.errors import BagError
from valve_twin.io.tables.csv import read_table

TABLE = "time;u;x\n0;1.5;2\n1;2.5;3\n"


@pytest.fixture
def csv_file(tmp_path):
    """Return a function that writes a CSV file."""

    def write(content, name="a.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


SAME = {
    "semicolons": TABLE.encode(),
    "commas": TABLE.replace(";", ",").encode(),
    "tabs": TABLE.replace(";", "\t").encode(),
    "bars": TABLE.replace(";", "|").encode(),
    "windows line ends": TABLE.replace("\n", "\r\n").encode(),
    "byte-order mark": b"\xef\xbb\xbf" + TABLE.encode(),
    "utf-16": TABLE.encode("utf-16"),
    "utf-16 without a mark": TABLE.encode("utf-16-le"),
    "gzip": gzip.compress(TABLE.encode(), mtime=0),
    "decimal commas": TABLE.replace(".", ",").encode(),
    "quotes": TABLE.replace("time", '"time"').replace("1.5", '"1.5"').encode(),
    "no last line end": TABLE.rstrip().encode(),
    "blank lines": TABLE.replace("0;1", "\n0;1").encode(),
    "blanks": TABLE.replace(";", " ; ").encode(),
}


@pytest.mark.parametrize("content", SAME.values(), ids=SAME)
def test_all_dialects_give_the_same_numbers(csv_file, content):
    table = read_table(csv_file(content), ["x", "u"])
    assert [c.tolist() for c in table.columns] == [[2.0, 3.0], [1.5, 2.5]]


def test_columns_have_names_or_numbers(csv_file):
    path = csv_file(TABLE)
    assert read_table(path, ["2"]).columns[0].tolist() == [2.0, 3.0]
    headless = csv_file(TABLE.split("\n", 1)[1])
    assert read_table(headless, ["1"]).columns[0].tolist() == [1.5, 2.5]


def test_lines_are_counted_as_in_the_file(csv_file):
    assert read_table(csv_file("a\n\n1\n\n\n2\n"), ["a"]).lines.tolist() == [3, 6]


@pytest.mark.parametrize("sign", ["", "NaN", "null", "N/A", "-", "Bad"])
def test_signs_of_no_value_are_nan(csv_file, sign):
    values = read_table(csv_file(f"a;b\n1;{sign}\n2;5\n"), ["b"]).columns[0]
    assert math.isnan(values[0])
    assert values[1] == 5.0


def test_latin_letters_of_old_loggers_are_read(csv_file):
    path = csv_file("Temperatur_°C;x\n1;2\n".encode("cp1252"))
    assert read_table(path, ["Temperatur_°C"]).columns[0].tolist() == [1.0]


def test_dates_become_seconds_since_1970(csv_file):
    path = csv_file("t;x\n2020-01-01 00:00:00;1\n2020-01-01T00:00:01.500+00:00;2\n")
    table = read_table(path, ["t", "x"], dates=True)
    assert table.dated
    np.testing.assert_array_equal(table.columns[0], [1577836800.0, 1577836801.5])


@given(st.lists(st.tuples(st.floats(), st.floats()), min_size=1, max_size=20))
def test_round_trip_of_any_numbers(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("csv") / "a.csv"
    path.write_text("a,b\n" + "".join(f"{a!r},{b!r}\n" for a, b in rows), encoding="utf-8")
    columns = read_table(path, ["a", "b"]).columns
    np.testing.assert_array_equal(np.column_stack(columns), np.array(rows))


BAD = [
    ("", ["a"], r"a.csv: is empty; give a CSV file with rows"),
    ("a;b\n", ["a"], r"a.csv: has a header but no rows; export the data with it"),
    (TABLE, ["y"], r"a.csv: there is no column 'y'; there are time, u, x"),
    (TABLE, ["tme"], r"a.csv: there is no column 'tme'; did you mean 'time'\?"),
    (TABLE, ["3"], r"a.csv: there is no column 3, the last is 2; count from 0"),
    ("1;2\n3;4\n", ["u"], r"a.csv: column 'u': the file has no header; write the number"),
    (TABLE + "2;off;4\n", ["u"], r"a.csv:4: column 'u': 'off' is no number; correct it or leave"),
    (TABLE + "2;3\n", ["x"], r"a.csv:4: the row has 2 cells, column 'x' is missing; complete"),
    (
        b"PK\x03\x04" + bytes(50),
        ["a"],
        r"a.csv: is no text and of no kind that is read; save the table as CSV",
    ),
    (
        gzip.compress(TABLE.encode(), mtime=0)[:-9],
        ["u"],
        r"a.csv: cannot be read .*give a whole file, plain or gzip",
    ),
]


@pytest.mark.parametrize(("content", "names", "says"), BAD)
def test_what_cannot_be_read_is_named_with_line_and_remedy(csv_file, content, names, says):
    with pytest.raises(BagError, match=says) as caught:
        read_table(csv_file(content), names)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(BagError, match=r"none.csv: there is no such file; give one that is there"):
        read_table(tmp_path / "none.csv", ["a"])


def test_a_file_above_what_may_be_unpacked_is_refused_before_it_is_read(csv_file, monkeypatch):
    path = csv_file("t,x\n" + "0.1,2.0\n" * 150_000)
    monkeypatch.setenv("VALVE_TWIN_UNPACK_MB", "1")
    with pytest.raises(BagError, match=r"a.csv: .*VALVE_TWIN_UNPACK_MB"):
        read_table(path, ["t"])
