# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The four pilot valves of an excavator: duty to pressure on duties not trained on; the ridge.

The measured data has no licence to be copied: it is read from beside the repository, and these
tests skip where it is not there.
"""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest

from valve_twin.cli import main
from valve_twin.core.estimation.cycle.memory import Memory, model_in_force
from valve_twin.core.estimation.cycle.sequence import evaluate
from valve_twin.core.types import Cycle, Estimate, EstimateStatus, Frames, ParameterStatus
from valve_twin.core.valves.registry import get_model
from valve_twin.io.config.valve import load_config

VALVES = ("arm_in", "arm_out", "boom_dn", "boom_up")
TRAINED = (40, 60, 80, 100)  # duties [%]; structure and options were chosen among these alone
BAR = 40.0  # of 1 in the configuration
PERIOD_S = 0.01
DUTY, CURRENT, PRESSURE = 1, 2, 3


@pytest.fixture(scope="module")
def folder(root):
    path = root.parent / "shared" / "data" / "eppr_excavator"
    if not path.is_dir():
        pytest.skip(f"measured data is not there: {path}")
    return path


def say(line):
    """Show a measured figure; pytest -s or -rP prints it."""
    sys.stdout.write(f"{line}\n")


def duty_of(path):
    return int(path.name.split("_")[2])


def read_cycle(path, column=DUTY, scale=0.01):
    """Return one recording from its step on, as the configurations cut it."""
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    table = table[np.flatnonzero(table[:, DUTY] > 0.0)[0] :]
    n = len(table)
    stamps = np.arange(n, dtype=np.int64) * 10_000_000
    nothing, ok = np.full(n, np.nan), np.ones(n, dtype=bool)
    inputs = np.ascontiguousarray(table[:, column] * scale).reshape(-1, 1)
    frames = Frames(stamps, table[:, PRESSURE] / BAR, inputs, nothing, nothing, ok)
    return Cycle(1, PERIOD_S, frames)


def files_of(folder, valve):
    return sorted(folder.glob(f"{valve}_*.csv.gz"))


def test_the_pressure_follows_the_duty_on_duties_not_trained_on(root, folder):
    """Trained on 40, 60, 80, 100 %; 50, 70 and 90 % are scored once, valve by valve."""
    model = get_model("positioner")
    (config,) = load_config(root / "config" / "pilot_valve.yaml")
    fits = []
    for valve in VALVES:
        files = files_of(folder, valve)
        trained: list[Estimate] = []
        for path in files:
            if duty_of(path) in TRAINED:
                trained += model.estimate(read_cycle(path), config.options, trained)
        force = model_in_force(model, Memory(tuple(trained)), PERIOD_S, config.options)
        assert force is not None
        unseen = [read_cycle(path) for path in files if duty_of(path) not in TRAINED]
        own = [evaluate(model, force.coefficients, c.frames, PERIOD_S)[1] for c in unseen]
        say(f"{valve}: median {np.median(own):.1f} %, from {min(own):.1f} to {max(own):.1f} %")
        fits += own
    say(f"all {len(fits)} recordings of unseen duties: median {np.median(fits):.1f} %")
    assert len(fits) == 41
    assert np.median(fits) >= 87.0
    assert min(fits) > 70.0


def test_the_command_estimates_the_curve_of_a_pilot_valve(root, folder, tmp_path):
    """Dead duty and gain, from cycles that know one level each."""
    config = str(root / "config" / "pilot_valve.yaml")
    files = [str(p) for p in files_of(folder, "boom_dn") if duty_of(p) >= 50]
    bag, out = str(tmp_path / "bag"), tmp_path / "estimates.json"
    assert main(["import", *files, "--config", config, "--out", bag]) == 0
    assert main(["estimate", bag, "--config", config, "--json", str(out)]) == 0
    lines = [json.loads(line) for line in out.read_text(encoding="utf-8").splitlines()]
    estimates = [line for line in lines if line["kind"] == "estimate"]
    assert len(estimates) == len(files)
    told = [dict(zip(x["names"], x["values"], strict=True)) for x in estimates]
    curves = [v for v in told if v["dead_command"] is not None]
    dead = np.median([v["dead_command"] for v in curves])
    gains = [v["static_gain"] for v in curves]
    say(f"boom down: dead duty {dead:.3f}, gain {max(gains):.3f} to {min(gains):.3f}")
    # the current is 2397 + 52 counts a percent, the dead one 2900 counts: 9.7 %
    assert dead == pytest.approx(0.097, abs=0.025)
    # 7.4 bar per 1000 counts x 52 counts a percent; the curve bends: 1.05 at 60 %, 0.91 at 100 %
    assert np.median(gains) * BAR / 100 == pytest.approx(7.4e-3 * 52, rel=0.05)
    fits = [e["fit_test"] for e in estimates[1:]]
    assert np.median(fits) > 87.0


@pytest.mark.parametrize("valve", VALVES)
def test_with_the_current_as_input_only_the_ratio_is_published(root, folder, valve):
    """Stiffness and damping run away together: refused with what is known, the rate."""
    model = get_model("positioner")
    (config,) = load_config(root / "config" / "pilot_valve_current.yaml")
    files = [p for p in files_of(folder, valve) if duty_of(p) >= 70][::3]
    told = []
    for path in files:
        cycle = read_cycle(path, CURRENT, 1e-4)
        (found,) = model.estimate(cycle, config.options)
        values = {p.name: p for p in found.parameters}
        assert found.status is EstimateStatus.PARTIAL
        for name in ("stiffness_rising", "stiffness_falling", "damping", "velocity_lag"):
            assert values[name].status is ParameterStatus.REFUSED
            assert np.isnan(values[name].value)
        assert "not told apart" in values["damping"].reason
        assert values["rate_rising"].status is ParameterStatus.OK
        told.append(values["rate_rising"].value)
    say(f"{valve}: stiffness/damping {min(told):.1f} to {max(told):.1f} 1/s; {found.reason}")
    assert all(5.0 < rate < 300.0 for rate in told)
