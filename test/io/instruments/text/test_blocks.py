# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A large table is read block by block as a small one is as a whole."""

from __future__ import annotations

import random
import subprocess
import sys
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from test import peak
from valve_twin.io.errors import BagError
from valve_twin.io.instruments.cells import read_rows
from valve_twin.io.instruments.text import blocks, table

ODD = (
    "",
    "abc",
    "nan",
    "-",
    "inf",
    "1e999",
    "0x10",
    "1_000",
    "1,5",
    "1.5.2",
    "#REF!",
    "1d3",
    "+7",
)
"""Cells that stand here and there where a number should."""


def made(rng: random.Random) -> str:
    """Return a table with what tables of instruments have: some of it wrong."""
    mark = rng.choice((",", ";", "\t", " ", "|"))
    comma = mark != "," and rng.random() < 0.4
    dated = rng.choice(
        ("", "%Y-%m-%dT%H:%M:%S.%f", "%d.%m.%Y %H:%M:%S.%f", "%m/%d/%Y %I:%M:%S %p")
    )
    dated = "" if mark == " " else dated
    quoted = mark != " " and rng.random() < 0.3
    odd = rng.choice((0.0, 0.0, 0.001, 0.02))
    trailing = mark if rng.random() < 0.2 else ""
    first = np.datetime64("2026-02-27T09:59:58").astype("datetime64[us]").item()

    def number(value: float) -> str:
        text = f"{value:.{rng.randint(0, 6)}f}" if rng.random() < 0.9 else f"{value:.3e}"
        text = rng.choice(ODD) if rng.random() < odd else text
        return text.replace(".", ",") if comma else text

    def row(k: int) -> str:
        second = 0.25 * k
        time = number(second)
        if dated:
            time = (first + np.timedelta64(k * 250, "ms").item()).strftime(dated)
            time = time.replace(".000000", "") if rng.random() < 0.5 else time
        state = "on" if k % 3 else "off" if mark == " " else ""
        cells = [time, number(rng.gauss(5, 3)), state, number(k % 7)]
        if quoted:
            cells = [f'"{c}"' if rng.random() < 0.8 else c for c in cells]
        return mark.join(cells) + trailing

    head = [] if rng.random() < 0.2 else [mark.join(("when", "x [mm]", "state", "y")) + trailing]
    above = ["Station;Kühlöl", "", "Sample rate [Hz];4"] if rng.random() < 0.3 else []
    lines = [*above, *head, *map(row, range(rng.randint(700, 1500)))]
    for _ in range(rng.choice((0, 0, 3))):
        lines.insert(rng.randrange(len(lines)), rng.choice(("", "  ", f"1{mark}2", "# note")))
    lines += ["End of file"] if rng.random() < 0.2 else []
    end = rng.choice(("\n", "\r\n"))
    return end.join(lines) + (end if rng.random() < 0.8 else "")


def outcome(read, path, data):
    """Return all that is found, or the line that refuses it."""
    try:
        sheet = read(path, data)
    except BagError as err:
        return str(err)
    if sheet is None:
        return None
    columns = [(c.name, c.unit, c.dated, c.zoned, c.values.tobytes()) for c in sheet.columns]
    return columns, sheet.lines.tolist(), sheet.preamble, sheet.notices, sheet.named


@pytest.mark.parametrize("seed", range(150))
def test_blocks_give_what_the_whole_gives(tmp_path, monkeypatch, seed):
    rng = random.Random(seed)
    monkeypatch.setattr(blocks, "BLOCK", rng.choice((300, 4000, 1 << 22)))
    data = made(rng).encode(rng.choice(("utf-8", "cp1252")))
    found = outcome(table._in_blocks, tmp_path / "a.csv", data)
    if found is not None:
        assert found == outcome(table._as_a_whole, tmp_path / "a.csv", data)


def test_most_tables_are_read_in_blocks(tmp_path):
    texts = [made(random.Random(seed)).encode() for seed in range(150)]
    found = [outcome(table._in_blocks, tmp_path / "a.csv", text) for text in texts]
    assert sum(f is not None for f in found) > 110


def test_numpy_reads_what_is_whole(monkeypatch, tmp_path):
    """Or this would be slower than before, and nobody would see it."""
    slow = []

    def counted(*arguments, **more):
        slow.append(arguments)
        return read_rows(*arguments, **more)

    monkeypatch.setattr(table, "read_rows", counted)
    rows = (f"{0.1 * k:.1f};27.02.2026 10:00:{k % 60:02d},250;{k % 9},5;on" for k in range(5000))
    data = ("t_s;when;x;state\n" + "\n".join(rows)).encode()
    sheet = table._in_blocks(tmp_path / "a.csv", data)
    assert sheet is not None
    assert len(slow) == 1, "the first lines only"
    assert [len(c.values) for c in sheet.columns] == [5000] * 3
    assert sheet.columns[2].values[4:7].tolist() == [4.5, 5.5, 6.5]


def test_empty_lines_at_the_end_say_nothing(monkeypatch, tmp_path):
    """A block of them alone made numpy warn, which is a notice."""
    monkeypatch.setattr(blocks, "BLOCK", 2000)
    data = ("t_s,x\n" + "".join(f"{k},{k % 5}\n" for k in range(600)) + 5000 * "\n").encode()
    found = outcome(table._in_blocks, tmp_path / "a.csv", data)
    assert found is not None
    assert found == outcome(table._as_a_whole, tmp_path / "a.csv", data)


@pytest.mark.skipif(sys.platform != "linux", reason="memory of a process is counted otherwise")
def test_a_large_table_takes_a_few_times_its_size(tmp_path):
    """It took 26 times as much: 145 MB of CSV took 2.6 GB."""
    path, count = tmp_path / "a.csv", 400_000
    values = np.random.default_rng(0).normal(size=(count, 3))
    times = (
        np.datetime64("2026-02-27T10:00") + np.arange(count).astype("timedelta64[ms]")
    ).astype(str)
    lines = (f"{t};{a:.6f};{b:.6f};{c:.6f}\n" for t, (a, b, c) in zip(times, values, strict=True))
    path.write_text("when;a;b;c\n" + "".join(lines), encoding="utf-8")
    script = Path(peak.__file__).read_text(encoding="utf-8") + (
        "import sys\n"
        "from valve_twin.io.instruments.read import read_recording\n"
        "small, path = Path(sys.argv[2]), Path(sys.argv[1])\n"
        "read_recording(small)\n"
        "before = peak_mb()\n"
        "assert len(read_recording(path).columns[0].values) == int(sys.argv[3])\n"
        "print(2**20 * (peak_mb() - before))\n"
    )
    small = tmp_path / "b.csv"
    with path.open(encoding="utf-8") as file:
        small.write_text("".join(islice(file, 2000)), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", script, str(path), str(small), str(count)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert float(done.stdout) < 9 * path.stat().st_size
