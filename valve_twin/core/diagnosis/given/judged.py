# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a stored reference adds to what the features of a valve say of its own past."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.changes.finding import UNKNOWN, Diagnosis, Finding
from valve_twin.core.diagnosis.generic.features import SPAN
from valve_twin.core.diagnosis.generic.naming import in_travel
from valve_twin.core.diagnosis.given.against import JUDGED, LEAST, Held, hold
from valve_twin.core.diagnosis.given.reference import FEATURE_VERSION, PREFIX, Seen
from valve_twin.core.diagnosis.given.scatter import departs_by
from valve_twin.core.diagnosis.reference import NotYet

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.given.reference import FeatureReference
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.past.columns import Past, Rows
    from valve_twin.core.types import BoolArray, FloatArray, IntArray
    from valve_twin.core.valves.interface import ValveModel

_FIRST = JUDGED + 8
"""First cycles that must all be kept: those of any valve begin without features."""

_LEAST = 8
_LATELY = 8
_OF_PRODUCT = 3
"""Fewest cycles of a product among the first that were held against the reference."""

_ALIKE = 5
"""Cycles by which the beginnings of a fault may differ that both, past and reference, show."""


def unusable(reference: FeatureReference, model: ValveModel, period_s: float = 0.0) -> str:
    """Return why a reference says nothing of a valve, empty = it does.

    Parameters
    ----------
    reference : FeatureReference
        The reference.
    model : ValveModel
        The valve's model.
    period_s : float
        Sampling time of its position, 0 = not known [s].
    """
    if reference.model != model.name:
        return f"it is of model '{reference.model}', this valve of '{model.name}'"
    if reference.features != model.feature_set.names or reference.version != FEATURE_VERSION:
        return "it holds other features than this version of valve_twin: write it anew"
    if period_s and abs(reference.period_s / period_s - 1.0) > 1e-3:
        return (
            f"it was made at a sampling time of {reference.period_s:g} s, this valve has "
            f"{period_s:g} s"
        )
    return ""


def seen_of(shown: Rows, model: ValveModel, valve: str = "") -> Seen:
    """Return the features of a valve's cycles as they are followed.

    Parameters
    ----------
    shown : Rows
        Features, a cycle a row.
    model : ValveModel
        Its model.
    valve : str
        Its name.
    """
    duration = np.asarray((shown.end_ns - shown.start_ns) * 1e-9, np.float64)
    kind, spans = model.feature_set, shown.usable(SPAN)
    spans = spans[np.isfinite(spans)]
    one = kind.of_any_valve and not kind.by_model and len(spans) > 0  # else each has its own
    span = float(np.median(spans)) if one else float("nan")
    return Seen(valve, shown.cycle, duration, kind.vectors(shown.usable), span)


def first_model(shown: Rows, at: int = 0) -> dict[str, float]:
    """Return the parameters of the first model that features were taken against, by name.

    Parameters
    ----------
    shown : Rows
        Features, a cycle a row.
    at : int
        -1: of the last model instead.
    """
    found = {n: shown.value(n) for n in shown.parameters if n.startswith(PREFIX)}
    known = {n: v[np.isfinite(v)] for n, v in found.items()}
    return {n: float(v[at]) for n, v in known.items() if len(v)}


def without_first(past: Past, since: int) -> str:
    """Return why the first cycles since one cannot be judged, empty = they can.

    Where a mark came late, or only newer ones were kept, they are gone: later ones tell nothing.

    Parameters
    ----------
    past : Past
        What is known of the valve.
    since : int
        Number of the first cycle.
    """
    whole = past.features if past.whole is None else past.whole
    begun = np.sort(whole.key[whole.cycle >= since])[:_FIRST]
    if past.settled is None or not len(begun):
        return ""
    low, high = int(begun[0]), int(begun[-1])
    between = np.count_nonzero((whole.key >= low) & (whole.key <= high))
    late = past.features.cycle[past.features.key == low] > since
    before = low == 0 or bool(np.any(whole.key == low - 1))
    if between == high - low + 1 and (before or not late.any()):
        return ""
    return f"the first cycles since {'maintenance' if since else 'its start'} are kept no longer"


def judged(
    found: Diagnosis,
    shown: Rows,
    since: int,
    model: ValveModel,
    table: SignatureTable,
    reference: FeatureReference,
    valve: str,
) -> Diagnosis:
    """Return a diagnosis and what a stored reference says beside it.

    Parameters
    ----------
    found : Diagnosis
        By the valve's own past.
    shown : Rows
        Features, a cycle a row.
    since : int
        First cycle since its start, or its last maintenance: these are judged.
    model : ValveModel
        Its model.
    table : SignatureTable
        Signatures of its faults.
    reference : FeatureReference
        The reference.
    valve : str
        Its name.
    """
    if why := unusable(reference, model):
        return replace(found, against=f"{reference.text} says nothing: {why}")
    before = first_model(shown.take(np.flatnonzero(shown.cycle < since)), -1)
    shown = shown.take(np.flatnonzero(shown.cycle >= since))
    seen = seen_of(shown, model, valve)
    reference = reference.over(seen.span)
    rows, product = _off(seen, reference)
    known = product >= 0
    if not known.any():
        why = "no cycle is of a product that it holds" if len(rows) else "there is no cycle yet"
        return replace(found, against=f"{reference.text} says nothing: {why}")
    cycles = seen.cycles[known]
    of_any = model.feature_set.of_any_valve
    held = hold(
        cycles,
        rows[known],
        table,
        reference,
        least=LEAST if of_any else _LEAST,
        valve=valve,
    )
    own = first_model(shown)
    if of_any and held.finding is None and own != before:  # else it was learnt before the mark
        held = _by_model(held, own, reference, cycles, valve)
    if held.finding is not None:
        (finding,) = in_travel((held.finding,), shown.cycle, shown.usable(SPAN), model)
        new = not _is_known(finding, found)
        findings = (finding, *found.findings) if new else found.findings
        return replace(found, findings=findings, against=held.text)
    first = product[known][:JUDGED].tolist()
    lately = product[-_LATELY:]
    enough = all(first.count(p) >= _OF_PRODUCT for p in lately.tolist() if p >= 0)
    enough = enough and bool((product[-2:] >= 0).any())
    if held.settled and enough and isinstance(found.doubt, NotYet):
        found = replace(found, doubt="")
    return replace(found, against=held.text)


def _off(seen: Seen, reference: FeatureReference) -> tuple[FloatArray, IntArray]:
    """Return features less the centre of the product, (N, F), and its number, -1 = none."""
    rows = np.full(seen.vectors.shape, np.nan)
    product = np.full(len(rows), -1, dtype=np.int64)
    for number, one in enumerate(reference.products):
        own: BoolArray = one.makes(seen.duration_s) & (product < 0)
        rows[own], product[own] = seen.vectors[own] - one.centre, number
    return rows, product


def _is_known(finding: Finding, found: Diagnosis) -> bool:
    """Return whether the own past shows the same: a fault that begins alike, and lasts as long."""
    return any(
        abs(f.onset - finding.onset) <= _ALIKE
        and f.fault == finding.fault
        and (f.end < 0 or finding.end >= 0)
        for f in found.findings
    )


def _by_model(
    held: Held,
    own: dict[str, float],
    reference: FeatureReference,
    cycles: IntArray,
    valve: str,
) -> Held:
    """Hold a valve's own first model against those of the others: its features are none of it."""
    far, name = departs_by(reference, own, valve)
    if not name:
        return held
    onset = int(cycles[0])
    finding = Finding(UNKNOWN, (), "valve", float("nan"), far, onset, onset)
    text = f"judged against {reference.text}: its own first model departs from it in {name}"
    return Held(finding, True, text)
