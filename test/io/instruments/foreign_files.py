# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The same short recording written by the programs that write such files."""

from __future__ import annotations

from datetime import datetime, timezone

import numpy as np
import pytest
import scipy.io

N = 200
STEP_S = 0.05
START = datetime(2026, 3, 1, 6, 30, tzinfo=timezone.utc)
SECONDS = STEP_S * np.arange(N)
COMMAND = 40.0 * (np.arange(N) % 80 >= 40) + 10.0
PRESSURE = np.convolve(COMMAND, np.full(8, 0.125))[:N] * 1.5


def excel(path):
    openpyxl = pytest.importorskip("openpyxl")

    book = openpyxl.Workbook()
    book.active.append(["a cover sheet"])
    sheet = book.create_sheet("data")
    sheet.append(["Test bench 7"])
    sheet.append([])
    sheet.append(["Time", "Set point", "Pressure"])
    sheet.append(["s", "%", "bar"])
    for row in zip(SECONDS.tolist(), COMMAND.tolist(), PRESSURE.tolist(), strict=True):
        sheet.append(row)
    book.save(path)


def mat5(path):
    log = {"setpoint": COMMAND[:, None], "p_bar": PRESSURE}
    scipy.io.savemat(path, {"time_s": SECONDS, "log": log, "gain": 3.0, "note": "bench"})


def mat73(path):
    h5py = pytest.importorskip("h5py")

    with h5py.File(path, "w", userblock_size=512) as file:
        file["time_s"] = SECONDS[None, :]
        group = file.create_group("log")
        group["setpoint"] = COMMAND[None, :]
        group.create_dataset("p", data=PRESSURE[None, :]).attrs["unit"] = "bar"
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(128))


def tdms(path):
    nptdms = pytest.importorskip("nptdms")

    wave = {"wf_increment": STEP_S, "wf_start_time": np.datetime64("2026-03-01T06:30:00")}
    with nptdms.TdmsWriter(path) as writer:
        for name, unit, values in (("setpoint", "%", COMMAND), ("p", "bar", PRESSURE)):
            writer.write_segment(
                [
                    nptdms.ChannelObject(
                        "log", name, values, properties={**wave, "unit_string": unit}
                    )
                ]
            )


def mdf(path):
    asammdf = pytest.importorskip("asammdf")

    with asammdf.MDF(version="4.10") as file:
        file.start_time = START
        for name, unit, values in (("setpoint", "%", COMMAND), ("p", "bar", PRESSURE)):
            file.append([asammdf.Signal(values, SECONDS, name=name, unit=unit)])
        file.save(path, overwrite=True)


def parquet(path):
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")

    stamps = (int(START.timestamp() * 1e6) + np.rint(SECONDS * 1e6)).astype("datetime64[us]")
    fields = [
        pa.field("when", pa.timestamp("us", tz="UTC")),
        pa.field("setpoint", pa.float64(), metadata={"unit": "%"}),
        pa.field("p_bar", pa.float64()),
        pa.field("note", pa.string()),
    ]
    columns = [pa.array(stamps, fields[0].type), COMMAND, PRESSURE, ["x"] * N]
    pq.write_table(pa.table(columns, schema=pa.schema(fields)), path)


def text(path):
    lines = ["Prüfstand 7;;", "Öffnung, gemessen;;", "Zeit;Sollwert;Druck;Druck", "s;%;bar;bar"]
    table = zip(SECONDS, COMMAND, PRESSURE, 2.0 * PRESSURE, strict=True)
    lines += [";".join(f"{v:.4f}".replace(".", ",") for v in row) for row in table]
    path.write_bytes("\r\n".join(lines).encode("cp1252"))


def sqlite_bag(path):
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    kind = "sensor_msgs/msg/FluidPressure"
    time, header = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        topic = bag.add_connection("/p", kind, typestore=store)
        for i, value in enumerate(PRESSURE):
            stamp = int(START.timestamp() * 1e9) + round(i * STEP_S * 1e9)
            head = header(time(stamp // 10**9, stamp % 10**9), "")
            message = store.types[kind](head, value * 1e5, 0.0)
            bag.write(topic, stamp + 10**6, store.serialize_cdr(message, kind))
