# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from __future__ import annotations

import importlib
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse

from test import peak
from test.io.instruments import bombs
from test.io.instruments import foreign_files as foreign
from valve_twin.io.errors import BagError
from valve_twin.io.instruments import table
from valve_twin.io.instruments.clock import ClockChoice
from valve_twin.io.instruments.mat import _is_misread
from valve_twin.io.instruments.read import kind_of, read_recording

# name of the file, who writes it, columns of command and pressure, unit, whether it has a date
FILES = {
    "excel": ("a.xlsx", foreign.excel, "Set point", "Pressure", False),
    "mat": ("a.mat", foreign.mat5, "log.setpoint", "log.p_bar", False),
    "hdf5": ("a.mat", foreign.mat73, "log.setpoint", "log.p", False),
    "tdms": ("a.tdms", foreign.tdms, "setpoint", "p", True),
    "mdf": ("a.mf4", foreign.mdf, "setpoint", "p", True),
    "parquet": ("a.parquet", foreign.parquet, "setpoint", "p_bar", True),
    "text": ("a.csv", foreign.text, "Sollwert", "Druck", False),
}
PACKAGES = {"excel": "openpyxl", "hdf5": "h5py", "tdms": "nptdms", "mdf": "asammdf",
            "parquet": "pyarrow.parquet"}  # fmt: skip
START_NS = round(foreign.START.timestamp()) * 10**9


@pytest.fixture
def written(tmp_path):
    """Return a function that writes a file of a kind and returns its path."""

    def write(kind):
        if kind in PACKAGES:
            pytest.importorskip(PACKAGES[kind].partition(".")[0])
        name, writer = FILES[kind][:2]
        path = tmp_path / name
        writer(path)
        return path

    return write


@pytest.mark.parametrize("kind", FILES)
def test_a_file_of_another_program_is_read_to_the_last_digit(written, kind):
    path = written(kind)
    _, _, command, pressure, dated = FILES[kind]
    assert kind_of(path) == kind
    found = read_recording(path)
    columns = {c.name: c for c in found.columns}
    near = 5.1e-5 if kind == "text" else 0.0  # four decimals are written
    np.testing.assert_allclose(columns[command].values, foreign.COMMAND, rtol=0.0, atol=near)
    np.testing.assert_allclose(columns[pressure].values, foreign.PRESSURE, rtol=0.0, atol=near)
    np.testing.assert_allclose(columns[pressure].seconds, foreign.SECONDS, atol=1e-6)
    assert columns[pressure].unit == "bar"
    assert found.measured
    assert found.start_ns == (START_NS if dated else None)


def test_a_bag_of_storage_sqlite3_is_read_by_header_stamps(tmp_path):
    foreign.sqlite_bag(tmp_path / "bag")
    found = read_recording(tmp_path / "bag")
    pressure = next(c for c in found.columns if c.name == "/p:fluid_pressure")
    np.testing.assert_allclose(pressure.values, 1e5 * foreign.PRESSURE)
    np.testing.assert_allclose(pressure.seconds, foreign.SECONDS, atol=1e-6)
    assert found.start_ns == START_NS


@pytest.mark.parametrize("kind", PACKAGES)
def test_a_missing_package_is_named_with_its_command(written, monkeypatch, kind):
    path = written(kind)

    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(BagError, match=r"pip install 'valve_twin\[files\]'") as caught:
        read_recording(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", FILES)
def test_a_damaged_file_is_one_line_or_sound_columns(written, kind):
    """Cut at eight places and with bytes changed by a seed: no trace, nothing without end."""
    path = written(kind)
    whole, rng = path.read_bytes(), np.random.default_rng(5)
    for share in (0.02, 0.2, 0.5, 0.9):
        for cut in (True, False):
            data = bytearray(whole[: int(len(whole) * share)] if cut else whole)
            if not cut:
                for at in rng.integers(0, len(data), 8):
                    data[at] = rng.integers(0, 256)
            path.write_bytes(bytes(data))
            try:
                found = read_recording(path)
            except BagError as err:
                said = str(err)
            else:
                said = str(path)
                assert all(len(c.values) == len(c.seconds) for c in found.columns)
                assert all(np.all(np.diff(c.seconds) > 0.0) for c in found.columns)
            assert str(path) in said


def test_what_a_reader_of_others_says_is_a_notice_and_not_printed(written, capfd):
    """A broken name went to the terminal as kilobytes of bytes, a cut file was read unnoticed."""
    path = written("tdms")
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * 0.9)])
    cut = read_recording(path)
    path.write_bytes(whole.replace(b"unit_string", b"\xfcnit_string", 1))
    renamed = read_recording(path)
    assert any("less data than expected" in text for text in cut.notices)
    assert any("Error decoding string" in text for text in renamed.notices)
    for text in (*cut.notices, *renamed.notices):
        assert text.startswith(f"{path}: ")
        assert "\n" not in text
        assert len(text) < 600
    assert capfd.readouterr() == ("", "")


def test_channels_of_a_tdms_file_that_are_not_taken_are_named(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "a.tdms"
    for wave, why in (({"wf_increment": 0.01}, "has no times of a wave"), ({}, "is of another")):
        with nptdms.TdmsWriter(path) as writer:
            for name, count, own in (("p", 300, wave), ("q", 300, wave), ("few", 30, {})):
                values = np.arange(float(count))
                writer.write_segment([nptdms.ChannelObject("log", name, values, properties=own)])
        found = read_recording(path, ClockChoice(period_s=0.01))
        assert [c.name for c in found.columns] == ["p", "q"]
        assert any("'few' with 30 values is left out: it " + why in n for n in found.notices)


@pytest.mark.parametrize("kind", ["excel", "mat", "hdf5", "tdms", "mdf", "parquet", "text"])
def test_a_file_that_unpacks_to_more_than_allowed_is_refused(written, monkeypatch, kind):
    path = written(kind)
    monkeypatch.setattr(table, "too_large", lambda size, packed: "is too large" if size else "")
    with pytest.raises(BagError, match="is too large"):
        read_recording(path)


def test_what_is_no_table_is_told(tmp_path):
    for name, data, says in (
        ("a.xls", b"\xd0\xcf\x11\xe0" + bytes(600), "save it as .xlsx"),
        ("a.bin", bytes(range(256)) * 20, "is no text and of no kind that is read"),
        ("a.txt", b"just some words\nand more of them\n", "holds no table of numbers"),
        ("a.csv", b"", "is empty"),
    ):
        path = tmp_path / name
        path.write_bytes(data)
        with pytest.raises(BagError, match=says):
            read_recording(path)
    with pytest.raises(BagError, match="cannot be read"):
        read_recording(tmp_path / "missing.csv")


BOMBS = {
    "doubles in a structure": ("a.mat", bombs.mat_doubles, 40_000_000, "allowed are 256"),
    "bytes in a structure": ("a.mat", bombs.mat_bytes, 60_000_000, "allowed are 256"),
    "cells in cells": ("a.mat", bombs.mat_cells, 100_000, "nested deeper than 32"),
    "cells at the end of rows": ("a.xlsx", bombs.excel_cells, 700, "more than 10000000 cells"),
    "texts": ("a.xlsx", bombs.excel_texts, 2_000_000, "more than 32 MB of texts"),
    "a packed block": ("a.mf4", bombs.mdf_block, 3 << 30, "takes far more memory"),
    "segments": ("a.tdms", bombs.tdms_segments, 36_000, "too many segments for 2000 channels"),
    "a page": ("a.parquet", bombs.parquet_pages, 150_000_000, "takes far more memory"),
}


@pytest.mark.parametrize("what", BOMBS)
def test_a_small_file_takes_neither_memory_nor_time_nor_the_process(what, tmp_path):
    """Of these 233 kB took 11 GB, 200 kB the process, 4 kB six GB and a minute, 4 MB 4.4 GB."""
    name, writer, count, words = BOMBS[what]
    pytest.importorskip("openpyxl")
    path = tmp_path / name
    writer(path, count)
    script = Path(peak.__file__).read_text(encoding="utf-8") + (
        "import sys, time\n"
        "from valve_twin.io.errors import BagError\n"
        "from valve_twin.io.instruments.read import read_recording\n"
        "begin = time.process_time()\n"
        "try:\n    read_recording(Path(sys.argv[1]))\n"
        "except BagError as err:\n    print(err)\n"
        "print(peak_mb(), time.process_time() - begin)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    told, figures = done.stdout.splitlines()
    assert words in told
    held_mb, cpu_s = map(float, figures.split())
    assert held_mb < 1000
    assert cpu_s < 10.0


def test_a_sheet_that_claims_to_be_full_is_read_as_far_as_it_is(tmp_path):
    """Of 4 kB it took 6 GB and more than a minute."""
    pytest.importorskip("openpyxl")
    path = tmp_path / "a.xlsx"
    bombs.excel_full(path, 300)
    begin_s = time.process_time()
    recording = read_recording(path)
    assert {len(column.values) for column in recording.columns} <= {300, 301}
    assert time.process_time() - begin_s < 10.0


def test_groups_that_hold_each_other_are_looked_at_once_and_other_files_are_not(tmp_path):
    """Twelve groups with links to each other took more than a day."""
    h5py = pytest.importorskip("h5py")
    path, other = tmp_path / "a.h5", tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["secret"] = foreign.PRESSURE
    with h5py.File(path, "w") as file:
        file["setpoint"], file["p_bar"] = foreign.COMMAND, foreign.PRESSURE
        groups = [file.create_group(f"g{k}") for k in range(12)]
        for group in groups:
            for k, target in enumerate(groups):
                group[f"link{k}"] = target
        layout = h5py.VirtualLayout(shape=(len(foreign.PRESSURE),), dtype="f8")
        layout[:] = h5py.VirtualSource(str(other), "secret", shape=(len(foreign.PRESSURE),))
        file.create_virtual_dataset("virtual", layout)
    assert {column.name for column in read_recording(path).columns} == {"setpoint", "p_bar"}


def test_cells_and_structures_as_people_nest_them_are_read(tmp_path):
    path = tmp_path / "a.mat"
    names = np.empty(2, dtype=object)
    names[:] = ["bar", foreign.PRESSURE]
    inner = {"p": foreign.PRESSURE, "units": names, "sparse": scipy.sparse.eye(3)}
    log = {"inner": inner, "setpoint": foreign.COMMAND.astype(np.int16)}
    for packed in (False, True):
        scipy.io.savemat(path, {"time_s": foreign.SECONDS, "log": log}, do_compression=packed)
        found = {column.name for column in read_recording(path).columns}
        assert found == {"log.inner.p", "log.setpoint"}


def test_channels_of_an_mdf_file_that_no_link_leads_to_are_told(written):
    path = written("mdf")
    whole = path.read_bytes()
    groups = [m.start() for m in re.finditer(rb"##DG", whole)]
    path.write_bytes(whole[: groups[0] + 24] + bytes(8) + whole[groups[0] + 32 :])
    found = read_recording(path)
    assert [c.name for c in found.columns] == ["setpoint"]
    assert any("of 4 channels that it holds its links lead to 2" in n for n in found.notices)


def test_channels_of_an_mdf_file_whose_values_are_gone_are_told(written):
    path = written("mdf")
    whole = path.read_bytes()
    at = whole.index(b"##DT")
    path.write_bytes(whole[:at] + bytes(24) + whole[at + 24 :])
    found = read_recording(path)
    assert [c.name for c in found.columns] == ["p"]
    assert any("lack the values" in n and "setpoint" in n for n in found.notices)


def test_bytes_too_many_in_a_tdms_file_are_told(written):
    path = written("tdms")
    whole = path.read_bytes()
    path.write_bytes(whole[:-801] + b"\0\0" + whole[-801:])  # all values behind it are others
    found = read_recording(path)
    assert any(f"the file at {len(whole) + 2}" in text for text in found.notices)


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        (b"'setpoint'\x14", b"'setpointh\x14", "'setpointh holds 200 values, and its name is"),
        (b"'p'\x14\0\0\0\x0a", b"'p'\x14\0\0\0\x21", "'p' holds no numbers (bool)"),
    ],
)
def test_a_tdms_channel_whose_head_is_damaged_is_told(before, after, told, written):
    path = written("tdms")
    whole = path.read_bytes()
    assert before in whole
    path.write_bytes(whole.replace(before, after, 1))
    found = read_recording(path)
    assert len(found.columns) == 1
    assert any(told in notice for notice in found.notices)


@pytest.mark.parametrize("head", [b"\x20\0\0\0\x5b", b"\x01\0\0\0\x01", b"\x01\0\0\0\0"])
def test_a_unit_that_is_no_text_of_a_tdms_file_is_told(head, written):
    """It is longer than it was, or a number, which may be 0."""
    path = written("tdms")
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b"unit_string\x20\0\0\0\x01", b"unit_string" + head, 1))
    found = read_recording(path)
    (column,) = (c for c in found.columns if c.name == "setpoint")
    assert (column.unit, len(column.values)) == ("", foreign.N)
    assert any("the unit of channel 'setpoint' is no text" in n for n in found.notices)


def test_a_unit_that_cannot_be_read_of_an_hdf5_file_is_told(written):
    path = written("hdf5")
    whole = path.read_bytes()
    at = whole.index(b"unit\0\0\0\0\x19") + 21  # size of the text's type
    path.write_bytes(whole[:at] + b"\x91" + whole[at + 1 :])
    found = read_recording(path)
    column = next(c for c in found.columns if c.name == "log.p")
    assert (column.unit, len(column.values)) == ("", foreign.N)
    assert any("the unit of 'log.p' cannot be read" in notice for notice in found.notices)


def test_a_tdms_segment_of_unknown_length_goes_on_to_the_end(written):
    """So does the last one of a writer that was killed."""
    path = written("tdms")
    whole = path.read_bytes()
    at = whole.rfind(b"TDSm") + 12
    path.write_bytes(whole[:at] + b"\xff" * 8 + whole[at + 8 :])
    found = read_recording(path)
    assert [len(c.values) for c in found.columns] == [foreign.N, foreign.N]
    assert not any("segments end" in text for text in found.notices)


def test_numbers_of_no_usual_kind_in_an_hdf5_file_are_told(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "a.h5"
    odd = h5py.h5t.IEEE_F64LE.copy()
    odd.set_ebias(1022)
    with h5py.File(path, "w") as file:
        file["time_s"], file["setpoint"] = foreign.SECONDS, foreign.COMMAND
        space = h5py.h5s.create_simple(foreign.PRESSURE.shape)
        h5py.h5d.create(file.id, b"p_bar", odd, space).write(
            h5py.h5s.ALL, h5py.h5s.ALL, foreign.PRESSURE
        )
    assert any("'p_bar' is of no usual kind" in n for n in read_recording(path).notices)


@pytest.mark.parametrize("kind", ["none", "virtual"])
def test_rows_of_an_mdf_file_that_count_as_seconds_are_told(tmp_path, kind):
    asammdf = pytest.importorskip("asammdf")
    path = tmp_path / "a.mf4"
    foreign.mdf(path)
    data = path.read_bytes()
    with asammdf.MDF(path) as file:
        masters = [file.groups[g].channels[c].address for g, c in file.masters_db.items()]
    changed = bytearray(data)
    for at in masters:
        assert changed[at : at + 4] == b"##CN"
        links = int.from_bytes(changed[at + 16 : at + 24], "little")
        changed[at + 24 + 8 * links] = 0 if kind == "none" else 3  # 2: a master with values
    path.write_bytes(changed)
    found = read_recording(path)
    assert any(" have no times, their rows count as seconds: " in line for line in found.notices)


@pytest.mark.parametrize(
    ("kind", "unit", "over"),
    [(2, "deg", "an angle [deg]"), (1, "ms", "[ms]"), (4, "", "an index")],
)
def test_rows_of_an_mdf_file_over_something_else_than_seconds_are_told(tmp_path, kind, unit, over):
    asammdf = pytest.importorskip("asammdf")
    path = tmp_path / "a.mf4"
    seconds = np.arange(100) * 0.01
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(np.sin(seconds), seconds, name="p", unit="bar")])
        master = file.groups[0].channels[file.masters_db[0]]
        master.sync_type, master.unit = kind, unit
        file.save(path)
    (line,) = read_recording(path).notices
    assert line.endswith(f": 1 channels stand over {over}, which counts as seconds: p")


@pytest.mark.parametrize("link", [1, 2, 6])  # parts, name, unit
def test_a_link_of_an_mdf_channel_to_another_block_is_told(tmp_path, link):
    asammdf = pytest.importorskip("asammdf")
    path = tmp_path / "a.mf4"
    foreign.mdf(path)
    assert read_recording(path).notices == ()
    with asammdf.MDF(path) as file:
        at = file.groups[1].channels[1].address + 24 + 8 * link
        elsewhere = file.groups[1].channel_group.address
    changed = bytearray(path.read_bytes())
    changed[at : at + 8] = elsewhere.to_bytes(8, "little")
    path.write_bytes(changed)
    try:
        told = " ".join(read_recording(path).notices)
    except BagError as err:
        told = str(err)
    assert "lead to other blocks" in told or "is no whole MDF file" in told


def test_a_channel_that_is_lost_behind_one_whose_links_are_not_counted_is_told(tmp_path):
    """One more and one less made as many as there are: ``p`` was lost in silence."""
    asammdf = pytest.importorskip("asammdf")
    path = tmp_path / "a.mf4"
    foreign.mdf(path)
    with asammdf.MDF(path) as file:
        at = file.groups[1].channels[0].address
    changed = bytearray(path.read_bytes())
    changed[at + 16 : at + 24] = (9 << 32).to_bytes(8, "little")  # how many links there are
    changed[at + 24 : at + 32] = bytes(8)  # the next channel
    path.write_bytes(changed)
    try:
        told = " ".join(read_recording(path).notices)
    except BagError as err:
        told = str(err)
    assert "of 4 channels that it holds its links lead to 3" in told, told


def test_an_mdf_channel_without_bits_is_told(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    path = tmp_path / "a.mf4"
    foreign.mdf(path)
    with asammdf.MDF(path) as file:
        at = file.groups[0].channels[1].address + 24 + 64 + 8
    changed = bytearray(path.read_bytes())
    assert int.from_bytes(changed[at : at + 4], "little") == 64
    changed[at : at + 4] = bytes(4)
    changed[at - 6] = 0  # of a floating-point number it is refused
    path.write_bytes(changed)
    (line,) = read_recording(path).notices
    assert line.endswith("1 channels lack the values that their groups claim: setpoint")


def test_an_mdf_group_that_claims_no_rows_is_told(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    path = tmp_path / "a.mf4"
    foreign.mdf(path)
    with asammdf.MDF(path) as file:
        at = file.groups[0].channel_group.address + 24 + 48 + 8
    changed = bytearray(path.read_bytes())
    assert int.from_bytes(changed[at : at + 8], "little") == foreign.N
    changed[at : at + 8] = bytes(8)
    path.write_bytes(changed)
    assert (
        f"{path}: 1 channels have fewer than two values: setpoint" in read_recording(path).notices
    )


@pytest.mark.parametrize("kind", ["words", "large", "mat", "tdms"])
def test_values_over_the_range_are_counted_and_told(tmp_path, kind):
    time_s, values = np.arange(3000) * 0.01, np.sin(np.arange(3000) * 0.01)
    over = values.copy()
    over[[4, 17, 2000]] = np.inf, -np.inf, np.inf
    path = tmp_path / "over.csv"
    if kind == "mat":
        path = tmp_path / "over.mat"
        scipy.io.savemat(path, {"t": time_s, "p": over, "x": values})
    elif kind == "tdms":
        nptdms = pytest.importorskip("nptdms")
        path = tmp_path / "over.tdms"
        wave = {"wf_increment": 0.01, "wf_start_offset": 0.0}
        channels = [
            nptdms.ChannelObject("g", name, data, properties=wave)
            for name, data in (("p", over), ("x", values))
        ]
        with nptdms.TdmsWriter(path) as writer:
            writer.write_segment(channels)
    else:
        repeats = 1 if kind == "words" else 20  # 20: read block by block
        time_s = np.arange(3000 * repeats) * 0.01
        over = np.concatenate([over, *[values] * (repeats - 1)])
        values = np.tile(values, repeats)
        word = {np.inf: "OVL" if kind == "words" else "inf", -np.inf: "-inf"}
        rows = [
            f"{t:.2f},{word.get(p, repr(float(p)))},{x!r}"
            for t, p, x in zip(time_s, over, values.tolist(), strict=True)
        ]
        path.write_text("t,p,x\n" + "\n".join(rows) + "\n")
    found = read_recording(path)
    p, x = found.columns
    np.testing.assert_array_equal(p.values, np.where(np.isinf(over), np.nan, over))
    np.testing.assert_array_equal(x.values, values)
    told = [line for line in found.notices if "over the range" in line]
    assert told == [
        f"{path}: column 'p': 3 values are over the range (infinite), "
        f"the first is value 5 of {len(over)}; read as no value"
    ]


def test_an_hdf5_file_that_states_kind_or_place_of_values_wrongly_is_told(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "a.mat"
    foreign.mat73(path)
    data = path.read_bytes()
    with h5py.File(path, "r") as file:
        at = file["log/p"].id.get_offset() - file.userblock_size
    kind = data.index(b"\x11\x20\x3f\x00\x08\x00\x00\x00")
    place = data.index(at.to_bytes(8, "little") + (8 * foreign.N).to_bytes(8, "little"))
    assert not read_recording(path).notices
    for where, flip, why in (
        (kind, 0x01, "no measurement has"),  # whole numbers
        (kind + 1, 0x01, "no measurement has"),  # the other order of bytes
        (place + 1, 0x10, "stand at one place"),
    ):
        out = bytearray(data)
        out[where] ^= flip
        path.write_bytes(out)
        assert any(why in notice for notice in read_recording(path).notices), (where, why)


@pytest.mark.parametrize(
    ("values", "is_told"),
    [
        (1_700_000_000_000_000_000 + 10**7 * np.arange(9), False),
        (np.exp(-1000.0 * np.arange(9.0)), False),
        (np.exp(-40.0 * np.arange(9.0)).astype(np.float32), False),
        (np.full(9, 6e-8, dtype=np.float16), False),
        (np.zeros(9), False),
        (np.linspace(0.1, 0.9, 9).view(np.int64), True),
        (np.linspace(0.1, 0.9, 9).byteswap(), True),
        (np.arange(1, 10).view(np.float64), True),
    ],
    ids=["dates", "dies away", "so in 32 bits", "halves", "rest", "bits", "bytes", "whole"],
)
def test_numbers_that_look_like_the_bits_of_others_are_told(values, is_told):
    assert _is_misread(values) == is_told
