# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A made-up valve for the report: 105 cycles in which the inflow gain falls by 15 %."""

from __future__ import annotations

import numpy as np

from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.types import (
    Estimate,
    EstimateStatus,
    Maintenance,
    MaskCounts,
    Parameter,
    ParameterStatus,
    ParameterValue,
    Prediction,
    Validity,
)
from valve_twin.io.history.tables import CycleRecord
from valve_twin.report import ReportData

START_NS = 1_770_000_000 * 10**9
PARAMETERS = (
    Parameter("K_in", "1", "inflow gain a sample: stroke share per full command", 0.0, trend=True),
    Parameter("K_out", "1", "outflow gain a sample at command 0.3", 0.0, trend=True),
    Parameter("leak", "1/s", "leak to the tank, stroke share a second", 0.0, trend=True),
    Parameter("pole", "1", "pole of the spool chamber", 0.0, 1.0),
)


def estimates(cycles: int = 105, drift: float = -0.15, seed: int = 3) -> list[Estimate]:
    rng = np.random.default_rng(seed)
    out = []
    for n in range(1, cycles + 1):
        share = (n - 1) / 104
        truth = {
            "K_in": 0.0512 * (1 + drift * share),
            "K_out": 0.118,
            "leak": 0.0021 * (1 + 0.4 * share),
            "pole": 0.32,
        }
        scatter = {"K_in": 0.006, "K_out": 0.02, "leak": 0.12, "pole": 0.03}
        start = START_NS + n * 3600 * 10**9
        for name in ("output_error", "equation_error_qp4"):
            used = name == "output_error"
            values = []
            for key, true in truth.items():
                value = true * (1 + (0.03 if not used else 0) + scatter[key] * rng.normal())
                half = 1.96 * scatter[key] * true if n >= 10 and used else np.nan
                parameter = ParameterValue(
                    key, value, ParameterStatus.OK, "", half / 1.96, value - half, value + half
                )
                if key == "leak" and n % 23 == 0:
                    why = "no rest longer than 1 s with the spool off its stops"
                    parameter = ParameterValue(key, np.nan, ParameterStatus.NOT_EXCITED, why)
                if not used and key == "leak":
                    parameter = ParameterValue(key, 0.0, ParameterStatus.AT_BOUND, "rests on 0")
                values.append(parameter)
            partial = any(not p.usable for p in values)
            out.append(
                Estimate(
                    model="press_cartridge",
                    estimator=name,
                    cycle=n,
                    start_ns=start,
                    end_ns=start + 45 * 10**9,
                    parameters=tuple(values),
                    status=EstimateStatus.PARTIAL if partial else EstimateStatus.ACCEPTED,
                    reason="some parameters refused" if partial else "all parameters usable",
                    mse_test=np.nan if n == 1 else 2.1e-6,
                    mse_train=1.9e-6,
                    fit_test=np.nan if n == 1 else 97.0 + 0.4 * rng.normal(),
                    fit_train=97.6,
                    condition_number=41.0,
                    lag=1,
                    noise_sigma=1.02e-3,
                    counts=MaskCounts(1304, 141, 0, 12, 1),
                    used_by_trend=used,
                )
            )
    return out


def prediction(cycle: int = 105) -> Prediction:
    rng = np.random.default_rng(1)
    t = np.arange(1500) * 0.03
    profile = np.interp(t, [0, 3, 9, 20, 24, 32, 40, 45], [0, 0, 0.92, 0.92, 0.45, 0.45, 0, 0])
    smooth = np.convolve(np.pad(profile, 20, "edge"), np.ones(41) / 41, "valid")
    measured = smooth + 1e-3 * rng.normal(size=t.size)
    predicted = smooth + 4e-4 * rng.normal(size=t.size)
    simulated = smooth + 0.004 * np.sin(t / 7)
    validity = np.full(t.size, Validity.VALID, np.uint8)
    validity[:3] = Validity.STARTING
    validity[(smooth < 1e-3)] = Validity.AT_SEAT
    predicted[:3] = np.nan
    stamp_ns = START_NS + cycle * 3600 * 10**9 + (t * 1e9).astype(np.int64)
    return Prediction(
        cycle, stamp_ns, measured, predicted, simulated, measured - predicted, 1.1e-3, validity
    )


def report_data(drift: float = -0.15, **changes: object) -> ReportData:
    found = estimates(drift=drift)
    maintenance = (
        Maintenance(START_NS + 60 * 3600 * 10**9, 60, "filter of the pilot oil changed"),
    )
    cycles = [
        CycleRecord(
            e.cycle, e.start_ns, e.end_ns, 1500, lost=int(e.cycle == 33) * 4, software="0.1.0"
        )
        for e in found
        if e.used_by_trend
    ]
    last = cycles[-1]
    cycles.append(
        CycleRecord(106, last.end_ns, last.end_ns + 10**9, 31, 0, 0, False,
                    "shorter than min_cycle_s = 1 s: the command fell back at once")
    )  # fmt: skip
    found_trend = assess(
        found, maintenance, AgingConfig(), parameters=PARAMETERS, valve="/press/valve_1"
    )
    values: dict[str, object] = {
        "valve": "/press/valve_1",
        "model": "press_cartridge",
        "source": "history.db",
        "parameters": PARAMETERS,
        "cycles": tuple(cycles),
        "estimates": tuple(found),
        "assessment": found_trend,
        "maintenance": maintenance,
        "prediction": prediction(),
        "options": {"estimators": ["output_error", "equation_error_qp4"], "v_ref": 0.3},
        "version": "0.1.0",
        "written_ns": START_NS + 110 * 3600 * 10**9,
    }
    return ReportData(**{**values, **changes})  # type: ignore[arg-type]
