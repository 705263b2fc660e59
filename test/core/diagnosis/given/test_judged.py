# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a stored reference adds: the worked example of docs/diagnosis.md, and models of valves."""

import json
import re
import shlex
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from valve_twin.cli.main import main
from valve_twin.core.diagnosis.changes.finding import Diagnosis
from valve_twin.core.diagnosis.features import ESTIMATOR
from valve_twin.core.diagnosis.generic.features import LENGTHS, ROOTS, SPAN
from valve_twin.core.diagnosis.generic.signatures import signatures_of
from valve_twin.core.diagnosis.given.judged import judged, seen_of
from valve_twin.core.diagnosis.given.reference import make_reference
from valve_twin.core.diagnosis.history import diagnose, followed_features
from valve_twin.core.past.columns import past_of
from valve_twin.core.types import Estimate, EstimateStatus, Maintenance, ParameterValue
from valve_twin.core.valves.registry import get_model

EXAMPLE = re.compile(r"<!-- example begins -->\n```sh\n(.*?)```", re.DOTALL)


def test_the_example_of_the_page_tells_a_leak_of_the_fourth_cycle(root, tmp_path, monkeypatch):
    page = (root / "docs" / "diagnosis.md").read_text(encoding="utf-8")
    (block,) = EXAMPLE.findall(page)
    monkeypatch.chdir(root / "config")
    for line in block.replace("/tmp/", f"{tmp_path}/").splitlines():
        if line.startswith("valve-twin "):
            assert main(shlex.split(line)[1:]) == 0, line
        else:
            subprocess.run(line, shell=True, check=True)
    lines = map(json.loads, (tmp_path / "leaks.jsonl").read_text(encoding="utf-8").splitlines())
    (verdict,) = (x for x in lines if x.get("kind") == "verdict")
    assert verdict["fault"] == "leak"
    assert "since cycle 4" in verdict["evidence"]
    told = "judged against the stored reference presses.reference (2 valves, 22 cycles)"
    assert told in verdict["evidence"]


ANY = get_model("first_order")


def table():
    """Return the signatures of a first-order valve: derived once a process, and by no import."""
    found = signatures_of(ANY)
    assert found is not None
    return found


def shown_of(history):
    """Return the features of a history that are followed."""
    rows = followed_features(past_of(history))
    assert rows is not None
    return rows


def lived(seed, models, change=0.0, since=1, span=1.0):
    """Return features against models, of a number of cycles each, with a change since a cycle.

    Their lengths are shares of a span.
    """
    kind, random = ANY.feature_set, np.random.default_rng(seed)
    deviation = np.sqrt(np.diag(np.array(table().covariance)))
    own = [value for value, cycles in models for _ in range(cycles)]
    rows = deviation * random.standard_normal((len(own), len(deviation)))
    rows[since - 1 :] += change
    lengths = np.array([n in LENGTHS and n not in ROOTS for n in kind.names])
    rows = np.where(lengths, rows / span, rows)
    rows[:, [n in ROOTS for n in kind.names]] -= np.log(span)
    return [
        Estimate(
            model=ANY.name,
            estimator=ESTIMATOR,
            cycle=c,
            start_ns=c * 30 * 10**9,
            end_ns=c * 30 * 10**9 + 25 * 10**9,
            parameters=(
                ParameterValue("reference.time_constant", value),
                ParameterValue(SPAN, span),
                *(
                    ParameterValue(n, float(np.exp(v) if n in kind.relative else v))
                    for n, v in zip(kind.names, row, strict=True)
                ),
            ),
            status=EstimateStatus.PARTIAL,
            reason="",
        )
        for c, (value, row) in enumerate(zip(own, rows, strict=True), 1)
    ]


def sisters(*spans):
    """Return a reference of three sound valves whose first cycles had some spans."""
    of = dict(zip(range(3), spans or (1.0, 1.0, 1.0), strict=True))
    lives = [lived(k, [(0.4, 20)], span=of[k]) for k in of]
    seen = [seen_of(shown_of(life), ANY, f"/v{k}") for k, life in enumerate(lives)]
    return make_reference(
        seen,
        name="sisters",
        model=ANY.name,
        features=ANY.feature_set.names,
        period_s=0.05,
        models=[{"reference.time_constant": 0.4 + 0.001 * k} for k in range(3)],
    )


@pytest.mark.parametrize("over", [False, True])
def test_a_fault_that_lasts_by_the_reference_is_told_where_the_own_past_takes_it_for_over(over):
    change = next(s.change for s in table().signatures if s.fault == "sensor_gain")
    shown = shown_of(lived(9, [(0.4, 30)], 10.0 * np.array(change), 6))

    def told(own):
        return judged(Diagnosis(own, 30, ready=True), shown, 0, ANY, table(), sisters(), "")

    (fault,) = told(()).findings
    assert (fault.fault, fault.onset, fault.end) == ("sensor_gain", 6, -1)
    own = replace(fault, onset=7, end=15 if over else -1)
    found = told((own,))
    assert found.findings == ((fault, own) if over else (own,))
    assert found.present == (fault if over else own)


@pytest.mark.parametrize("span", [0.2, 0.8])
def test_valves_whose_first_cycles_drove_other_ways_are_alike(span):
    reference = sisters(0.3, 0.9, 0.6)
    found = judged(
        Diagnosis((), 30, ready=True),
        shown_of(lived(9, [(0.4, 30)], span=span)),
        0,
        ANY,
        table(),
        reference,
        "",
    )
    assert not found.findings
    assert "within it" in found.against
    alike = sisters(0.3, 0.3, 0.3)
    np.testing.assert_allclose(reference.within, alike.within, rtol=1e-9)
    np.testing.assert_allclose(reference.over(span).over(0.3).within, alike.within, rtol=1e-9)


def test_a_fault_by_the_reference_has_its_size_in_shares_of_the_travel():
    signature = next(s for s in table().signatures if s.fault == "sensor_offset")
    change = 4.0 * np.array(signature.change)  # of the travel
    shown = shown_of(lived(9, [(0.4, 30)], change, 6, span=0.25))
    found = judged(Diagnosis((), 30, ready=True), shown, 0, ANY, table(), sisters(), "")
    (fault,) = found.findings
    assert fault.fault == "sensor_offset"
    assert fault.severity == pytest.approx(4.0 * signature.severity, rel=0.5)  # of 0.25: 4 times


@pytest.mark.parametrize(
    ("second", "mark", "since"),
    [(0.8, False, None), (0.4, True, None), (0.9, True, 21), (0.8, None, 1)],
)
def test_a_first_model_that_was_learnt_before_a_mark_is_told_no_more(second, mark, since):
    reference = sisters()
    events = [] if mark is None else [Maintenance(0, 21, "", new_reference=mark)]
    found = diagnose(lived(9, [(0.8, 20), (second, 20)]), events, reference=reference)
    assert [f.onset for f in found.findings if f.end < 0] == ([since] if since else [])
    assert ("its own first model departs" in found.against) is (since is not None)
