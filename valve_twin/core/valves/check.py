# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Check that a valve keeps what `ValveModel` promises: for the author of a new one, and for ours.

Every check runs on records of the valve's own simulation, or on a made-up one where it has none,
and answers with one `Finding`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, isfinite
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.simulation import simulate_cycles, to_frames
from valve_twin.core.types import Cycle, EstimateStatus, Frames, Restart, Validity
from valve_twin.core.valves.registry import complete_options, get_model
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from valve_twin.core.types import ByteArray, Estimate, FloatArray
    from valve_twin.core.valves.interface import Options, ValveModel

SEEDS = 20
"""Simulated records of the check of intervals."""

COVERED = 0.9
"""Least share of the 95 % intervals that hold the true value."""

MOST_CYCLES = 12
"""Cycles of a record: an interval from the scatter between cycles needs ten before it."""

SLOWEST = 10_000.0
"""Most time of a predicted sample, in units of the reference loop's [1]."""

_SAMPLES = 1400  # of a made-up record
_PERIOD_S = 0.05  # of a made-up record [s]
_CUT = 97  # samples between the blocks of one comparison
_REPEATS = 5  # of a measured time; the shortest counts


@dataclass(frozen=True, slots=True)
class Finding:
    """One check: its name, whether it was passed (None = not decidable), and what was seen."""

    check: str
    passed: bool | None
    text: str


@dataclass(frozen=True, slots=True)
class _Subject:
    """What is checked: the model, its options, one record and coefficients of its prediction."""

    model: ValveModel
    options: Options
    cycle: Cycle
    coefficients: FloatArray


def check_valve(name: str, clock: Callable[[], float], *, seeds: int = SEEDS) -> Iterator[Finding]:
    """Yield the findings of every check of a valve.

    Parameters
    ----------
    name : str
        Name that the valve is registered under.
    clock : callable
        Returns a steady time [s].
    seeds : int
        Simulated records of the check of intervals.

    Raises
    ------
    ValueError
        If there is no such valve, or if it lacks a member of the protocol.
    """
    model = get_model(name)
    yield _named(model, name)
    yield _described(model)
    subject = _subject(model)
    yield _blocks(subject)
    yield from _codes(subject)
    yield _not_a_number(subject)
    yield _causal(subject)
    yield _driven(subject)
    yield _refuses(subject)
    yield _recovers(subject, seeds)
    yield _fast(subject, clock)


def _named(model: ValveModel, name: str) -> Finding:
    if model.name != name:
        return Finding("name", passed=False, text=f"registered as '{name}', named '{model.name}'")
    return Finding("name", passed=True, text=f"{len(model.parameters)} parameters")


def _described(model: ValveModel) -> Finding:
    """Check that units, bounds and descriptions are there."""
    lacks = []
    for p in model.parameters:
        if not p.unit or not p.description:
            lacks.append(f"{p.name} has no unit or no description")
        if not p.lower < p.upper:
            lacks.append(f"{p.name}: bounds {p.lower} and {p.upper}")
        if p.trend and not (isfinite(p.lower) or isfinite(p.upper)):
            lacks.append(f"{p.name} has no bound")
    if not any(p.trend for p in model.parameters):
        lacks.append("no parameter is followed (trend=True)")
    done = "every parameter has unit, description and bounds"
    return Finding("units and bounds", passed=not lacks, text="; ".join(lacks) or done)


def _subject(model: ValveModel) -> _Subject:
    """Return a record of the valve, the last of three cycles, and the model in force by then."""
    options = complete_options(model, {})
    simulation = model.simulation()
    values: dict[str, float] = {}
    lag = 1
    if simulation is None:
        cycle = Cycle(1, _PERIOD_S, _wave(len(model.inputs)))
        cycles = [cycle]
    else:
        blocks = simulate_cycles(simulation, 3, seed=0)
        cycles = [Cycle(i + 1, simulation.period_s, to_frames(b)) for i, b in enumerate(blocks)]
    memory = Memory.empty()
    for cycle in cycles:
        _, memory = estimate_cycle(model, options, cycle, memory)
    known = memory.of(model.trend_estimator)
    if known:
        values, lag = dict(model.merge(known)), known[-1].lag
    found = model.coefficients(values, lag, cycle.period_s, options)
    if not np.isfinite(found).all():
        values = {p.name: values.get(p.name, 0.1) for p in model.parameters}
        found = model.coefficients(values, lag, cycle.period_s, options)
    return _Subject(model, options, cycle, found)


def _wave(inputs: int) -> Frames:
    """Return a made-up record: the output follows a wave of every input, two samples later."""
    n = _SAMPLES
    wave = 0.5 + 0.4 * np.sin(0.1 * np.arange(n + 2))
    return Frames(
        stamp_ns=round(1e9 * _PERIOD_S) * np.arange(1, n + 1),
        position=wave[:n].copy(),
        inputs=np.tile(wave[2:, None], (1, inputs)),
        counter=np.full(n, np.nan),
        reference=np.full(n, np.nan),
        valid=np.ones(n, dtype=np.bool_),
    )


@dataclass(frozen=True, slots=True)
class _Run:
    """What a prediction wrote: (N,) each, and the state behind it."""

    predicted: FloatArray
    simulated: FloatArray
    validity: ByteArray
    state: FloatArray

    def same(self, other: _Run, first: int = 0) -> bool:
        """Tell whether the bits are equal from a sample on."""
        return all(
            getattr(self, name)[first:].tobytes() == getattr(other, name)[first:].tobytes()
            for name in ("predicted", "simulated", "validity")
        )


def _run(
    subject: _Subject,
    restart: ByteArray,
    *,
    cuts: Sequence[int] = (),
    position: FloatArray | None = None,
    inputs: FloatArray | None = None,
) -> _Run:
    frames = subject.cycle.frames
    measured = frames.position if position is None else position
    n = len(restart)
    given = frames.inputs if inputs is None else inputs
    commands = np.nan_to_num(given, nan=0.0, posinf=0.0, neginf=0.0)
    run = _Run(
        np.full(n, np.nan),
        np.full(n, np.nan),
        np.zeros(n, dtype=np.uint8),
        subject.model.initial_state(),
    )
    for first, last in zip((0, *cuts), (*cuts, n), strict=True):
        part = slice(first, last)
        subject.model.predict(
            run.state,
            subject.coefficients,
            np.ascontiguousarray(measured[part]),
            np.ascontiguousarray(commands[part]),
            restart[part],
            run.predicted[part],
            run.simulated[part],
            run.validity[part],
        )
    return run


def _restart(subject: _Subject, codes: Mapping[int, Restart]) -> ByteArray:
    restart = np.full(len(subject.cycle.frames), Restart.GO_ON, dtype=np.uint8)
    restart[0] = Restart.GAP
    for where, code in codes.items():
        restart[where] = code
    return restart


def _marks(subject: _Subject) -> tuple[int, int, int]:
    """Return three places inside the record, a third of it apart."""
    third = len(subject.cycle.frames) // 4
    return third, 2 * third, 3 * third


def _blocks(subject: _Subject) -> Finding:
    """Check that the bits do not depend on how the samples come."""
    a, b, c = _marks(subject)
    codes = {a: Restart.NEW_CYCLE, b: Restart.GAP, b + 1: Restart.BAD, c: Restart.BAD}
    restart, n = _restart(subject, codes), len(subject.cycle.frames)
    whole = _run(subject, restart)
    for cuts in (range(1, n), range(_CUT, n, _CUT), (a, b, c)):
        parts = _run(subject, restart, cuts=list(cuts))
        if not whole.same(parts) or whole.state.tobytes() != parts.state.tobytes():
            text = f"{len(cuts) + 1} blocks give other bits than one of {n} samples"
            return Finding("blocks", passed=False, text=text)
    return Finding("blocks", passed=True, text=f"same bits for 1 to {n} blocks of {n} samples")


def _codes(subject: _Subject) -> Iterator[Finding]:
    """Check what the restart codes do."""
    a, b, c = _marks(subject)
    fresh = replace(subject, cycle=replace(subject.cycle, frames=subject.cycle.frames[b:]))
    with_gap = _run(subject, _restart(subject, {b: Restart.GAP}))
    alone = _run(fresh, _restart(fresh, {}))
    tail = _Run(
        with_gap.predicted[b:], with_gap.simulated[b:], with_gap.validity[b:], with_gap.state
    )
    later = _run(subject, _restart(subject, {a: Restart.GAP, b: Restart.GAP}))
    forgets = tail.same(alone) or later.same(with_gap, b)
    text = "a gap forgets what was before" if forgets else "samples before a gap act behind it"
    yield Finding("restart GAP", passed=forgets, text=text)
    once = _run(subject, _restart(subject, {c: Restart.NEW_CYCLE}))
    twice = _run(subject, _restart(subject, {b: Restart.NEW_CYCLE, c: Restart.NEW_CYCLE}))
    anew = once.same(twice, c)
    text = "the free run starts anew" if anew else "the free run before a cycle acts inside it"
    yield Finding("restart NEW_CYCLE", passed=anew, text=text)
    bad = _run(subject, _restart(subject, {b: Restart.BAD}))
    marked = bad.validity[b] == Validity.BAD_INPUT and not np.any(
        np.delete(bad.validity, b) == Validity.BAD_INPUT
    )
    text = "a bad sample is marked, no other" if marked else "BAD_INPUT is not where BAD is"
    yield Finding("restart BAD", passed=bool(marked), text=text)


def _not_a_number(subject: _Subject) -> Finding:
    """Check that what is not a number at a bad sample stays there."""
    a, b, _ = _marks(subject)
    where = [0, a, *range(b, b + 5)]
    position = subject.cycle.frames.position.copy()
    position[where] = np.nan
    codes = dict.fromkeys(where, Restart.BAD)
    run = _run(subject, _restart(subject, codes), position=position)
    valid = run.validity == Validity.VALID
    poisoned = valid & ~np.isfinite(run.predicted)
    if poisoned.any():
        text = f"{np.count_nonzero(poisoned)} valid predictions are not finite"
        return Finding("not a number", passed=False, text=text)
    if not valid[b + 5 :].any():
        text = "no prediction is valid behind a measurement that is not a number"
        return Finding("not a number", passed=False, text=text)
    return Finding("not a number", passed=True, text="it does not spread")


def _causal(subject: _Subject) -> Finding:
    """Check that a prediction does not use the sample that it predicts."""
    _, b, _ = _marks(subject)
    restart = _restart(subject, {})
    position = subject.cycle.frames.position.copy()
    before = _run(subject, restart, position=position)
    position[b] += 0.1
    after = _run(subject, restart, position=position)
    same = before.predicted[: b + 1].tobytes() == after.predicted[: b + 1].tobytes()
    text = "only what was measured before" if same else "predicted[n] depends on position[n]"
    return Finding("one-step prediction", passed=same, text=text)


def _driven(subject: _Subject) -> Finding:
    """Check that the free run sees the inputs that `driven_by` names, and no other."""
    model, restart = subject.model, _restart(subject, {})
    others = [i for i, name in enumerate(model.inputs) if name not in model.driven_by]
    if not model.driven_by or not others:
        return Finding("free run", passed=True, text="driven by all inputs")
    changed = subject.cycle.frames.inputs.copy()
    changed[:, others] = np.roll(changed[:, others], len(changed) // 3, axis=0) + 0.1
    free = [_run(subject, restart, inputs=u).simulated for u in (None, changed)]
    same = free[0].tobytes() == free[1].tobytes()
    text = f"driven by {', '.join(model.driven_by)}" + ("" if same else " and by another input")
    return Finding("free run", passed=same, text=text)


def _bad_cycles(subject: _Subject) -> dict[str, Cycle]:
    """Return cycles that say nothing."""
    cycle, n = subject.cycle, len(subject.cycle.frames)
    frames = cycle.frames
    rest = float(frames.position[0])
    stamps = frames.stamp_ns[0] + 10**9 * np.arange(1, n + 1) * max(1, round(100 * cycle.period_s))
    changed = {
        "of one sample": frames[:1],
        "of two samples": frames[:2],
        "without a valid sample": replace(frames, valid=np.zeros(n, dtype=np.bool_)),
        "without a number": replace(frames, position=np.full(n, np.nan)),
        "of infinite positions": replace(frames, position=np.full(n, np.inf)),
        "of gaps alone": replace(frames, stamp_ns=stamps.astype(np.int64)),
    }
    if subject.model.inputs:  # without a command, rest may be what is measured
        still = np.tile(frames.inputs[:1], (n, 1))
        changed["at rest"] = replace(frames, position=np.full(n, rest), inputs=still)
    made = {what: replace(cycle, frames=part) for what, part in changed.items()}
    short = Refusal(RefusalCode.CYCLE_TOO_SHORT, "too short")
    made["that was not accepted"] = replace(cycle, accepted=False, reason=short)
    return made


def _refuses(subject: _Subject) -> Finding:
    """Check that bad cycles are refused with a reason and without values."""
    wrong = []
    for what, cycle in _bad_cycles(subject).items():
        found, _ = estimate_cycle(subject.model, subject.options, cycle, Memory.empty())
        wrong += [f"a cycle {what} is {fault}" for e in found if (fault := _not_refused(e))]
    cycles = f"{len(_bad_cycles(subject))} bad cycles are refused with a reason"
    return Finding("refusals", passed=not wrong, text="; ".join(wrong) or cycles)


def _not_refused(estimate: Estimate) -> str:
    if estimate.status is not EstimateStatus.REFUSED:
        return f"{estimate.status.name.lower()} by {estimate.estimator}"
    if not estimate.reason:
        return f"refused by {estimate.estimator} without a reason"
    if estimate.reason_code == RefusalCode.FAILED:
        return f"refused: {estimate.reason}"
    if estimate.reason_code == RefusalCode.OTHER:
        return f"refused by {estimate.estimator} without a code: make the reason a `Refusal`"
    known = [p.name for p in estimate.parameters if isfinite(p.value)]
    return f"refused by {estimate.estimator} with values of {', '.join(known)}" if known else ""


def _recovers(subject: _Subject, seeds: int) -> Finding:
    """Check that the 95 % intervals hold the parameters of the valve's own simulation."""
    check, model = "recovery", subject.model
    simulation = model.simulation()
    if simulation is None:
        return Finding(check, passed=None, text="the valve has no simulation")
    truth = model.truth(simulation, simulation.first_cycle)
    if not truth:
        return Finding(check, passed=None, text="the simulation has no number that is followed")
    inside = dict.fromkeys(truth, 0)
    estimated = dict.fromkeys(truth, 0)
    for seed in range(seeds):
        memory = Memory.empty()
        for i, block in enumerate(simulate_cycles(simulation, MOST_CYCLES, seed)):
            cycle = Cycle(i + 1, simulation.period_s, to_frames(block))
            found, memory = estimate_cycle(model, subject.options, cycle, memory)
            limits = _limits(found, truth, model.trend_estimator)
            if len(limits) == len(truth):
                break
        for name, (low, high) in limits.items():
            estimated[name] += 1
            inside[name] += int(low <= truth[name] <= high)
    return _covered(check, inside, estimated, seeds)


def _limits(
    found: Sequence[Estimate], truth: Mapping[str, float], estimator: str
) -> dict[str, tuple[float, float]]:
    return {
        p.name: (p.lower_95, p.upper_95)
        for e in found
        if e.estimator == estimator
        for p in e.parameters
        if p.name in truth and isfinite(p.lower_95 + p.upper_95)
    }


def _covered(
    check: str, inside: Mapping[str, int], estimated: Mapping[str, int], seeds: int
) -> Finding:
    rows = ", ".join(f"{name} {inside[name]} of {estimated[name]}" for name in inside)
    missing = [name for name, count in estimated.items() if count < COVERED * seeds]
    share = sum(inside.values()) / max(sum(estimated.values()), 1)
    text = f"{100.0 * share:.0f} % of the 95 % intervals hold the true value ({rows})"
    if missing:
        text += f"; without an interval in most records: {', '.join(missing)}"
    return Finding(check, passed=bool(share >= COVERED) and not missing, text=text)


@njit(cache=True)
def _reference(position: FloatArray, out: FloatArray) -> None:
    x = 0.0
    for n in range(len(position)):
        x += (position[n] - x) * (1.0 - exp(-0.1 - x * x))
        out[n] = x


def _fast(subject: _Subject, clock: Callable[[], float]) -> Finding:
    """Check the time of a predicted sample against that of a loop with one exponential."""
    restart = _restart(subject, {})
    position = np.tile(subject.cycle.frames.position, 1 + 10_000 // len(restart))
    out = np.empty(len(position))
    _reference(position, out)
    reference = _shortest(lambda: _reference(position, out), clock) / len(position)
    _run(subject, restart)
    ours = _shortest(lambda: _run(subject, restart), clock) / len(restart)
    ratio = ours / reference
    text = f"a predicted sample takes {1e6 * ours:.2g} us, {ratio:.0f} times the reference loop"
    return Finding("speed", passed=ratio <= SLOWEST, text=text)


def _shortest(work: Callable[[], object], clock: Callable[[], float]) -> float:
    times = []
    for _ in range(_REPEATS):
        start = clock()
        work()
        times.append(clock() - start)
    return min(times)
