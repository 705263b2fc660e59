# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The short benchmark: same results as the peers, ratios beside their goals."""

from __future__ import annotations

import re

import numpy as np
import pytest
import yaml

from valve_twin.bench import Better, Ratio, describe, require_equal, run, run_benchmarks, run_gate
from valve_twin.bench.measure import Scale
from valve_twin.bench.models import estimation

LINE = re.compile(
    r"(.+): (\S+) x (.+) \(better is higher, goal (\S+) x(?:, committed \S+ x)?; "
    r"(\S+) ms against (\S+) ms\) goal (reached|not reached)"
)


@pytest.mark.alone
def test_every_line_of_an_area_says_what_was_compared_and_how_it_ended():
    """All areas run in steps of `make test`; two are held to half their goals here."""
    lines: list[str] = []
    run_benchmarks(quick=True, write=lines.append, areas=["simulation", "estimation"])
    reference, sense, *ratios = "".join(lines).splitlines()
    assert reference.startswith("reference loop")
    assert sense.startswith("better is higher: ")
    found = [match for match in map(LINE.fullmatch, ratios) if match]
    assert len(found) == len(ratios) >= 3
    for match in found:
        value, goal, ours, peer = (float(match[i]) for i in (2, 4, 5, 6))
        assert value >= 0.5 * goal
        assert match[7] == ("reached" if value >= goal else "not reached")
        assert value == pytest.approx(peer / ours, rel=0.02)


def test_make_test_measures_every_area_once(root):
    steps = re.findall(r"valve-twin bench --quick (.+)", (root / "tools" / "check").read_text())
    areas = [area for step in steps for area in step.split()]
    assert sorted(areas) == sorted(run.AREAS)


def test_a_ratio_says_whether_it_reached_its_goal():
    def ratio(peer_s: float) -> Ratio:
        return Ratio("ours", "theirs", 1.0, peer_s, goal=20.0)

    assert describe(ratio(20.0)).endswith(" goal reached")
    assert describe(ratio(19.9)).endswith(" goal not reached")


def test_a_share_of_a_peer_that_does_less_reaches_its_goal_from_above():
    def ratio(ours_s: float) -> Ratio:
        return Ratio("ours", "theirs", ours_s, 2.0, goal=0.6, better=Better.LOWER)

    line = "ours: 0.6 x theirs (better is lower, goal 0.6 x; 1.2e+03 ms against 2000 ms)"
    assert describe(ratio(1.2)) == f"{line} goal reached"
    assert describe(ratio(1.3)).endswith(" goal not reached")


HIGHER, LOWER = Better.HIGHER, Better.LOWER


def gate(
    monkeypatch, values: list[float], committed: float | None, better=HIGHER, of=None
) -> tuple[bool, str]:
    """Hold runs of these values to what was committed in the sense `of`, default the same."""
    runs = iter(values)

    def once(*_):
        value = next(runs)
        ours, theirs = (1.0, value) if better is HIGHER else (value, 1.0)
        yield Ratio("ours", "theirs", ours, theirs, 20.0, better=better)

    known = {} if committed is None else {"ours": run.Committed(committed, of or better)}
    monkeypatch.setattr(run, "_comparisons", once)
    monkeypatch.setattr(run, "committed_ratios", lambda form: known)
    lines: list[str] = []
    return run_gate(quick=True, write=lines.append), "".join(lines)


def test_the_gate_fails_where_a_committed_ratio_was_lost(monkeypatch):
    kept, text = gate(monkeypatch, [7.0, 9.0, 8.0, 6.0, 7.9], 10.0)
    assert not kept
    line = "ours: 7.9 x (6 to 9), better is higher, committed 10 x: LOST: below 80% of it"
    assert line in text


def test_the_gate_fails_where_a_share_grew(monkeypatch):
    kept, text = gate(monkeypatch, [1.4, 1.1, 1.2, 1.6, 1.3], 1.0, LOWER)
    assert not kept
    line = "ours: 1.3 x (1.1 to 1.6), better is lower, committed 1 x: LOST: above 125% of it"
    assert line in text


@pytest.mark.parametrize(
    "values", [[1.25] * 5, [1.4, 1.4, 1.4, 1.4, 1.0], [0.1] * 5], ids=["125 %", "noisy", "better"]
)
def test_the_gate_keeps_a_share_that_the_runs_do_not_refute(monkeypatch, values):
    assert gate(monkeypatch, values, 1.0, LOWER)[0]


@pytest.mark.parametrize(("better", "of"), [(HIGHER, LOWER), (LOWER, HIGHER)])
def test_what_was_committed_in_the_other_sense_is_no_measure(monkeypatch, better, of):
    kept, text = gate(monkeypatch, [1.0] * 5, 1.0, better, of)
    assert not kept
    assert "committed in the other sense: LOST" in text


@pytest.mark.parametrize("form", ["quick", "full"])
def test_every_committed_ratio_says_in_which_sense_it_is_to_be_read(form):
    content = yaml.safe_load(run.COMMITTED.read_text(encoding="utf-8"))[form]
    assert content
    assert all(set(row) == {"ratio", "better"} for row in content.values())
    assert [row.better for row in run.committed_ratios(form).values()] == [
        row["better"] for row in content.values()
    ]


@pytest.mark.parametrize(
    "values", [[8.0] * 5, [7.0, 7.0, 7.0, 7.0, 10.0]], ids=["80 %", "as noisy as the loss"]
)
def test_the_gate_keeps_what_the_runs_do_not_refute(monkeypatch, values):
    kept, text = gate(monkeypatch, values, 10.0)
    assert kept
    assert text.splitlines()[-2].endswith(": kept")


def test_the_gate_only_prints_what_was_never_committed(monkeypatch):
    kept, text = gate(monkeypatch, [1.0] * 5, None)
    assert kept
    assert "nothing committed\n" in text


def test_the_committed_ratio_stands_beside_the_measured_one():
    ratio = Ratio("ours", "theirs", 1.0, 30.0, goal=20.0)
    assert "30 x theirs (better is higher, goal 20 x, committed 31.5 x; " in describe(ratio, 31.5)


def test_what_a_busy_machine_left_unmeasured_is_said_and_fails_the_gate_alone(monkeypatch):
    live = pytest.importorskip("valve_twin.bench.nodes.live")

    def fleet(*_, gathered_s=0.0, **__):
        if not gathered_s:
            msg = "of 99 predictions of a valve 97 came"
            raise TimeoutError(msg)
        yield Ratio("", "a bare subscriber", 1.0, 1.0, 1.0)

    for part in ("_start", "_one_valve", "_batches"):
        monkeypatch.setattr(live, part, lambda *_: iter([]))
    monkeypatch.setattr(live, "_fleet", fleet)
    first, second, *others = live.compare(Scale(quick=True, repeats=1))
    name = "50 valves at 33 Hz, single samples"
    line = f"{name}: not measured: of 99 predictions of a valve 97 came"
    assert describe(first) == line
    assert (second.name, second.value) == ("50 valves at 33 Hz, predictions a message a second", 1)
    assert len(others) == 2
    assert all(row.unmeasured for row in others)
    monkeypatch.setattr(run, "AREAS", {"one": lambda _: iter([first, second])})
    lines: list[str] = []
    run_benchmarks(quick=True, write=lines.append)
    assert f"{line}\n" in lines
    assert not run_gate(quick=True, write=lines.append)
    assert f"{name}: never measured: LOST\n" in lines


def test_no_ratio_is_given_of_results_that_differ():
    with pytest.raises(AssertionError, match="predictions differ from those of a loop"):
        require_equal(np.ones(3), np.array([1.0, 1.0, 2.0]), "predictions", "a loop")
    with pytest.raises(AssertionError, match="costs differ"):
        estimation._same_cost(1.001, 1.0)
