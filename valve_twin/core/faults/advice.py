# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a verdict asks of maintenance: state, failure mode, part, probable cause, action, urgency.

States are those of NAMUR NE 107, failure modes the codes of ISO 14224; an advisory of part, action
and urgency is the last block of ISO 13374. Which fault has which is our assignment.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from valve_twin.core.aging.verdict import LimitState, VerdictKind
from valve_twin.core.diagnosis.changes.finding import UNKNOWN
from valve_twin.core.diagnosis.table import PARTS
from valve_twin.core.faults.lifetime import Severity
from valve_twin.core.faults.ne107 import NODE_FAULTS, Ne107

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.aging.verdict import Trend, Verdict

FAILURE_MODES = {
    "AIR": "abnormal instrument reading",
    "DOP": "delayed operation",
    "ERO": "erratic output",
    "FTC": "failure to close on demand",
    "FTO": "failure to open on demand",
    "FTR": "failure to regulate",
    "INL": "internal leakage",
    "LOO": "low output",
    "PDE": "parameter deviation",
    "UNK": "unknown",
}
"""Failure modes of ISO 14224 that are used here, by code."""

NOW, NEXT_STOP, PLAN, NONE = "now", "at the next stop", "to be planned", ""
"""How soon."""


@dataclass(frozen=True, slots=True)
class Advice:
    """What a verdict asks for.

    Attributes
    ----------
    ne107 : Ne107
        State of the valve.
    failure_mode : str
        Code of ISO 14224, see `FAILURE_MODES`; empty = none.
    part : str
        What is to be looked at; empty = nothing.
    cause : str
        The most probable one.
    action : str
        What is to be done.
    urgency : str
        How soon: `NOW`, `NEXT_STOP`, `PLAN` or `NONE`.
    """

    ne107: Ne107
    failure_mode: str = ""
    part: str = ""
    cause: str = ""
    action: str = ""
    urgency: str = NONE

    @property
    def severity(self) -> Severity:
        """Severity of the fault at a node: the valve fails, or it still does what it is for."""
        return Severity.ERROR if self.ne107 is Ne107.FAILURE else Severity.WARN

    @property
    def sentence(self) -> str:
        """Part, action and urgency in a line; empty where nothing is to be done."""
        if not self.action:
            return ""
        return f"{self.part}: {self.action}" + (f", {self.urgency}" if self.urgency else "")


_F, _C, _S, _M = (state for state in Ne107 if state is not Ne107.GOOD)

_CAUSES = {
    "leak": (_M, "INL", "seat and seals of the chamber", "worn or dirty seat or seal"),
    "stiction": (_M, "DOP", "pilot stage", "dirt or varnish in the pilot, worn guide"),
    "preload": (_M, "PDE", "closing spring", "set or broken spring, changed return pressure"),
    "coil_resistance": (_M, "PDE", "filling coil", "hot or damaged coil, bad contact"),
    "weak_outflow": (_M, "PDE", "emptying pilots", "worn or dirty pilots, hot or damaged coil"),
    "dead_band": (_M, "PDE", "pilot stage", "worn edges or shifted null"),
    "aeration": (_S, "ERO", "hydraulic fluid", "gas in the chamber"),
    "lost_motion": (_M, "PDE", "drive between command and position", "worn joint, thread or pin"),
    "sticking": (_M, "DOP", "packing and guide", "dirt, tight packing, dry guide"),
    "delay": (_M, "DOP", "drive and pilot", "slow pilot, air in the drive, later command"),
    "slow": (_M, "DOP", "drive and supply", "low supply, throttled lines, friction"),
    "slow_up": (_M, "DOP", "drive", "low supply, throttled line, friction"),
    "slow_down": (_M, "DOP", "drive", "throttled line, weak spring, friction"),
    "end_stop_upper": (_M, "PDE", "upper end stop", "dirt, shifted stop, low supply"),
    "end_stop_lower": (_M, "PDE", "lower end stop or seat", "dirt, worn seat, shifted stop"),
    "oscillation": (_S, "ERO", "control loop and supply", "loop too tight, friction, gas"),
    "no_motion": (_F, "FTR", "spool and its command", "jammed spool, or no command arrives"),
    "no_opening": (_F, "FTO", "valve and its drive", "jammed, no supply, switch out of place"),
    "no_closing": (_F, "FTC", "valve and its drive", "jammed, weak spring, switch out of place"),
    "sensor_offset": (_S, "AIR", "position sensor", "shifted mounting or electronics"),
    "sensor_gain": (_S, "AIR", "position sensor", "drifted or wrongly scaled sensor"),
    "sensor_freeze": (_F, "AIR", "position sensor", "signal held by sensor, cable or bus"),
    "sensor_noise": (_M, "AIR", "position sensor", "bad contact, earth or cable"),
    "clock": (_S, "AIR", "clocks of the signals", "position and commands are not synchronised"),
    "command_offset": (_M, "PDE", "command path", "shifted null of output, amplifier or pilot"),
    "command_loss": (_F, "FTR", "command path", "output, cable or amplifier drops commands"),
    "saturation": (_S, "LOO", "command and supply", "more is asked for than the drive can give"),
    "supply_drop": (_S, "LOO", "supply", "pump, accumulator, filter or another consumer"),
    UNKNOWN: (_M, "UNK", "valve", "a change like no known fault"),
}

_ACTIONS = {
    "leak": ("flush, then inspect seat and seals", NEXT_STOP),
    "stiction": ("clean or renew it, look at the filter", NEXT_STOP),
    "preload": ("inspect it, measure the return pressure", NEXT_STOP),
    "coil_resistance": ("measure resistance and plug, cold and warm", NEXT_STOP),
    "weak_outflow": ("inspect them, measure coil and plug", NEXT_STOP),
    "dead_band": ("adjust the null or renew it", NEXT_STOP),
    "aeration": ("bleed, look at level and suction line", NOW),
    "lost_motion": ("inspect the joint, take out the play", NEXT_STOP),
    "sticking": ("clean it, ease or renew the packing", NEXT_STOP),
    "delay": ("time the command at the valve, inspect the pilot", NEXT_STOP),
    "slow": ("measure the supply in motion, inspect drive and packing", NEXT_STOP),
    "slow_up": ("measure the supply in motion, inspect the drive", NEXT_STOP),
    "slow_down": ("inspect lines and spring", NEXT_STOP),
    "end_stop_upper": ("move to the end by hand, inspect the stop", NEXT_STOP),
    "end_stop_lower": ("flush, move to the end by hand, inspect the seat", NEXT_STOP),
    "oscillation": ("compare with the command, detune the loop", NOW),
    "no_motion": ("stop, measure the command at the valve, then free the spool", NOW),
    "no_opening": ("look whether it moves: supply, coil, spindle, then the switch", NOW),
    "no_closing": ("look whether it moves: spring, coil, spindle, then the switch", NOW),
    "sensor_offset": ("check its zero against the seats", NEXT_STOP),
    "sensor_gain": ("check its scale over the stroke", NEXT_STOP),
    "sensor_freeze": ("look at signal and bus, renew it if it stays", NOW),
    "sensor_noise": ("look at plug, shield and earth", NEXT_STOP),
    "clock": ("synchronise the clocks or stamp at the source", NEXT_STOP),
    "command_offset": ("measure the command at the valve, adjust the null", NEXT_STOP),
    "command_loss": ("measure the command at the valve", NOW),
    "saturation": ("measure supply and load, look why more is asked for", NEXT_STOP),
    "supply_drop": ("measure pressure or voltage under load", NOW),
    UNKNOWN: ("compare a cycle with an old one, inspect", NEXT_STOP),
}

FAULT_ADVICE = {name: Advice(*known, *_ACTIONS[name]) for name, known in _CAUSES.items()}
"""Advice by the name of a sudden fault (`core.diagnosis.table`)."""

LIMIT_STATES = {
    LimitState.NONE: Ne107.GOOD,
    LimitState.WITHIN: Ne107.GOOD,
    LimitState.WARNING: _M,
    LimitState.ALARM: _S,
}
"""State by where a trend stands to its limits."""

_WEAR = Advice(
    LIMIT_STATES[LimitState.WARNING], "PDE", "valve", "wear or dirt", "overhaul it", PLAN
)
BY_VERDICT = {
    VerdictKind.NOT_ENOUGH_DATA: Advice(_C, part="monitoring", action="see why there is none"),
    VerdictKind.NO_REFERENCE: Advice(
        _C, part="monitoring", action="let it run, and look at it where its first cycles differ"
    ),
    VerdictKind.RECORDING_UNUSABLE: Advice(
        _F, "AIR", "signals", "too few bits, clocks apart, wrong unit or limits", "mend them", NOW
    ),
    VerdictKind.OK: Advice(Ne107.GOOD),
    VerdictKind.VALVE: _WEAR,
    VerdictKind.COMMAND: Advice(_F, "FTR", "command path", "", "measure the command", NOW),
    VerdictKind.SENSOR: Advice(_S, "AIR", "position sensor", "", "check it", NEXT_STOP),
    VerdictKind.SUPPLY: Advice(_S, "LOO", "supply", "", "measure it under load", NEXT_STOP),
}
"""Advice by a verdict that names no fault."""


def advise(verdict: Verdict, trends: Sequence[Trend] = ()) -> Advice:
    """Return what a verdict asks of maintenance.

    Parameters
    ----------
    verdict : Verdict
        Of the newest cycle.
    trends : sequence of Trend
        The trends it was made from: one beyond its limit asks for more than one on its way.
    """
    trend = next((t for t in trends if t.parameter == verdict.fault), None)
    worn = trend is not None and verdict.kind is VerdictKind.VALVE
    advice = FAULT_ADVICE.get(verdict.fault)
    if advice is None and worn:
        advice = replace(_WEAR, cause=f"wear or dirt that changes {verdict.fault}")
    if advice is None:
        return BY_VERDICT[verdict.kind]
    if trend is not None and trend.limit_state is LimitState.ALARM:
        beyond = LIMIT_STATES[trend.limit_state]
        graver = max(advice.ne107, beyond, key=lambda state: state.severity)
        return replace(advice, ne107=graver, urgency=NOW)
    return advice


DIAGNOSED = {part: f"diagnosis.{part}" for part in PARTS}
"""By what has a fault that a verdict names, its code as a fault of a node; its subject is it."""


def state_of(code: str, subject: str = "") -> Ne107:
    """Return the state of a fault of a node; of a code that is not known here somebody looks.

    Parameters
    ----------
    code, subject : str
        As it is filed: the subject of a fault that a verdict names is its name.
    """
    named = FAULT_ADVICE.get(subject) if code in DIAGNOSED.values() else None
    return NODE_FAULTS.get(code, Ne107.CHECK_FUNCTION) if named is None else named.ne107


def with_advice_table(text: str) -> str:
    """Return docs/diagnosis.md with the table between its two marks written anew."""
    begin, end = "<!-- advice begins -->\n", "<!-- advice ends -->"
    before, rest = text.split(begin)
    return f"{before}{begin}{_table()}{end}{rest.split(end)[1]}"


def _table() -> str:
    """Return the table of all advices by fault."""
    head = "| fault | NE 107 | ISO 14224 | look at | most probable cause | do | when |"
    rows = [
        f"| {name} | {a.ne107.letter} | {a.failure_mode} {FAILURE_MODES[a.failure_mode]} | "
        f"{a.part} | {a.cause} | {a.action} | {a.urgency} |"
        for name, a in (*FAULT_ADVICE.items(), ("wear of any parameter", _WEAR))
    ]
    return "\n".join((head, "| --- | --- | --- | --- | --- | --- | --- |", *rows)) + "\n"
