# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Faults in a stored history, and what is said of them."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.diagnosis.changes.across import doubt_across, doubt_of_product
from valve_twin.core.diagnosis.changes.elsewhere import Elsewhere, followed_by
from valve_twin.core.diagnosis.changes.finding import CLOCK, NOTHING, Diagnosis, Finding
from valve_twin.core.diagnosis.config import detection_of
from valve_twin.core.diagnosis.detection import detect
from valve_twin.core.diagnosis.direct import bounds, freezing, noise
from valve_twin.core.diagnosis.direct.unreached import unreached
from valve_twin.core.diagnosis.features import NOISE, PERIOD, RETURNS
from valve_twin.core.diagnosis.generic.motion import motion_from
from valve_twin.core.diagnosis.generic.naming import named_by_motion
from valve_twin.core.diagnosis.generic.programs import with_programs
from valve_twin.core.diagnosis.generic.reference import has_reference
from valve_twin.core.diagnosis.generic.signatures import own_table, signatures_of
from valve_twin.core.diagnosis.given.judged import judged, without_first
from valve_twin.core.diagnosis.products import (
    MADE,
    behind_a_pause,
    clocks_of,
    last_left,
    products,
    with_returns,
    without_timed,
)
from valve_twin.core.diagnosis.reference import (
    NotYet,
    doubt_of,
    doubt_of_noise,
    doubt_of_step,
    measure,
    unnamed,
)
from valve_twin.core.diagnosis.refused import still, with_still
from valve_twin.core.diagnosis.table import BY_NAME
from valve_twin.core.diagnosis.watch.growing import present
from valve_twin.core.diagnosis.watch.memory import Known
from valve_twin.core.diagnosis.watch.outgrown import outgrown
from valve_twin.core.past.columns import Settled, past_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from valve_twin.core.diagnosis.config import DetectionConfig
    from valve_twin.core.diagnosis.given.reference import FeatureReference
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.past.columns import Past, Rows
    from valve_twin.core.types import BoolArray, Estimate, FloatArray, IntArray, Maintenance
    from valve_twin.core.valves.interface import ValveModel

_DIRECT = (NOISE, freezing.MISSED, freezing.DUE, bounds.OFF_SEAT, bounds.WEAK_SMALL)
_WEAK = "dead_band"

_NEAR = 5
"""Cycles behind one whose signals cannot be what is configured in which nothing is said of noise:
where clocks slip, a position is not at rest when the commands are (assumed)."""


def diagnose(
    history: Iterable[Estimate] | Past,
    maintenance: Sequence[Maintenance],
    known: Known | None = None,
    reference: FeatureReference | None = None,
    valve: str = "",
) -> Diagnosis:
    """Find the faults in a stored history; a pure function of it.

    Parameters
    ----------
    history : iterable of Estimate, or Past
        Estimates of all estimators, in any order; those named `features` count.
    maintenance : sequence of Maintenance
        All maintenance events of the valve.
    known : Known, optional
        What was found before: saves time and changes nothing.
    reference : FeatureReference, optional
        A stored one that the first cycles are held against, too.
    valve : str
        Name of the valve, which the reference may be of.

    Returns
    -------
    Diagnosis
        `NOTHING` where no features are stored or the model has no signatures, and no end is
        missed.
    """
    past = past_of(history)
    found = search(past, maintenance, known).diagnosis
    since = max((m.cycle for m in maintenance), default=0)
    if found is NOTHING:
        missed = unreached(past, since)
        return NOTHING if missed is None else replace(NOTHING, findings=(missed,))
    doubt = found.doubt or doubt_of_product(products_of(_once_a_cycle(past.features)))
    found = replace(found, findings=with_still(found.findings, still(past)), doubt=doubt)
    return _given(found, past, since, reference, valve) if reference else found


def followed(past: Past) -> tuple[ValveModel, SignatureTable, Rows] | None:
    """Return the model of features, its signatures, and the cycles; None = there are none."""
    return _followed(_once_a_cycle(past.features))


def followed_features(past: Past) -> Rows | None:
    """Return the features in which faults can be seen, a cycle a row; None = there are none."""
    known = followed(past)
    return None if known is None else known[2]


def _given(
    found: Diagnosis, past: Past, since: int, reference: FeatureReference, valve: str
) -> Diagnosis:
    """Return a diagnosis and what a stored reference says since the last maintenance."""
    known = _followed(_once_a_cycle(past.features if past.whole is None else past.whole))
    if known is None:
        return found
    model, table, shown = known
    if why := without_first(past, since):
        return replace(found, against=f"{reference.text} says nothing: {why}")
    return judged(found, shown, since, model, table, reference, valve)


class Searched(NamedTuple):
    """What features show.

    Attributes
    ----------
    diagnosis : Diagnosis
        The faults.
    stopped : bool
        Whether one that lasts ends the search.
    direct : tuple of Finding
        Those that were found without a signature.
    """

    diagnosis: Diagnosis
    stopped: bool = False
    direct: tuple[Finding, ...] = ()


def search(past: Past, maintenance: Sequence[Maintenance], known: Known | None = None) -> Searched:
    """Find the faults that features show.

    Parameters
    ----------
    past : Past
        Features; where not all are kept, what the others showed.
    maintenance : sequence of Maintenance
        All maintenance events of the valve.
    known : Known, optional
        What was found before: saves time and changes nothing.
    """
    known = known or Known()
    named = followed(past)
    if named is None:
        return Searched(NOTHING)
    model, table, shown = named
    any_valve = model.feature_set.of_any_valve
    cycles, vectors = shown.cycle, known.vectors(shown, model.feature_set)
    restarts = [m.cycle for m in maintenance]
    settled = past.settled or _NONE
    product = products_of(shown)
    found: list[Finding] = []
    ready, doubt, far, newest = False, "", 0.0, 0
    config = detection_of(model.feature_set)
    since = int(np.searchsorted(cycles, max(restarts, default=0)))
    anew = max(restarts, default=0) > settled.judged
    first = anew or past.settled is None
    lately = product[product >= 0][-MADE:].tolist()
    compared: list[tuple[IntArray, FloatArray, int]] = []
    before = [_until_maintained(f, cycles, restarts) for f in settled.findings]
    clock = clocks_of(shown, vectors, table, before, since, begins=first)
    vectors = without_timed(vectors, table) if clock else vectors
    searched = partial(detect, restarts=restarts, judged=settled.judged)
    for number, own in _rows_of(product):
        of = known.of(number)
        pauses, period_s = behind_a_pause(product, own), shown.usable(PERIOD)[own]
        steady = of.slips.taken_out(vectors[own], table, pauses, period_s)
        part = searched(cycles[own], steady, table, config, memory=of)
        if any_valve and part.findings:
            grown = outgrown(part, cycles[own], steady, table, config, searched).findings
            part = replace(
                part,
                findings=named_by_motion(
                    grown, shown, own, steady, model, table, restarts=restarts
                ),
            )
        then = [
            _marked(f, _elsewhere(f, cycles, vectors, product, number, model), cycles, restarts)
            for f in part.findings
        ]
        found += [f for f, _ in then]
        doubt = doubt or next((why for _, why in then if why), "")
        if number == product[-1]:
            ready, far, newest = part.ready, part.departs, part.newest
        if number in lately and first:
            kept = measure(cycles[own], part.findings, max(restarts, default=0), config)
            doubt = doubt or doubt_of(
                cycles[own][kept],
                steady[kept],
                table,
                config,
                others=None if any_valve else _others(vectors, product, number, config),
            )
        compared += (
            [(cycles[own], steady, last_left(cycles, product, number))]
            if first and not any_valve
            else []
        )
    if first and not any_valve and not doubt:
        doubt = doubt_of_noise(cycles[since:], shown.value(NOISE)[since:])
    doubt = doubt or doubt_across(
        cycles[since:], vectors[since:], product[since:], model.feature_set
    )
    stopped = settled.stopped and _holds(settled, restarts)
    if stopped:  # until maintenance
        next_ = min((c for c in restarts if c > settled.judged), default=np.inf)
        found = [f for f in found if f.onset >= next_]
    stopped = any(f.end < 0 for f in found) or (stopped and not anew)
    found.sort(key=lambda f: (f.alarm, f.onset))
    found += [clock] if clock and clock not in before else []
    direct: list[Finding] = []
    if not any_valve:
        values = np.column_stack([shown.value(n) for n in _DIRECT])
        asked = [f in settled.direct for f in settled.findings]
        before = [
            _until_over(f, cycles, values, settled.judged) if d else f
            for f, d in zip(before, asked, strict=True)
        ]
        direct = [f for f, d in zip(before, asked, strict=True) if d]
        new = [
            f
            for f in _direct(cycles, values, product, restarts, known)
            if f.alarm > settled.judged
        ]
        found, direct = found + new, direct + new
    found = [f for f in found if not _is_slip(f, past.apart)]
    every = (*before, *found)
    doubt = _with_steps(doubt if first else settled.doubt, compared, every, restarts, table)
    diagnosis = Diagnosis(
        every,
        settled.cycles + len(cycles),
        ready,
        doubt,
        far,
        newest,
        odd="" if any_valve else bounds.odd(shown),
    )
    return Searched(diagnosis, stopped, tuple(f for f in direct if f in diagnosis.findings))


def _followed(shown: Rows) -> tuple[ValveModel, SignatureTable, Rows] | None:
    """Return the model of features, its signatures, and the cycles that count; None = none do."""
    model = _model(shown.models[0]) if len(shown) else None
    table = signatures_of(model) if model else None
    if model is None or table is None:
        return None
    if model.feature_set.of_any_valve:
        shown = shown.take(np.flatnonzero(has_reference(shown)))
        if not len(shown):
            return None
        if model.signatures() is None and not model.feature_set.by_model:
            table = _table_of(model, shown) or table
    return model, table, shown


def _rows_of(product: IntArray) -> Iterator[tuple[int, BoolArray | slice]]:
    """Yield the number of each product that is known, and which of (N,) cycles make it."""
    numbers = present(product)
    for number in numbers:
        alone = len(numbers) == 1 and product.min() >= 0
        yield number, slice(None) if alone else np.asarray(product == number)


def _table_of(model: ValveModel, shown: Rows) -> SignatureTable | None:
    """Return the signatures from the first motion that features hold; None = they hold none."""
    held = (shown.motions[k] for k in shown.key.tolist() if k in shown.motions)
    first = next(held, None)
    own = own_table(model.name, motion_from(first)) if first else None
    return own if own is not None and own.faults else None


_NONE = Settled((), 0, -1)


def _others(
    vectors: FloatArray, product: IntArray, number: int, config: DetectionConfig
) -> list[FloatArray]:
    """Return the features of the newest cycles of all other products that are known."""
    newest = config.learn
    return [vectors[product == p][-newest:] for p in sorted(set(product.tolist()) - {-1, number})]


def _elsewhere(
    finding: Finding,
    cycles: IntArray,
    vectors: FloatArray,
    product: IntArray,
    number: int,
    model: ValveModel,
) -> tuple[Finding, str]:
    """Return a fault of one product by what others made since say of it, and what is in doubt."""
    if finding.end >= 0:
        return finding, ""
    own, known = product == number, product >= 0
    then = followed_by(cycles, vectors, own, finding.onset, known, model.feature_set)
    if then.state is Elsewhere.THERE:
        return finding, ""
    doubt = (
        f"no reference: {_text(finding)} since cycle {finding.onset} was not seen to end before "
        f"its product was last made in cycle {then.last}, and nothing tells whether it is still "
        "there: make that product again, or mark maintenance"
    )
    seen = then.state is Elsewhere.OVER
    return replace(finding, end=then.seen, end_seen=seen), "" if seen else doubt


def _marked(
    finding: Finding, then: tuple[Finding, str], cycles: IntArray, restarts: Sequence[int]
) -> tuple[Finding, str]:
    """Return what others say of a fault, which is over with maintenance and in doubt no more."""
    mark = _until_maintained(finding, cycles, restarts).end
    if finding.end >= 0 or mark < 0:
        return then
    over = 0 <= then[0].end < mark
    return then[0] if over else replace(finding, end=mark), ""


def _text(finding: Finding) -> str:
    """Return the name of a fault in words."""
    kind = BY_NAME.get(finding.fault)
    return kind.text if kind else "a sudden change that is like no known fault"


def _with_steps(
    doubt: str,
    products: Sequence[tuple[IntArray, FloatArray, int]],
    findings: Sequence[Finding],
    restarts: Sequence[int],
    table: SignatureTable,
) -> str:
    """Return a doubt, or that the cycles of a product hold a step that no fault explains.

    Of the `products` each is told where it was left for others: a step in its last cycles may
    have come to stay, and the others know only what came after it.
    """
    if doubt and not isinstance(doubt, NotYet):  # which a stored reference may take back
        return doubt
    since = max(restarts, default=0)
    for cycles, vectors, left in products:
        rows = unnamed(cycles, findings, since)
        if why := doubt_of_step(cycles, vectors, table, rows=rows, left=left):
            return why
    return doubt


def _until_maintained(finding: Finding, cycles: IntArray, restarts: Sequence[int]) -> Finding:
    """Return a finding of old, over where a cycle came after maintenance."""
    after = [c for c in restarts if c > finding.onset and len(cycles) and cycles[-1] >= c]
    if finding.end >= 0 or not after:
        return finding
    return replace(finding, end=int(cycles[np.searchsorted(cycles, min(after))]))


def _holds(settled: Settled, restarts: Sequence[int]) -> bool:
    """Return whether a fault of old is there that no mark, made later perhaps, has ended."""
    marks = [c for c in restarts if c <= settled.judged]
    by_signature = (f for f in settled.findings if f not in settled.direct and f.fault != CLOCK)
    return any(f.end < 0 and not any(c > f.onset for c in marks) for f in by_signature)


def products_of(shown: Rows) -> IntArray:
    """Return which product each of some cycles makes, -1 = not known."""
    by_duration = products(np.asarray((shown.end_ns - shown.start_ns) * 1e-9, np.float64))
    told = with_returns(by_duration, shown.usable(RETURNS), shown.usable(PERIOD))
    return with_programs(told, shown)


def _is_slip(finding: Finding, apart: Sequence[int]) -> bool:
    """Return whether a noise was found about cycles whose signals do not belong together."""
    if finding.fault != "sensor_noise":
        return False
    over = finding.alarm + 2 * _NEAR  # what is told by then stays told
    over = min(over, finding.end) if finding.end >= 0 else over
    return any(finding.onset - _NEAR <= cycle <= over for cycle in apart)


def _once_a_cycle(shown: Rows) -> Rows:
    """Return the rows by rising cycle, of each cycle the last that came."""
    if bool(np.all(shown.cycle[1:] > shown.cycle[:-1])):
        return shown
    order = np.argsort(shown.cycle, kind="stable")
    last = np.append(np.diff(shown.cycle[order]) > 0, True)
    return shown.take(order[last])


def _until_over(finding: Finding, cycles: IntArray, values: FloatArray, judged: int) -> Finding:
    """Return what was found of old without a signature, over where it is seen no more."""
    if finding.end >= 0:
        return finding
    if finding.fault == "sensor_noise":
        end = noise.over(cycles, values[:, 0], finding, judged)
    elif finding.fault == "sensor_freeze":
        end = freezing.over(cycles, values[:, 1], values[:, 2], finding)
    else:
        end = bounds.over(cycles, values[:, 4 if finding.fault == _WEAK else 3], finding)
    return replace(finding, end=end)


def _direct(
    cycles: IntArray,
    values: FloatArray,
    product: IntArray,
    restarts: Sequence[int],
    known: Known,
) -> list[Finding]:
    """Return what shows without a signature; maintenance ends it and begins anew."""
    found: list[Finding] = []
    edges = [0, *sorted({int(np.searchsorted(cycles, c)) for c in restarts}), len(cycles)]
    for first, last in pairwise(edges):
        part, own = cycles[first:last], values[first:last]
        over = int(cycles[last]) if last < len(cycles) else -1
        new = [
            *bounds.beyond(part, own[:, 4], _WEAK),
            *bounds.beyond(part, own[:, 3], "sensor_offset"),
            *known.noise(first).found(part, own[:, 0], product[first:last]),
            *freezing.freezing(part, own[:, 1], own[:, 2]),
        ]
        found += [replace(f, end=over) if f.end < 0 else f for f in new]
    return sorted(found, key=lambda f: (f.alarm, f.onset))


def _model(name: str) -> ValveModel | None:
    """Return a model by its name, None where it is not installed."""
    from valve_twin.core.valves.registry import get_model  # which knows every model

    try:
        return get_model(name)
    except ValueError:
        return None
