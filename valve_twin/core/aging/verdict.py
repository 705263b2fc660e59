# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One word a maintenance engineer can act on, and the trends it rests on.

A sudden fault that lasts (`core.diagnosis`) comes first: the verdict is the part that has it,
valve, command, sensor or supply, since what the parameters do meanwhile is its doing.

Else the verdict is `valve` if for any followed parameter

1. the fitted level is beyond its threshold and the drift against the reference is beyond doubt
   (`verdict_significance`): the limit state is alarm, or
2. the interval of the drift against the reference lies, beyond doubt, wholly beyond the warning
   limit, `alert_fraction` of the way to the threshold: the limit state is warning, or
3. the slope leads to the threshold beyond doubt (`verdict_significance`) within `horizon` axis
   units (median), and the drift has gone half as far as in 2. already: scatter wanders, too.

Else nothing is named, in four words:

recording unusable  two clocks run apart, or the newest cycles were refused for what signals are
not enough data     the newest cycles were refused for another reason, or none gave an estimate,
                    or a label says that the cycles' order is no aging, or a parameter seems to be
                    beyond its threshold, but not beyond doubt, or the newest cycle departs from
                    those before it or shows what no sound valve does, and more are to tell why
no reference        there are too few cycles to compare with, or the first ones differ from those
                    since, so that only another reference can tell which of them are right
ok                  nothing has changed against the reference that the evidence names: without a
                    record from commissioning the first cycles, whether they were right or not

Alarm and warning last until the level has come back by a hysteresis (`core.aging.limits`).
A significant but small drift is reported in the trend and does not raise the verdict.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum, IntEnum
from typing import TYPE_CHECKING, Annotated

import numpy as np

from valve_twin.core.aging.limits.beside import ALONE
from valve_twin.core.diagnosis.changes.finding import CLOCK, FRESH, describe_finding

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.aging.config import AgingConfig
    from valve_twin.core.aging.limits.beside import Beside
    from valve_twin.core.diagnosis.changes.finding import Finding, Stale


class TrendStatus(IntEnum):
    """What a trend says; the numbers are those of Trend.msg."""

    NOT_ENOUGH_DATA = 0
    STEADY = 1
    DRIFTING = 2
    BEYOND_THRESHOLD = 3


class LimitState(IntEnum):
    """Where the level stands to its two limits; the numbers are those of Trend.msg."""

    NONE = 0
    WITHIN = 1
    WARNING = 2
    ALARM = 3

    @property
    def text(self) -> str:
        """The word, as shown; empty where nothing is known."""
        return self.name.lower() if self else ""


class Outlook(Enum):
    """What a trend says about its limit: every face says this, and no other, in its own words."""

    UNKNOWN = "not enough data"
    NO_LIMIT = "no threshold set"
    REACHED = "beyond its threshold"
    FORECAST = "so many cycles left"
    BENDS = "no forecast: the trend bends"
    IN_DOUBT = "no forecast: the threshold is within the doubt"
    OPEN = "no forecast yet"
    FAR = "threshold not in sight"

    @property
    def says_when(self) -> bool:
        """Whether there is a number of cycles or hours to show: of a forecast, or none left."""
        return self in (Outlook.REACHED, Outlook.FORECAST)


class VerdictKind(IntEnum):
    """The verdict; the numbers are those of Verdict.msg."""

    NOT_ENOUGH_DATA = 0
    OK = 1
    VALVE = 2
    COMMAND = 3
    SENSOR = 4
    SUPPLY = 5
    NO_REFERENCE = 6
    RECORDING_UNUSABLE = 7

    @property
    def text(self) -> str:
        """The word, as published."""
        return self.name.lower().replace("_", " ")

    @property
    def names_part(self) -> bool:
        """Whether it says what is wrong: valve, command, sensor or supply."""
        return VerdictKind.VALVE <= self <= VerdictKind.SUPPLY

    @property
    def asks_for_help(self) -> bool:
        """Whether somebody has to look: a part is named, or the recording is unusable."""
        return self.names_part or self is VerdictKind.RECORDING_UNUSABLE


@dataclass(frozen=True, slots=True)
class Trend:
    """Aging trend of one parameter in the present segment; fields and units as in Trend.msg.

    Dates are stamps of the data's clock [ns], 0 = none. Numbers that are not known are NaN.
    """

    stamp_ns: int
    valve: str
    parameter: str
    unit: str
    axis: str
    status: TrendStatus
    reason: str
    samples: int
    segments: int
    segment_start: float
    axis_value: float
    level: float = np.nan
    slope: float = np.nan
    slope_lower_95: float = np.nan
    slope_upper_95: float = np.nan
    p_value: float = np.nan
    autocorrelation: float = np.nan
    mean_lower_95: float = np.nan
    mean_upper_95: float = np.nan
    prediction_lower_95: float = np.nan
    prediction_upper_95: float = np.nan
    reference: float = np.nan
    reference_source: str = "first_cycles"
    drift_reference: float = np.nan
    drift_reference_lower_95: float = np.nan
    drift_reference_upper_95: float = np.nan
    drift_segment: float = np.nan
    drift_segment_lower_95: float = np.nan
    drift_segment_upper_95: float = np.nan
    threshold: float = np.nan
    unbounded: bool = True
    remaining_low: float = np.inf
    remaining_median: float = np.inf
    remaining_high: float = np.inf
    cycle_rate: float = np.nan
    service_date_known: bool = False
    service_date_ns: int = 0
    service_date_early_ns: int = 0
    law: str = ""
    law_probability: float = np.nan
    bends: bool = False
    next_stop_probability: float = np.nan
    share_lost: float = np.nan
    warning: float = np.nan
    limit_state: LimitState = LimitState.NONE


@dataclass(frozen=True, slots=True)
class Verdict:
    """One word with its evidence; fields as in Verdict.msg.

    `fault` is the name of the sudden fault (`core.diagnosis.table`, or `UNKNOWN`), else the
    parameter whose drift gives the verdict; empty where there is neither. `held_back` until one
    more cycle came: no news for a log.
    """

    stamp_ns: int
    valve: str
    kind: Annotated[VerdictKind, "verdict"]
    text: str
    evidence: str
    cycle: int
    fault: str = ""
    held_back: bool = False


def held_back(verdict: Verdict, departs: float, *, cycle: int = 0, odd: str = "") -> Verdict:
    """Return a verdict, no "ok" where the newest cycle departs from those before it.

    Nor where it shows what no sound valve does, which more cycles must confirm.

    Parameters
    ----------
    verdict : Verdict
        By all else.
    departs : float
        How far it lies off them, 0 = it does not [standard deviations].
    cycle : int
        Its number, 0 = that of the verdict: newer ones may have shown nothing.
    odd : str
        What it shows that no sound valve does; empty where it shows nothing such.
    """
    if verdict.kind is not VerdictKind.OK or not (departs or odd):
        return verdict
    far = f"{departs:.1f}" if departs < 100.0 else "over 100"
    newest = f"cycle {cycle or verdict.cycle} lies {far} standard deviations off those before it"
    why = f"{newest}, and one more tells" if departs else f"{odd}, and more cycles tell"
    evidence = f"not yet judged: {why} whether that is a fault; {verdict.evidence}"
    kind = VerdictKind.NOT_ENOUGH_DATA
    return replace(verdict, kind=kind, text=kind.text, evidence=evidence, held_back=True)


def way_to_threshold(trend: Trend) -> float:
    """Return the share of the way to the threshold that is covered with 95 % confidence [1].

    NaN where it is unknown; negative where the drift leads away or is not significant.
    """
    return min(_covered(trend), default=np.nan)


def way_percent(limit: float, reference: float) -> float:
    """Return how far a limit lies from a reference [%], NaN where that is 0.

    Parameters
    ----------
    limit, reference : float
        Values of a parameter [its unit].
    """
    return 100.0 * (limit / reference - 1.0) if reference else np.nan


def _covered(trend: Trend) -> tuple[float, ...]:
    """Return both ends of the drift's interval as shares of the way to the threshold [1]."""
    way = way_percent(trend.threshold, trend.reference)
    ends = (trend.drift_reference_lower_95, trend.drift_reference_upper_95)
    return tuple(float(end / way) for end in ends) if way else ()


SOON = 1.0
"""Remaining cycles or hours below which "not before" says nothing [axis unit]."""

_BACK = 0.5
"""Share of the way to a limit that a drift may lead away from it, within its doubt, while the
limit seems to be passed [1], assumed."""

_OWN_ONLY = (
    "unchanged since cycle {}, no claim that it was right then: no record from commissioning; "
)


def concern(trend: Trend, config: AgingConfig) -> int:
    """Return how grave a trend is: 3, 2, 1 for rules 1, 2, 3 of the module, else 0."""
    if trend.status is TrendStatus.NOT_ENOUGH_DATA or not np.isfinite(trend.threshold):
        return 0
    if trend.limit_state in (LimitState.WARNING, LimitState.ALARM):
        return 3 if trend.limit_state is LimitState.ALARM else 2
    if trend.status is TrendStatus.BEYOND_THRESHOLD:
        return 0  # not beyond doubt
    near = trend.remaining_median <= config.horizon
    sure = trend.p_value < config.verdict_significance
    return 1 if near and sure and not trend.share_lost < 0.5 * config.alert_fraction else 0


def decide(
    trends: Sequence[Trend],
    config: AgingConfig,
    *,
    valve: str,
    stamp_ns: int,
    cycle: int,
    fault: Finding | None = None,
    stale: Stale = FRESH,
    doubt: str = "",
    failed: str = "",
    beside: Beside = ALONE,
) -> Verdict:
    """Return the verdict from all trends of one valve and its fault (rule: see the module).

    Parameters
    ----------
    trends : sequence of Trend
        All trends of the valve.
    config : AgingConfig
        Alert fraction, horizon, significance, label.
    valve : str
        Its name.
    stamp_ns : int
        Stamp of the newest estimate [ns].
    cycle : int
        Its cycle.
    fault : Finding, optional
        A sudden fault that lasts.
    stale : Stale
        Why the newest cycles say nothing.
    doubt : str
        Why the features have nothing to be compared with; empty where they have.
    failed : str
        What a stored reference says, and which checks the newest estimates fail; told behind the
        evidence.
    beside : Beside
        What is known beside the trends.
    """
    judged = [t for t in trends if t.status is not TrendStatus.NOT_ENOUGH_DATA]
    graves = [(concern(t, config), -t.remaining_median, t) for t in judged]
    worst = max(graves, key=lambda g: g[:2], default=None)
    named = ""
    if config.label:
        kind = VerdictKind.NOT_ENOUGH_DATA
        evidence = f"the cycles differ ({config.label}): what changes is not taken for wear"
    elif fault is not None and not stale.outdates(fault):
        kind, evidence = VerdictKind[fault.part.upper()], describe_finding(fault)
        kind = VerdictKind.RECORDING_UNUSABLE if fault.fault == CLOCK else kind
        named = fault.fault
        evidence += f"; beside it {describe(worst[2])}" if worst and worst[0] else ""
    elif stale.reason:
        evidence = stale.reason + (f"; before it {describe_finding(fault)}" if fault else "")
        kind = VerdictKind.RECORDING_UNUSABLE if stale.unusable else VerdictKind.NOT_ENOUGH_DATA
    elif worst is None:
        seen = any(t.samples for t in trends)
        kind = VerdictKind.NO_REFERENCE if seen else VerdictKind.NOT_ENOUGH_DATA
        why = "; ".join(f"{t.parameter}: {t.reason}" for t in trends)
        evidence = f"no reference yet: {why}" if why else "no parameter is followed"
    elif worst[0]:
        kind, evidence, named = VerdictKind.VALVE, describe(worst[2]), worst[2].parameter
    elif doubt:
        kind, evidence = VerdictKind.NO_REFERENCE, doubt
    elif beyond := [t for t in judged if _may_be_beyond(t)]:
        kind = VerdictKind.NOT_ENOUGH_DATA
        evidence = f"perhaps beyond a limit: {describe(max(beyond, key=_share))}"
    elif beside.mute:
        kind = VerdictKind.NOT_ENOUGH_DATA
        evidence = f"one direction is not judged, no cycle told {', '.join(beside.mute)}"
    else:
        kind = VerdictKind.OK
        commissioned = all(t.reference_source == "commissioning" for t in judged)
        own_only = "" if commissioned else _OWN_ONLY.format(beside.since)
        largest = max([t for t in judged if not _unsaid(t)] or judged, key=_share)
        brief = {t.parameter: t.reason for t in trends} | dict(beside.short)
        excepted = "".join(f"{said}; " for t in trends if (said := _unsaid(t, brief[t.parameter])))
        evidence = f"{excepted}{own_only}largest drift: {describe(largest)}"
    evidence += f"; {failed}" if failed else ""
    return Verdict(stamp_ns, valve, kind, kind.text, evidence, cycle, named)


def unjudged(verdict: Verdict, trends: Sequence[Trend]) -> tuple[str, ...]:
    """Return the parameters of which "ok" says nothing, or not that they are within a limit."""
    return tuple(t.parameter for t in trends if verdict.kind is VerdictKind.OK and _unsaid(t))


def _unsaid(trend: Trend, why: str = "") -> str:
    """Return why "ok" says nothing of a parameter, or not that it is within its limit, or ""."""
    if trend.status is TrendStatus.NOT_ENOUGH_DATA:
        return f"nothing is said of {trend.parameter}: {why}"
    if not max(_covered(trend), default=np.nan) >= 1.0:  # nor where it is not known
        return ""
    low, high = trend.drift_reference_lower_95, trend.drift_reference_upper_95
    way = way_percent(trend.threshold, trend.reference)
    reach = f"{low:+.1f} .. {high:+.1f} of {way:+.3g} %"
    return f"a limit of {trend.parameter} is within the doubt: {reach}"


def _may_be_beyond(trend: Trend) -> bool:
    """Return whether a level is beyond its limit, though not beyond doubt.

    Where a drift of half the way back is within the doubt, it tells nothing.
    """
    if trend.status is TrendStatus.BEYOND_THRESHOLD:
        return True
    return _share(trend) >= 1.0 and min(_covered(trend), default=-np.inf) > -_BACK


def _share(trend: Trend) -> float:
    """Order trends by how much of the way to the threshold they have gone."""
    way = way_percent(trend.threshold, trend.reference)
    share = trend.drift_reference / way if way else np.nan
    return float(share) if np.isfinite(share) else -1.0


def describe(trend: Trend) -> str:
    """Return one line in plain words and numbers, `K_in -13.9 % of new (95 %: ...), ...`."""
    origin = "commissioning" if trend.reference_source == "commissioning" else "new"
    if np.isfinite(trend.drift_reference):
        low, high = trend.drift_reference_lower_95, trend.drift_reference_upper_95
        drift = f"{trend.drift_reference:+.1f} % of {origin} (95 %: {low:+.1f} .. {high:+.1f})"
    else:
        low, high = trend.mean_lower_95, trend.mean_upper_95
        drift = f"{trend.level:.4g} {trend.unit} (95 %: {low:.4g} .. {high:.4g})"
    before = ""
    if trend.share_lost > max(way_to_threshold(trend), 0.0) + 0.1:
        lost = 100.0 * trend.share_lost
        before = f", {lost:.0f} % of the way to its limit lost before the present segment"
    return f"{trend.parameter} {drift}{before}, {describe_remaining(trend)}"


def outlook(trend: Trend) -> Outlook:
    """Return what a trend says about its limit."""
    if trend.status is TrendStatus.NOT_ENOUGH_DATA:
        return Outlook.UNKNOWN
    if not np.isfinite(trend.threshold):
        return Outlook.NO_LIMIT
    if trend.status is TrendStatus.BEYOND_THRESHOLD:
        return Outlook.REACHED
    if not trend.unbounded:
        return Outlook.FORECAST
    if trend.bends:
        return Outlook.BENDS
    if trend.remaining_low < SOON:
        return Outlook.IN_DOUBT
    return Outlook.OPEN if np.isfinite(trend.remaining_low) else Outlook.FAR


def describe_limit(trend: Trend) -> str:
    """Return where the level stands to its two limits in words, empty where nothing is known.

    Where it is not known beyond doubt, the limit that is in doubt is named: a life that is told
    beside it counts to the service limit, the doubt is about the warning limit mostly.
    """
    if trend.limit_state or outlook(trend) in (Outlook.UNKNOWN, Outlook.NO_LIMIT):
        return trend.limit_state.text
    near = LimitState.ALARM if outlook(trend) is Outlook.REACHED else LimitState.WARNING
    return f"{near.text} in doubt"


def describe_remaining(trend: Trend) -> str:
    """Return what remains to the threshold in words."""
    unit = "hours" if trend.axis == "hours" else "cycles"
    said = outlook(trend)
    if said is Outlook.REACHED:
        return f"{said.value} of {trend.threshold:.4g}"
    law = f" ({trend.law})" if trend.bends else ""
    if said is Outlook.FORECAST:
        low, high = _count(trend.remaining_low), _count(trend.remaining_high)
        bent = f", the trend bends{law}" if law else ""
        return f"{_count(trend.remaining_median)} {unit} left ({low} .. {high}){bent}"
    least = ""
    if said in (Outlook.OPEN, Outlook.BENDS) and SOON <= trend.remaining_low < np.inf:
        least = f", not before {_count(trend.remaining_low)} {unit}"
    return f"{said.value}{law if said is Outlook.BENDS else ''}{least}"


def _count(number: float) -> str:
    """Return a number of cycles or hours as a person writes it."""
    return f"{number:.0f}" if number < 1e6 else f"{number:.1e}"
