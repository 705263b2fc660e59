# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Every fault that a node may report; docs/faults.md is written from this table."""

from __future__ import annotations

from dataclasses import replace
from math import inf, isinf
from typing import TYPE_CHECKING

from valve_twin.core.diagnosis.changes.finding import UNKNOWN
from valve_twin.core.diagnosis.table import FAULT_TYPES
from valve_twin.core.faults.advice import DIAGNOSED, FAULT_ADVICE
from valve_twin.core.faults.lifetime import FaultKind, Severity
from valve_twin.core.faults.ne107 import Ne107

if TYPE_CHECKING:
    from valve_twin.core.faults.advice import Advice

_WARN, _ERROR, _STALE = Severity.WARN, Severity.ERROR, Severity.STALE

EVENT_HEAL_S = 30.0
"""An event that happens no more is healed after this time [s]."""

_AS_NAMED = "Do what the verdict's advice for this fault says; then mark the maintenance."

_INPUTS = (
    FaultKind(
        "input.missing",
        _WARN,
        "Nobody publishes a topic that the valve needs.",
        "Start its publisher, or correct signals.NAME.topic; the nearest topics are named.",
    ),
    FaultKind(
        "input.type",
        _ERROR,
        "A topic carries another message type than configured.",
        "Set signals.NAME.type and signals.NAME.field to what the publisher sends.",
    ),
    FaultKind(
        "input.qos",
        _ERROR,
        "A publisher offers a quality of service that the subscription cannot take.",
        "Change the named policy at the publisher, or set the named parameter here.",
    ),
    FaultKind(
        "input.silent",
        _STALE,
        "A topic gave no message for longer than silence_s.",
        "Look at its publisher and at the network; no estimate is made meanwhile.",
    ),
    FaultKind(
        "input.deadline",
        _WARN,
        "Two messages were further apart than deadline_s.",
        "Look at the publisher's load and at the network, or raise deadline_s.",
        heal_s=EVENT_HEAL_S,
    ),
    FaultKind(
        "input.loss",
        _WARN,
        "Messages or values of a PLC were lost on the way: by the publisher's own numbering, or by"
        " their stamps or the server's word.",
        "Look at the network; publish reliably with a deeper queue; let a server send oftener.",
        heal_s=EVENT_HEAL_S,
    ),
    FaultKind(
        "input.overrun",
        _ERROR,
        "The twin took messages too late and its input queue overflowed.",
        "Give the process more computing time or fewer valves, or raise input_queue.",
        heal_s=EVENT_HEAL_S,
    ),
    FaultKind(
        "input.gaps",
        _WARN,
        "Samples of the position are missing: their stamps are further apart than period_s.",
        "Look at the source of the position, or correct period_s.",
        heal_s=EVENT_HEAL_S,
    ),
    FaultKind(
        "input.unreadable",
        _ERROR,
        "Messages could not be decoded or hold a batch without a sampling time.",
        "Publish the configured type from the same message definition.",
        heal_s=EVENT_HEAL_S,
    ),
    FaultKind(
        "input.deaf",
        _WARN,
        "The reliable subscription heard nothing of what another one heard: behind a message of "
        "0 bytes, which the middleware cannot hand on and which is passed over, or from the start "
        "on, after a process that was killed. What cannot pass it over was made anew, the second "
        "time as best effort.",
        "Look at the publisher if it sends serialized messages without content; stop nodes with "
        "SIGTERM, not with SIGKILL.",
        heal_s=EVENT_HEAL_S,
    ),
    FaultKind(
        "input.values",
        _WARN,
        "Values are not finite or outside signals.NAME.lower and upper; they are not used.",
        "Look at the sensor and its scaling, or correct signals.NAME.lower and upper.",
        confirm_count=3,
        heal_s=EVENT_HEAL_S,
    ),
)

_STAMPS = (
    FaultKind(
        "stamps.duplicate",
        _WARN,
        "Samples carry the stamp of an earlier one; they are not used.",
        "Look for a second publisher, or a source that repeats its last message.",
        confirm_count=3,
        heal_s=EVENT_HEAL_S,
    ),
    FaultKind(
        "stamps.late",
        _WARN,
        "Samples carry an older stamp than one before, or came after hold_back_s; not used.",
        "Stamp at acquisition with a clock that only rises, synchronise the clocks of the "
        "signals, or raise hold_back_s.",
        confirm_count=3,
        heal_s=EVENT_HEAL_S,
    ),
    FaultKind(
        "clock.set_back",
        _WARN,
        "The clock of the data or of the node was set back; the running cycle was dropped.",
        "Slew the clock instead of setting it; a bag that is played in a loop does this, too.",
        heal_s=EVENT_HEAL_S,
    ),
    FaultKind(
        "clock.offset",
        _ERROR,
        "The signals of a valve are stamped by clocks that differ by more than hold_back_s.",
        "Synchronise the clocks, stamp all signals on one computer, or do what the line says.",
    ),
    FaultKind(
        "clock.sources",
        _ERROR,
        "Several nodes publish /clock: simulated time jumps between them.",
        "Let one node publish it (clock: false at the others), or give each its ROS_DOMAIN_ID.",
        confirm_s=2.0,
    ),
    FaultKind(
        "clock.waiting",
        _STALE,
        "use_sim_time is set and no /clock has come; nothing is processed before it.",
        "Start what publishes /clock, or set use_sim_time to false.",
    ),
)

_ESTIMATION = (
    FaultKind(
        "estimation.overdue",
        _WARN,
        "Cycles wait for their estimation: it takes longer than a cycle lasts.",
        "Choose fewer estimators, give the process more computing time, or fewer valves.",
        confirm_s=5.0,
        heal_s=5.0,
    ),
    FaultKind(
        "estimation.dropped",
        _ERROR,
        "Cycles were given up unestimated: memory_budget_mb and the disk beside the history are "
        "full.",
        "As for estimation.overdue, free some space, or raise memory_budget_mb.",
        heal_s=EVENT_HEAL_S,
    ),
    FaultKind(
        "estimation.late",
        _WARN,
        "A cycle was predicted without the estimate that it was due: estimate_wait_s was over.",
        "As for estimation.overdue, or raise estimate_wait_s; after a start it passes.",
        heal_s=EVENT_HEAL_S,
    ),
    FaultKind(
        "estimation.refused",
        _WARN,
        "Several cycles one after another gave no estimate that may be used.",
        "Read the reason in twin/estimate; look at the inputs and at cycles.* and options.*.",
        confirm_count=3,
        heal_s=inf,
    ),
    FaultKind(
        "estimation.failed",
        _ERROR,
        "An estimation ended with an error; its cycle has no estimate.",
        "Read the named error; report it with the bag of that cycle.",
        heal_s=300.0,
    ),
    FaultKind(
        "estimation.worker_died",
        _WARN,
        "The process that estimates ended and was started again; its job was repeated.",
        "Look for a lack of memory (dmesg), or what else ends processes.",
        heal_s=300.0,
    ),
)

_STORE = (
    FaultKind(
        "history.not_stored",
        _ERROR,
        "The database does not take estimates; they are kept and offered again.",
        "Free, mount or repair what is named; restart the twin only when all is stored.",
    ),
    FaultKind(
        "history.dropped",
        _ERROR,
        "The database was away for so long that kept cycles had to be given up.",
        "Bring the database back; record a bag meanwhile, it can be estimated later.",
        heal_s=3600.0,
    ),
    FaultKind(
        "history.refused",
        _ERROR,
        "The database refuses cycles for good, as another one stands under their number.",
        "Let only one twin write a valve; give each valve its own name in a shared history.",
        heal_s=3600.0,
    ),
)

_DIAGNOSIS = tuple(
    FaultKind(DIAGNOSED[part], _WARN, meaning, _AS_NAMED, heal_s=inf)
    for part, meaning in (
        ("valve", "What the valve does has changed suddenly; the subject names the fault."),
        ("command", "Commands do not reach the valve as they are; the subject names the fault."),
        ("sensor", "The position signal has changed suddenly; the subject names the fault."),
        ("supply", "The valve acts as if its supply had fallen; the subject names the fault."),
    )
)

_NODES = (
    FaultKind(
        "parameter.refused",
        _WARN,
        "A change of a parameter was refused.",
        "Read the reason; clean up the node before a change of what takes effect at configure.",
        heal_s=EVENT_HEAL_S,
    ),
    FaultKind(
        "twin.absent",
        _STALE,
        "The aging monitor does not reach the twin of a valve.",
        "Start the twin of this valve, in the same ROS_DOMAIN_ID.",
        confirm_s=10.0,  # both may be started at once
    ),
    FaultKind(
        "assessment.failed",
        _ERROR,
        "The trends of a valve could not be assessed.",
        "Read the named error and correct aging.*.",
    ),
    FaultKind(
        "simulation.slow",
        _WARN,
        "The simulated valve does not reach its rate; no sample is lost.",
        "Lower rate, or give subscribers and machine more time.",
        heal_s=EVENT_HEAL_S,
    ),
    FaultKind(
        "simulation.failed",
        _ERROR,
        "The integration of a simulated valve failed: its position is no number from there on.",
        "Correct simulation.plant.* (time and state stand in the evidence), then configure anew.",
        heal_s=inf,
    ),
    FaultKind(
        "simulation.command",
        _WARN,
        "A command from outside is beyond what the simulated valve takes and is limited, or is no "
        "number and the last one is held.",
        "Correct its publisher: command, value and range stand in the evidence.",
        heal_s=EVENT_HEAL_S,
    ),
    FaultKind(
        "safety.stopped",
        _ERROR,
        "Publishing was stopped: a foreign publisher or taker of commands came into reach.",
        "Take it off the topic, choose another publish_prefix, or set allow_live.",
        heal_s=inf,
    ),
    FaultKind(
        "recorder.loss",
        _ERROR,
        "Messages are missing in the recorded bag.",
        "Look at network, disk and queue; the counts stand in the bag's metadata.",
        heal_s=EVENT_HEAL_S,
    ),
    FaultKind(
        "recorder.disk",
        _ERROR,
        "The disk does not take the recording, or its free space fell below the floor.",
        "Free space, or choose another folder.",
    ),
)

FAULT_KINDS: tuple[FaultKind, ...] = (
    *_INPUTS,
    *_STAMPS,
    *_ESTIMATION,
    *_STORE,
    *_DIAGNOSIS,
    *_NODES,
)
"""Every fault by area."""


_PARTS = {UNKNOWN: "valve"} | {fault.name: fault.part for fault in FAULT_TYPES}
_BY_CODE = {kind.code: kind for kind in FAULT_KINDS}


def diagnosed(part: str, advice: Advice) -> FaultKind:
    """Return the kind of a fault of the valve that a verdict names.

    Parameters
    ----------
    part : str
        What has it: valve, command, sensor or supply.
    advice : Advice
        What the verdict asks for: it gives state, severity and remedy.
    """
    kind = _BY_CODE[DIAGNOSED[part]]
    return replace(
        kind,
        severity=advice.severity,
        remedy=advice.sentence,
        state=advice.ne107,
        failure_mode=advice.failure_mode,
        cause=advice.cause,
    )


def with_fault_table(text: str) -> str:
    """Return docs/faults.md with the table between its two marks written anew."""
    begin, end = "<!-- table begins -->\n", "<!-- table ends -->"
    before, rest = text.split(begin)
    return f"{before}{begin}{fault_reference()}{end}{rest.split(end)[1]}"


def fault_reference() -> str:
    """Return the table of all faults: code, severity, NE 107, debounce, meaning, what to do."""
    lines = [
        "| code | severity | NE 107 | confirmed after | healed after | meaning | what to do |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    lines += [
        f"| `{k.code}` | {_severity(k)} | {_letter(k)} | {_confirm(k)} | "
        f"{_heal(k)} | {k.meaning} | {k.remedy} |"
        for k in FAULT_KINDS
    ]
    return "\n".join(lines) + "\n"


def _named(kind: FaultKind) -> list[Advice]:
    """Return the advices of all faults that may be the subject of a kind."""
    return [a for name, a in FAULT_ADVICE.items() if kind.code == DIAGNOSED[_PARTS[name]]]


def _severity(kind: FaultKind) -> str:
    given = sorted({a.severity for a in _named(kind)}) or [kind.severity]
    return " or ".join(severity.name for severity in given)


def _letter(kind: FaultKind) -> str:
    given = {a.ne107 for a in _named(kind)} or {kind.ne107}
    return " or ".join(state.letter for state in Ne107 if state in given)


def _heal(kind: FaultKind) -> str:
    return "seen to be absent" if isinf(kind.heal_s) else f"{kind.heal_s:g} s"


def _confirm(kind: FaultKind) -> str:
    parts = [f"{kind.confirm_s:g} s"] if kind.confirm_s else []
    if kind.confirm_count > 1:
        parts.append(f"{kind.confirm_count} events")
    return " and ".join(parts) or "at once"
