# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from __future__ import annotations

import numpy as np
import pytest

from valve_twin.io.errors import BagError
from valve_twin.io.instruments.read import read_recording


def recorded(path, text, encoding="utf-8"):
    path.write_bytes(text.encode(encoding))
    return read_recording(path)


def rows(fmt, count=60):
    return "\n".join(fmt(i) for i in range(count)) + "\n"


def values(recording, name):
    return next(c for c in recording.columns if c.name == name).values


LAYOUTS = {
    "comma": ("t_s,u,x\n", lambda i: f"{0.1 * i:.1f},{i},{-2.5 * i}"),
    "semicolon and decimal comma": (
        "t_s;u;x\n", lambda i: f"{0.1 * i:.1f};{i};{-2.5 * i}".replace(".", ",")
    ),
    "tab": ("t_s\tu\tx\n", lambda i: f"{0.1 * i:.1f}\t{i}\t{-2.5 * i}"),
    "blanks": ("t_s   u   x\n", lambda i: f" {0.1 * i:.1f}   {i}  {-2.5 * i}"),
    "bar": ("t_s|u|x\n", lambda i: f"{0.1 * i:.1f}|{i}|{-2.5 * i}"),
    "quoted decimal commas": (
        't_s,u,x\n', lambda i: f'"{0.1 * i:.1f}","{i}","{-2.5 * i}"'.replace(".", ",")
    ),
    "separator behind the last cell": ("t_s;u;x;\n", lambda i: f"{0.1 * i:.1f};{i};{-2.5 * i};"),
}  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_separator_and_decimal_mark_are_found(tmp_path, layout):
    header, fmt = LAYOUTS[layout]
    found = recorded(tmp_path / "a.csv", header + rows(fmt))
    np.testing.assert_allclose(values(found, "u"), np.arange(60))
    np.testing.assert_allclose(values(found, "x"), -2.5 * np.arange(60))
    np.testing.assert_allclose(found.columns[0].seconds, 0.1 * np.arange(60), atol=1e-9)
    assert found.measured


ENCODINGS = ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "cp1252", "cp850"]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_the_encoding_is_found(tmp_path, encoding):
    text = "Zeit [s];Öffnung [%];Kühlöl [°C]\n" + rows(lambda i: f"{0.1 * i:.1f};{i};20.5")
    found = recorded(tmp_path / "a.csv", text, encoding)
    assert [c.name for c in found.columns] == ["Öffnung [%]", "Kühlöl [°C]"]
    assert [c.unit for c in found.columns] == ["%", "°C"]


WRITTEN = {
    "cp1252": ("Kühlöl", "Größe", "Ventilöffnung", "Durée", "Presión [°C]", "Weg [µm]", "m³/h"),
    "cp850": ("Öffnung", "Kühlöl [°C]", "Weg [µm]", "Größe"),
    "cp1250": ("Położenie", "Ciśnienie"),
    "cp1251": ("Положение", "Давление"),
    "gb18030": ("时间", "温度PV", "压力 [s]"),
    "euc_kr": ("시간", "위치"),
    "cp932": ("時間", "位置 [mm]"),
}


@pytest.mark.parametrize("encoding", WRITTEN)
def test_what_is_written_in_a_country_is_read(tmp_path, encoding):
    """ "°C" was read as one Chinese character, so that the unit was lost, and so was "Kühlöl"."""
    pytest.importorskip("charset_normalizer")
    for name in WRITTEN[encoding]:
        text = f"t_s;{name}\n" + rows(lambda i: f"{0.1 * i:.1f};{i % 7}")
        assert [c.name for c in recorded(tmp_path / "a.csv", text, encoding).columns] == [name]


PREAMBLE = """Instrument;DAQ-9000;rev 3
Operator;M. Müller
Sample rate [Hz];200
Remark;"first run; pump 2"
Channels;4

Ch 1;Ch 2;Ch 2;Ch 4
V;mA;mA;bar
"""


def test_a_raw_export_with_preamble_and_duplicate_names_is_read(tmp_path):
    found = recorded(tmp_path / "a.csv", PREAMBLE + rows(lambda i: f"{i % 7};{i};{2 * i};1,5"))
    assert [(c.name, c.unit) for c in found.columns] == [
        ("Ch 1", "V"), ("Ch 2", "mA"), ("Ch 2_2", "mA"), ("Ch 4", "bar"),
    ]  # fmt: skip
    np.testing.assert_allclose(values(found, "Ch 2_2"), 2.0 * np.arange(60))
    np.testing.assert_allclose(found.columns[0].seconds, np.arange(60) / 200.0)
    assert "says 'Sample rate" in found.clock


DATES = {
    "2026-03-01T06:30:{s:06.3f}Z": ("2026-03-01T06:30:00", True),
    "2026-03-01 06:30:{s:06.3f}": ("2026-03-01T06:30:00", False),
    "01.03.2026 06:30:{s:06.3f}": ("2026-03-01T06:30:00", False),
    "3/1/2026 6:30:{s:06.3f} PM": ("2026-03-01T18:30:00", False),
    "2026-03-01T08:30:{s:06.3f}+02:00": ("2026-03-01T06:30:00", True),
    "01.03.2026\t06:30:{s:06.3f}": ("2026-03-01T06:30:00", False),
}


@pytest.mark.parametrize("form", DATES)
def test_dates_and_zones_are_read(tmp_path, form):
    start, zoned = DATES[form]
    mark = "\t"
    head = "day\ttime" if "\t" in form else "when"
    text = f"{head}\tx\n" + rows(lambda i: form.format(s=0.5 * i) + f"{mark}{i}")
    found = recorded(tmp_path / "a.csv", text)
    expected = np.datetime64(start, "ns").astype(np.int64)
    assert found.start_ns == expected
    np.testing.assert_allclose(found.columns[0].seconds, 0.5 * np.arange(60), atol=1e-6)
    assert ("no zone is stated" in found.clock) is not zoned


@pytest.mark.parametrize(("zone", "count"), [("", 1), ("Z", 0)])
@pytest.mark.parametrize("month", [3, 6])
def test_the_hour_that_a_clock_without_zone_skips_is_told(tmp_path, zone, count, month):
    day = {3: 29, 6: 28}[month]  # both a Sunday
    times = [f"01:{m}" for m in range(30, 60)] + [f"03:{m:02d}" for m in range(30)]
    text = "when;x\n" + rows(lambda i: f"2026-{month:02d}-{day}T{times[i]}:00{zone};{i}")
    found = recorded(tmp_path / "a.csv", text)
    assert len(found.notices) == (count if month == 3 else 0)
    assert all("a.csv:32: the clock skips the hour after" in n for n in found.notices)


def test_figures_of_another_script_are_told(tmp_path):
    text = "t;x;y\n" + rows(lambda i: f"{i};{i};{'١٢' if i == 50 else i}")
    found = recorded(tmp_path / "a.csv", text)
    assert any("'١٢'" in notice for notice in found.notices)


def test_invented_times_are_not_called_measured(tmp_path):
    counted = recorded(tmp_path / "a.csv", "u,x\n" + rows(lambda i: f"{i % 9},{i % 5}"))
    assert not counted.measured
    assert "the file states no time" in counted.clock
    unitless = recorded(tmp_path / "b.csv", "time,x\n" + rows(lambda i: f"{i},{i % 5}", 2000))
    assert not unitless.measured
    assert "taken for milliseconds" in unitless.clock


def test_a_cell_that_is_no_number_is_named_and_left_out(tmp_path):
    text = "t_s,u,x\n" + rows(lambda i: f"{0.1 * i:.1f},{'abc' if i == 7 else i},{i % 4}")
    found = recorded(tmp_path / "a.csv", text)
    assert np.isnan(values(found, "u")[7])
    assert np.isfinite(np.delete(values(found, "u"), 7)).all()
    (notice,) = found.notices
    assert "a.csv:9: column 'u': 'abc' is no number" in notice


def test_rows_that_go_back_in_time_are_named_and_left_out(tmp_path):
    text = "t_s,x\n" + rows(lambda i: f"{0.1 * (i if i != 30 else 3):.1f},{i % 4}", 90)
    found = recorded(tmp_path / "a.csv", text)
    assert len(found.columns[0].values) == 89
    (notice,) = found.notices
    assert "a.csv:32: column 't_s': 0.3 stands behind 2.9 and before 3.1; 1 such row" in notice


def test_a_row_cut_off_at_the_end_and_a_footer_are_left_out(tmp_path):
    text = "t_s,u,x\n" + rows(lambda i: f"{0.1 * i:.1f},{i % 9},{i % 4}") + "End of file\n"
    found = recorded(tmp_path / "a.csv", text)
    assert len(found.columns[0].values) == 60
    assert any("a.csv:62" in n for n in found.notices)


def test_commas_with_two_readings_are_refused_with_their_line(tmp_path):
    text = "t_s;x\n" + rows(lambda i: f"{i};{i + 1},{i + 100:03d}")
    with pytest.raises(BagError, match=r"a.csv:2: column 'x': '1,100': the comma may stand"):
        recorded(tmp_path / "a.csv", text)


@pytest.mark.parametrize("count", [60, 9000])  # the latter is read by blocks
@pytest.mark.parametrize("cell", ["1.234", "12.345.678", "1.234,5"])
def test_points_with_two_readings_are_refused_with_their_line(tmp_path, count, cell):
    lines = [f"{i // 20},{i % 20 * 5:02d};{i % 7},5;{i % 4}.25" for i in range(count)]
    at = count - 20
    parts = lines[at].split(";")
    column, place = ("x", 1) if "," not in cell else ("y", 2)
    parts[place] = cell
    lines[at] = ";".join(parts)
    text = "t_s;x;y\n" + "\n".join(lines) + "\n"
    said = rf"a.csv:{at + 2}: column '{column}': '{cell}': the point may stand"
    with pytest.raises(BagError, match=said):
        recorded(tmp_path / "a.csv", text)


@pytest.mark.parametrize("count", [60, 9000])
def test_one_decimal_comma_among_decimal_points_is_refused(tmp_path, count):
    lines = [f"{0.05 * i:.2f},{i % 7}.5" for i in range(count)]
    lines[count - 100 if count > 100 else 40] = '4000.00,"1.234,5"'
    with pytest.raises(BagError, match=r"column 'x': '1.234,5': the point may stand"):
        recorded(tmp_path / "a.csv", "t_s,x\n" + "\n".join(lines) + "\n")


@pytest.mark.parametrize("count", [60, 9000])
def test_points_that_can_only_be_decimal_are_read_beside_decimal_commas(tmp_path, count):
    text = "t_s;x;y\n" + "".join(
        f"{i // 20},{i % 20 * 5:02d};{i % 7},5;{1 + i % 4}.{250 * (i % 4):03d}0\n"
        for i in range(count)
    )
    found = recorded(tmp_path / "a.csv", text)
    np.testing.assert_allclose(values(found, "y"), 1.0 + 1.25 * (np.arange(count) % 4))


def test_a_sign_of_inches_is_no_quote(tmp_path):
    text = "t_s,note,x\n" + rows(lambda i: f'{0.1 * i:.1f},5" pipe,{i % 4}')
    found = recorded(tmp_path / "a.csv", text)
    np.testing.assert_allclose(values(found, "x"), np.arange(60) % 4)


def test_one_cycle_a_row_is_put_into_one_column(tmp_path):
    table = np.random.default_rng(0).normal(size=(12, 150))
    text = "\n".join("\t".join(f"{v:.6f}" for v in row) for row in table)
    found = recorded(tmp_path / "a.txt", text)
    np.testing.assert_allclose(values(found, "value"), table.ravel(), atol=1e-6)
    np.testing.assert_array_equal(values(found, "cycle"), np.repeat(np.arange(12), 150))


def test_measured_records_are_read_whole(measured):
    crane = read_recording(measured / "hydraulic_actuator" / "actuator.csv")
    assert [len(c.values) for c in crane.columns] == [1024] * 3
    assert not crane.measured
    rig = read_recording(next((measured / "zema_hydraulic_rig").glob("fs1*.gz")))
    assert len(values(rig, "value")) % 600 == 0


def test_the_boiler_valve_is_read_with_its_units(shared):
    found = read_recording(shared / "damadics_boiler_valve" / "boiler_valve_first_half.csv")
    units = {c.name: c.unit for c in found.columns}
    assert (units["LC74_20CV_pct"], units["P74_00_P1_kPa"]) == ("pct", "kPa")
    assert found.measured


@pytest.mark.parametrize("time", [lambda i: i // 4, lambda i: 60 - i])
def test_a_time_that_does_not_rise_is_named_where_rows_are_counted(tmp_path, time):
    found = recorded(tmp_path / "a.csv", "t [s],x\n" + rows(lambda i: f"{time(i)},{i % 5}"))
    assert not found.measured
    assert "column 't [s]' rises in" in found.clock


@pytest.mark.parametrize("row", [0, 30, 119])
@pytest.mark.parametrize("time", ["1e9", "-7e5"])
def test_a_wild_time_costs_its_own_row_only(tmp_path, row, time):
    text = "t_s,x\n" + rows(lambda i: f"{time if i == row else f'{0.1 * i:.1f}'},{i % 4}", 120)
    found = recorded(tmp_path / "a.csv", text)
    assert len(found.columns[0].values) == 119
    assert found.columns[0].seconds[-1] == pytest.approx(0.1 * (119 - (row in (0, 119))))
    (notice,) = found.notices
    assert f"a.csv:{row + 2}: column 't_s': {float(time):.12g} stands" in notice


def test_a_pause_before_many_rows_is_no_wild_time(tmp_path):
    text = "t_s,x\n" + rows(lambda i: f"{0.1 * i + 1e6 * (i >= 100)},{i % 4}", 120)
    found = recorded(tmp_path / "a.csv", text)
    assert len(found.columns[0].values) == 120
    assert not found.notices
