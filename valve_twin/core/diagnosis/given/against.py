# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Hold the first cycles of a valve against a stored reference.

A sound valve lies off the centre of its product by what valves differ by (B), the same in all its
cycles, and scatters by W from cycle to cycle. A fault adds a multiple of its signature from some
cycle on. Where cycles came before it, they tell most of B: what is left of the others is

    y2 - G y1,  G = B (B + W / k)^-1,  covariance  C = B + W / m - G B

of k cycles before and m since; with none before G is 0. So a fault from the first cycle on is
judged by how valves differ, one that begins later nearly by the scatter of a cycle alone: there B
counts wide, since it may be no more than a guess and the cycles before tell more.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.diagnosis.changes.finding import UNKNOWN, Finding
from valve_twin.core.diagnosis.given.scatter import BESIDE, MOST, SHOWN, scatter_of, widened
from valve_twin.core.diagnosis.table import BY_NAME, FACTORS, partner, whitener

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.given.reference import FeatureReference
    from valve_twin.core.diagnosis.given.scatter import Scatter
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.types import FloatArray, IntArray

LEAST = 5
"""Fewest cycles from which on nothing found means that the valve is like the reference."""

JUDGED = 16
"""First cycles that are held against the reference; later ones against the valve's own."""

_BEGINS = 8
"""Cycles before a fault at most; one that begins later is for the own past."""

_WITHHELD = 3.5
"""Standard deviations that withhold the "ok"; set on the same as `SHOWN` [1]."""

_CONFIRM = 3
"""Fewest cycles that must show a change."""

_FIRST = 5
"""The same of one that was there from the first cycle on: so few tell little of a level."""

_EACH, _SUDDEN = 0.4, 0.5
"""Share of the mean change that a cycle must show, and that the cycles beside its onset must
differ by: what wanders is no sudden change [1]."""

_HEAL, _BACK = 5, 0.4
"""Cycles in a row that show less than this share of a change where it is over [1]."""

_UNLIKE, _LIKE = 0.3, 0.4
"""Share of a change by which a valve may differ from the signature, and which the best one must
explain, as against the own past [1]."""

_RIVAL, _PAIR_RIVAL = 6.0, 2.0
"""Difference of twice the log likelihood below which faults are not told apart, as there [1]."""

_WIDE = (
    "unchanged by the scatter of a cycle; its valves differ too much to tell a large fault that "
    "was there from the first cycle on"
)


class Held(NamedTuple):
    """What a stored reference says of a valve.

    Attributes
    ----------
    finding : Finding or None
        A fault, or a departure like no fault (`UNKNOWN`).
    settled : bool
        Whether a fault would have shown.
    text : str
        The sentence of the evidence; empty where there is no reference.
    """

    finding: Finding | None = None
    settled: bool = False
    text: str = ""


def hold(
    cycles: IntArray,
    rows: FloatArray,
    table: SignatureTable,
    reference: FeatureReference,
    *,
    least: int = LEAST,
    valve: str = "",
) -> Held:
    """Hold the cycles of a valve since its start, or maintenance, against a reference.

    Parameters
    ----------
    cycles : (N,) int64 array
        Their numbers, rising.
    rows : (N, F) array
        Features less the centre of the cycle's product [as followed]; NaN where not shown.
    table : SignatureTable
        Signatures of the valve's faults.
    reference : FeatureReference
        The reference.
    least : int
        Fewest cycles that show that the valve is like it.
    valve : str
        Its name.
    """
    scatter = scatter_of(reference, table, valve)
    keep = np.flatnonzero(scatter.shown & np.isfinite(rows[:JUDGED]).any(axis=0))
    if not len(keep) or not len(rows):
        return Held(text=f"{reference.text} says nothing: no feature is shown by both")
    part = _Part(table, keep)
    y = _filled(rows[:, keep])
    shown, first = 0.0, None
    for count in range(_CONFIRM, min(len(y), JUDGED) + 1):
        look = _Look(y[:count], widened(scatter, keep, y[:count]), part)
        first, shown = look.departs()
        if first is not None:
            break
    if first is not None:
        return _departed(cycles, y, count, first, look, reference)
    begun = f"judged against {reference.text}"
    if len(y) < least:
        return Held(None, False, f"{begun}: {len(y)} of {least} cycles that it takes")
    if shown > _WITHHELD:
        return Held(None, False, f"{begun}: not clearly within it ({shown:.1f} deviations)")
    if not look.would_show(FACTORS[1]):
        return Held(None, False, f"{begun}: its cycles scatter too much to tell a medium fault")
    if not look.would_show(FACTORS[2], first=True):
        return Held(None, True, f"{begun}: {_WIDE}")
    return Held(None, True, f"{begun}: within it")


class _Part(NamedTuple):
    """Signatures in the features that are shown."""

    table: SignatureTable
    keep: IntArray

    @property
    def changes(self) -> FloatArray:
        return self.table.changes()[:, self.keep]


class _Change(NamedTuple):
    """A change: its first row, the signature it is most along (-1 = none), how far it lies off."""

    row: int
    signature: int
    far: float


def _filled(rows: FloatArray) -> FloatArray:
    """Return the features with the last known value where there is none, 0 before the first."""
    known = np.isfinite(rows)
    index = np.maximum.accumulate(np.where(known, np.arange(len(rows))[:, None], -1), axis=0)
    found = np.take_along_axis(rows, np.maximum(index, 0), axis=0)
    return np.where(index >= 0, found, 0.0)


class _Look:
    """The first cycles of a valve against a reference."""

    def __init__(self, y: FloatArray, scatter: Scatter, part: _Part) -> None:
        self.y, self.scatter, self.part = y, scatter, part

    def compared(self, before: int, since: int) -> tuple[FloatArray, FloatArray]:
        """Return G (F, F) and the whitener of y2 - G y1, (F, F)."""
        w, b, s = self.scatter.within, self.scatter.between, self.scatter.strays
        if not before:
            return np.zeros_like(b), whitener(self.scatter.first + s + w / min(since, MOST[1]))
        covariance = b + s + w / min(since, MOST[1])
        own = b + s + w / min(before, MOST[0])
        share: FloatArray = np.asarray(np.linalg.solve(own, b).T, dtype=np.float64)
        return share, whitener(covariance - share @ b)

    def departs(self) -> tuple[_Change | None, float]:
        """Return the change that is a fault, None = none, and how far the largest one goes."""
        count, best, largest = len(self.y), None, 0.0
        for row in range(0 if count >= _FIRST else 1, min(count - _CONFIRM, _BEGINS) + 1):
            off, white = self.off(row, count)
            z = white @ off
            changes = self.part.changes @ white.T
            length = np.maximum(np.linalg.norm(changes, axis=1), 1e-12)
            along = changes @ z / length
            k = int(np.argmax(along))
            far = float(along[k])
            if row and not self._sudden(row, white, changes[k] / length[k]):
                continue
            if 0 < row < BESIDE and not self._leaves(row):
                continue  # single first cycles may be odd
            if not self._confirmed(row, white, changes[k] / length[k]):
                continue
            largest = max(largest, far)
            if far > SHOWN and (best is None or far > best.far):
                best = _Change(row, k, far)
        return best, largest

    def off(self, row: int, count: int) -> tuple[FloatArray, FloatArray]:
        """Return y2 - G y1 of the cycles since a row, (F,), and its whitener."""
        share, white = self.compared(row, count - row)
        since = self.y[row:count].mean(axis=0)
        before = self.before(row)
        return since - share @ before, white

    def before(self, row: int) -> FloatArray:
        """Return the middle of the cycles before a row, (F,): one that is odd moves it little."""
        return np.median(self.y[:row], axis=0) if row else np.zeros(self.y.shape[1])

    def _leaves(self, row: int) -> bool:
        """Return whether the cycles before a row are nearer to the reference than those since."""
        _, white = self.compared(0, row)
        before, since = (white @ y.mean(axis=0) for y in (self.y[:row], self.y[row:]))
        return float(before @ before) < float(since @ since)

    def _sudden(self, row: int, white: FloatArray, ray: FloatArray) -> bool:
        """Return whether the cycles beside a row differ by most of what those further off do."""
        y = self.y @ white.T @ ray
        whole = float(y[row:].mean() - y[:row].mean())
        beside = float(y[row : row + BESIDE].mean() - y[max(row - BESIDE, 0) : row].mean())
        return beside > _SUDDEN * whole > 0.0

    def _confirmed(self, row: int, white: FloatArray, ray: FloatArray) -> bool:
        """Return whether more than half of the cycles since a row show the change."""
        share, _ = self.compared(row, len(self.y) - row)
        before = share @ self.before(row)
        each = (self.y[row:] - before) @ white.T @ ray
        shown = np.count_nonzero(each > _EACH * each.mean())
        return bool(each.mean() > 0.0 and shown >= max(_CONFIRM, 0.6 * len(each)))

    def would_show(self, factor: float, *, first: bool = False) -> bool:
        """Return whether faults of at least half of the kinds would show in these cycles.

        Parameters
        ----------
        factor : float
            Their size, in the small one [1].
        first : bool
            Whether they were there from the first cycle on, or came amid the cycles.
        """
        half = max(BESIDE, len(self.y) // 2)
        _, white = self.compared(0 if first else half, half)
        length = np.linalg.norm(self.part.changes @ white.T, axis=1)
        table = self.part.table
        each = []
        for fault in table.faults:
            own = [k for k, s in enumerate(table.signatures) if s.fault == fault]
            least = min(abs(table.signatures[k].severity) for k in own)
            off = [abs(abs(table.signatures[k].severity) / least - factor) for k in own]
            each.append(length[own[int(np.argmin(off))]])
        return float(np.median(each)) > _WITHHELD


def _departed(
    cycles: IntArray,
    y: FloatArray,
    count: int,
    change: _Change,
    look: _Look,
    reference: FeatureReference,
) -> Held:
    """Name what a valve departs from a reference by."""
    likelihood, severity, like = _named(look, change)
    onset, alarm = int(cycles[change.row]), int(cycles[count - 1])
    end = _over(y, cycles, count, change, look)
    text = f"judged against {reference.text}: departs from it since cycle {onset}"
    names = sorted(likelihood, key=lambda n: -likelihood[n])
    if like < _LIKE:
        finding = Finding(UNKNOWN, (), "valve", float("nan"), change.far, onset, alarm, end)
        return Held(finding, True, text)
    best, other = names[0], partner(names[0])
    near = _PAIR_RIVAL if other else _RIVAL
    also = [n for n in names[1:] if likelihood[best] - likelihood[n] < near]
    rivals = tuple(dict.fromkeys(n for n in (other, *also) if n))
    part = BY_NAME[best].part
    finding = Finding(best, rivals, part, severity, change.far, onset, alarm, end)
    return Held(finding, True, text)


def _named(look: _Look, change: _Change) -> tuple[dict[str, float], float, float]:
    """Return twice the log likelihood by fault, the best one's size, and how like it is."""
    off, white = look.off(change.row, len(look.y))
    z, table = white @ off, look.part.table
    unlike = _UNLIKE**2 * float(z @ z) / len(z)
    best: dict[str, float] = {}
    severity, most, like = float("nan"), -np.inf, 0.0
    for k, signature in enumerate(table.signatures):
        ray = white @ look.part.changes[k]
        size = min(max(float(ray @ z) / max(float(ray @ ray), 1e-300), 0.0), table.range(k)[1])
        size = max(size, table.range(k)[0])
        left = z - size * ray
        value = -float(left @ left) / (1.0 + unlike)
        best[signature.fault] = max(best.get(signature.fault, -np.inf), value)
        if value > most:
            most, severity = value, signature.severity * size
            like = 1.0 - float(left @ left) / max(float(z @ z), 1e-300)
    return best, severity, like


def _over(y: FloatArray, cycles: IntArray, count: int, change: _Change, look: _Look) -> int:
    """Return the cycle at which a departure was seen to be over, -1 = it lasts."""
    share, white = look.compared(change.row, count - change.row)
    before = share @ look.before(change.row)
    ray = white @ look.part.changes[change.signature]
    along = (y - before) @ white.T @ (ray / np.linalg.norm(ray))
    size = float(along[change.row : count].mean())
    if len(y) < count + _HEAL:
        return -1
    back = np.convolve(along[count:] < _BACK * size, np.ones(_HEAL), "valid") == _HEAL
    if back.any():
        return int(cycles[count + _HEAL - 1 + int(np.argmax(back))])
    return -1
