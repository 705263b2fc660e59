# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Faults of a stored history: what beside the features decides whether one is told."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.diagnosis.direct.bounds import WEAK_SMALL
from valve_twin.core.diagnosis.direct.freezing import DUE, MISSED
from valve_twin.core.diagnosis.features import ESTIMATOR, NOISE
from valve_twin.core.diagnosis.generic.reference import _PREFIX
from valve_twin.core.diagnosis.generic.rig import ModelRig
from valve_twin.core.diagnosis.history import diagnose
from valve_twin.core.refusal import RefusalCode
from valve_twin.core.types import Estimate, EstimateStatus, Maintenance, ParameterValue
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.core.valves.registry import get_model
from valve_twin.io.config.valve import load_config
from valve_twin.io.offline.simulated_bag import simulation_of


def estimate(cycle, estimator=ESTIMATOR, noise=None, code=""):
    return Estimate(
        model="press_cartridge",
        estimator=estimator,
        cycle=cycle,
        start_ns=cycle * 30 * 10**9,
        end_ns=cycle * 30 * 10**9 + 25 * 10**9,
        parameters=() if noise is None else (ParameterValue(NOISE, noise),),
        status=EstimateStatus.REFUSED if code else EstimateStatus.PARTIAL,
        reason="",
        reason_code=code,
    )


@pytest.mark.parametrize(
    ("apart", "code", "told"),
    [
        (None, "", True),
        (19, RefusalCode.IMPLAUSIBLE, False),  # the noise begins with cycle 20
        (30, RefusalCode.IMPLAUSIBLE, False),
        (10, RefusalCode.IMPLAUSIBLE, True),  # long before
        (19, RefusalCode.NO_MOTION, True),
    ],
)
def test_a_noise_is_not_told_about_cycles_whose_signals_do_not_belong_together(apart, code, told):
    rng = np.random.default_rng(3)
    history = [
        estimate(c, noise=(1e-4 if c < 20 else 4e-4) * float(rng.uniform(0.95, 1.05)))
        for c in range(1, 26)
        if c != apart
    ]
    if apart is not None:
        history.append(estimate(apart, "output_error", code=code.value))
    found = [f.fault for f in diagnose(history, ()).findings]
    assert ("sensor_noise" in found) is told


@pytest.mark.parametrize(
    ("newest", "told"), [(1, ""), (2, "the newest 2 cycles are of no product")]
)
def test_cycles_of_a_new_product_are_compared_with_nothing(newest, told):
    longer = [
        replace(estimate(c, noise=1e-4), end_ns=c * 30 * 10**9 + 28 * 10**9)
        for c in range(31, 31 + newest)
    ]
    doubt = diagnose([*(estimate(c, noise=1e-4) for c in range(1, 31)), *longer], ()).doubt
    assert doubt.startswith(f"no reference yet: {told}") if told else not doubt


def stored(kind, row):
    """Return features as they are stored of a row as they are followed."""
    return tuple(
        ParameterValue(n, float(np.exp(v) if n in kind.relative else v))
        for n, v in zip(kind.names, row, strict=True)
    )


CHANGED = 41
"""Cycle from which on another product is made."""


def changed_product(fault, *, which, cycles=70):
    """Return features of two products with a signature from cycle 31 to the change."""
    table, kind = MODEL.signatures(), MODEL.feature_set
    rng = np.random.default_rng(5)
    rows = rng.multivariate_normal(np.zeros(len(kind.names)), table.covariance, cycles)
    signature = [s for s in table.signatures if s.fault == fault][which]
    rows[30 : CHANGED - 1] += np.array(signature.change)
    return two_products(kind, rows, CHANGED)


def two_products(kind, rows, since):
    """Return cycles of 25 s, and from cycle `since` on of 28 s."""
    return [
        replace(
            estimate(c),
            parameters=stored(kind, row),
            end_ns=c * 30 * 10**9 + (25 if c < since else 28) * 10**9,
        )
        for c, row in enumerate(rows, 1)
    ]


@pytest.mark.parametrize("newest", [0, 2])
def test_a_step_that_raised_no_alarm_is_told_beside_a_product_that_is_not_known(newest):
    """A stored reference may say that the product is known, and nothing of the step."""
    table, kind = MODEL.signatures(), MODEL.feature_set
    rng = np.random.default_rng(0)
    rows = 3.0 * rng.multivariate_normal(np.zeros(len(kind.names)), table.covariance, 44 + newest)
    rows[12:] += 2.0 * np.array([s.change for s in table.signatures if s.fault == "preload"][1])
    history = two_products(kind, rows, 45)
    found = diagnose(history, ())
    assert not found.findings
    assert found.doubt.startswith("no reference: cycles 1 to 1")


def test_a_step_of_a_product_is_told_where_another_is_made_since():
    """It came to stay four cycles before the product changed: the other knows nothing else."""
    table, kind = MODEL.signatures(), MODEL.feature_set
    rng = np.random.default_rng(3)
    rows = rng.multivariate_normal(np.zeros(len(kind.names)), table.covariance, 40)
    change = next(s.change for s in table.signatures if s.fault == "preload")
    rows[11:] += 6.0 * np.array(change)
    history = two_products(kind, rows, 16)
    found = diagnose(history, ())
    assert not found.findings
    assert found.doubt.startswith("no reference: cycles 1 to 11 differ")
    assert not diagnose(history, [Maintenance(0, 16, "")]).doubt


@pytest.mark.parametrize(("value", "told"), [(0.0, ""), (0.7, "cycle 30 shows what no sound")])
def test_what_no_sound_valve_shows_is_told_of_the_newest_cycle(value, told):
    history = [estimate(c, noise=1e-4) for c in range(1, 31)]
    weak = ParameterValue(WEAK_SMALL, value)
    history[-1] = replace(history[-1], parameters=(*history[-1].parameters, weak))
    found = diagnose(history, ())
    assert not found.findings
    assert found.odd.startswith(told) if told else not found.odd
    assert not diagnose([*history, estimate(31, noise=1e-4)], ()).odd


def test_one_value_that_repeats_is_told_of_no_cycle():
    history = [estimate(c, noise=1e-4) for c in range(1, 31)]
    once = (ParameterValue(MISSED, 1.0), ParameterValue(DUE, 200.0))
    history[-1] = replace(history[-1], parameters=(*history[-1].parameters, *once))
    found = diagnose(history, ())
    assert not found.findings
    assert not found.odd


@pytest.mark.parametrize("fault", ["leak", "coil_resistance"])
def test_maintenance_ends_a_fault_of_a_product_that_is_not_made_any_more(fault):
    history = changed_product(fault, which=1)
    before = diagnose(history, ())
    assert [f.fault for f in before.findings] == [fault]
    assert "mark maintenance" in before.doubt
    assert not before.findings[0].end_seen
    for mark, end in ((43, 43), (50, before.findings[0].end)):  # 45: no longer told by then
        found = diagnose(history, [Maintenance(0, mark, "")])
        assert [(f.onset, f.end) for f in found.findings] == [(31, end)]
        assert not found.doubt


def test_maintenance_ends_a_fault_that_is_still_told_of_another_product():
    history = changed_product("leak", which=1, cycles=44)
    assert diagnose(history, ()).present is not None  # too few cycles followed
    assert diagnose(history, [Maintenance(0, 43, "")]).present is None


def test_a_mark_for_the_cycle_that_runs_leaves_what_was_found():
    history = changed_product("leak", which=1, cycles=44)
    found = diagnose(history, [Maintenance(0, 45, "", new_reference=True)])
    assert found.findings == diagnose(history, ()).findings


def features_of(model, vectors):
    """Return features as they are stored of a model that is held against a reference."""
    known = (ParameterValue(_PREFIX + model.parameters[0].name, 1.0),)
    return [
        replace(
            estimate(c),
            model=model.name,
            parameters=known + stored(model.feature_set, row),
        )
        for c, row in enumerate(vectors, 1)
    ]


@pytest.mark.no_cover
def test_a_shipped_valve_whose_first_cycles_are_sound_has_a_reference(root):
    """Judged by the rule of another valve, 5 of 16 such double solenoids had none for good."""
    (shipped,) = load_config(root / "config" / "double_solenoid.yaml")
    model = get_model(shipped.model)
    rig = ModelRig(model, shipped.options, simulation_of(shipped))
    doubts = [
        diagnose(features_of(model, rig.run(rig.start(seed), 30)), ()).doubt
        for seed in (73000, 73002, 73003, 73006)
    ]
    assert doubts == [""] * 4
