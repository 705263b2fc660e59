# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Put what was found in files into words: a configuration that runs, and why."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING

from valve_twin.core.types import CycleRule
from valve_twin.core.valves.registry import get_model
from valve_twin.io.cdr.signals import SERIES_TYPE
from valve_twin.io.config.csv import BASE_STAMP
from valve_twin.io.configure.channels import MOST_FILES, unit_of
from valve_twin.io.offline.propose import (
    EXPLAINED,
    HELD_BACK,
    estimator_lines,
    in_short,
    number_text,
    option_lines,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.survey.repeats import Repeat
    from valve_twin.core.survey.trial import Mapping01
    from valve_twin.io.configure.channels import Survey
    from valve_twin.io.configure.limits import Limit
    from valve_twin.io.configure.survey import Choice

_BATCHED_S = 0.02  # a shorter step is imported in batches [s]
_TIMING = "timing of a signal that repeats, no command recorded"
_SHOWN = 3  # models named in the reasons
_TIE = 1.0  # points of fit by which a black box may be better, assumed [%]
_LIKELY = 50.0  # a free-run fit below deserves a word [%]


def yaml_text(
    survey: Survey, choice: Choice, files: Sequence[str], limits: Sequence[Limit] = ()
) -> str:
    """Return a commented configuration that `import` and `estimate` run with.

    Parameters
    ----------
    survey : Survey
        Channels.
    choice : Choice
        What they are taken for.
    files : sequence of str
        As they were given.
    limits : sequence of Limit
        Service limits by parameter; a parameter without one has none.
    """
    first = survey.recordings[0]
    model, evidence = _model(choice)
    lines = [
        "# Proposed from the data: every value is a guess with its reason; check each before use.",
        f"#   valve-twin import {' '.join(files[:3])}{' ...' if len(files) > 3 else ''} "
        "--config FILE --out BAG",
        "#   valve-twin estimate BAG --config FILE",
        "/**:",
        "  ros__parameters:",
        f"    model: {model}   # {evidence}",
        f"    period_s: {number_text(survey.period_s)}   # {_period(survey)} [s]",
        f"    hold_back_s: {number_text(max(2.0, 5.0 * survey.period_s))}   # {HELD_BACK} [s]",
        "    signals:",
        *_signals(survey, choice),
        "    cycles:",
        f"      rule: {choice.plan.rule.value}   # {choice.plan.reason}",
    ]
    for key, value in choice.plan.values.items():
        text = value if isinstance(value, str) else number_text(value)
        lines.append(f"      {key}: {text}   # {EXPLAINED[key]}")
    lines += _options(choice)
    if choice.repeat is not None and not choice.repeat.command:
        lines += [
            "    aging:",
            f'      label: "{_TIMING}"   # no verdict',
            "      default_percent: 0.0   # no change here is aging until a limit is set [%]",
        ]
    else:
        lines += _limits(limits)
    lines += [
        "    csv:",
        "      reader: any   # every channel of the files lies in the bag, mapped or not",
        f"      time_column: {_quoted(first.time_column)}   # {first.clock}",
        f"      time_scale: {number_text(first.time_scale)}   # seconds in one unit of it",
        f"      gap_s: {number_text(survey.gap_s)}   # pause between two files [s]",
    ]
    if survey.left_out:
        names = json.dumps(list(survey.left_out), ensure_ascii=False)
        lines.append(f"      leave_out: {names}   # unlike the other files")
    if not first.measured and not survey.clock.period_s:
        lines.append("      times_measured: false   # rates and dates are no measurements")
    if survey.clock.resample_s:
        step = number_text(survey.clock.resample_s)
        lines.append(f"      resample_s: {step}   # one grid for all channels [s]")
        if survey.clock.period_s:
            lines.append(f"      row_s: {number_text(survey.clock.period_s)}   # as given [s]")
    if first.start_ns is not None:
        lines.append('      base_stamp: ""   # the dates of the files count')
    else:
        lines.append(f'      base_stamp: "{BASE_STAMP}"   # no date in the file: for time 0')
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _period(survey: Survey) -> str:
    text = f"median step; {100.0 * survey.jitter:.3g} % of the steps are off by a tenth"
    return text if survey.recordings[0].measured else f"NOT MEASURED: {survey.recordings[0].clock}"


def _model(choice: Choice) -> tuple[str, str]:
    if choice.driven is not None:
        why = "two commands drive the rate of a position both ways"
        fits = (
            f"; free run of later cycles {_percent(choice.trials[0].fit)}" if choice.trials else ""
        )
        return choice.driven.model, why + fits
    if choice.repeat is not None:
        known = "limit switches and no position" if choice.repeat.command else "no command"
        return choice.repeat.model, f"{known} recorded; {choice.plan.reason}"
    best, pair = choice.trials[0], choice.pair
    assert pair is not None  # there are trials
    return best.model, (
        f"free run on the half it was not fitted to {_percent(best.fit)}; "
        f"ARX {_percent(pair.arx)}, line through the command {_percent(pair.line)}"
    )


def _percent(fit: float) -> str:
    return f"{fit:.1f} %" if math.isfinite(fit) else "none"


def _signals(survey: Survey, choice: Choice) -> list[str]:
    if choice.driven is not None:
        return [
            line
            for r in choice.driven.roles
            for line in _signal(survey, r.signal, r.source, (r.scale, r.offset), r.evidence)
        ]
    if choice.repeat is not None:
        return _repeat_signals(survey, choice.repeat, choice.plan.reason)
    pair, best = choice.pair, choice.trials[0]
    assert pair is not None  # there are trials
    model = get_model(best.model)
    way = "rises" if pair.correlation > 0.0 else "falls"
    why = f"{way} with the command, most alike {pair.lag} samples later ({pair.correlation:.2f})"
    command = (best.command.scale, best.command.offset)
    lines = _signal(
        survey, model.inputs[0], pair.command, command, _range(survey, pair.command, best.command)
    )
    lines += _signal(
        survey,
        model.output,
        pair.answer,
        (best.answer.scale, best.answer.offset),
        f"{why}; {_range(survey, pair.answer, best.answer)}",
    )
    if choice.plan.rule is CycleRule.REFERENCE:
        lines += _signal(
            survey, "reference", pair.command, command, "the command again: it cuts the cycles",
            topic=_topic(model.inputs[0]),
        )  # fmt: skip
    warm = [k for k, r in survey.roles.items() if r[:1] == ("temperature",)]
    if len(warm) == 1:
        lines += _signal(survey, "temperature", warm[0], (1.0, 0.0), "condition, unit as it is")
    return lines


def _repeat_signals(survey: Survey, repeat: Repeat, reason: str) -> list[str]:
    name = repeat.channel
    mapping = (repeat.scale * survey.sizes[name], repeat.offset)
    why = "1 between the two switches, 0 at each" if repeat.command else reason
    lines = _signal(survey, get_model(repeat.model).output, name, mapping, why)
    if repeat.command:
        lines += _signal(survey, "reference", repeat.command, (1.0, 0.0), "the command: it begins "
                         "each cycle")  # fmt: skip
    return lines


def _range(survey: Survey, name: str, mapping: Mapping01) -> str:
    """Say which values are 0 and 1."""
    zero, one = (0.0 - mapping.offset) / mapping.scale, (1.0 - mapping.offset) / mapping.scale
    return f"0..1 is {zero + 0.0:.5g}..{one:.5g} {unit_of(survey, name)}".rstrip()


def _topic(signal: str) -> str:
    return signal if signal == "command" else f"command/{signal}"


def _signal(
    survey: Survey,
    signal: str,
    column: str,
    mapping: tuple[float, float],
    why: str,
    *,
    topic: str = "",
) -> list[str]:
    lines = [f"      {signal}:   # {why}", f"        topic: {topic or signal}"]
    if survey.period_s < _BATCHED_S:
        lines.append(f"        type: {SERIES_TYPE}")
    return [
        *lines,
        f"        column: {_quoted(column)}",
        f"        scale: {number_text(mapping[0])}   # signal = scale * value + offset",
        f"        offset: {number_text(mapping[1])}",
    ]


def _limits(limits: Sequence[Limit]) -> list[str]:
    set_ = [limit for limit in limits if math.isfinite(limit.percent)]
    lines = [
        "    aging:",
        "      default_percent: 0.0   # no limit but those that the scatter supports [%]",
    ]
    names = ", ".join(x.parameter for x in limits)
    lines += [f"      parameters: [{names}]   # whose aging is followed"] if names else []
    lines += [f"      # {x.parameter}: {x.reason}" for x in limits if x not in set_]
    lines += ["      thresholds:   # change against the reference [%]"] if set_ else []
    for limit in set_:
        lines += [
            f"        {limit.parameter}:",
            f"          value: {limit.percent:.1f}   # {limit.reason}",
            "          either_way: true   # up or down; false: a rise alone, below 0 a fall",
        ]
    return lines


def limit_line(limits: Sequence[Limit]) -> str:
    """Return which service limits are proposed, in one line.

    Parameters
    ----------
    limits : sequence of Limit
        As `justified_limits` gives them.
    """
    told = ", ".join(
        f"{x.parameter} +-{x.percent:.0f} %" for x in limits if math.isfinite(x.percent)
    )
    missing = [x for x in limits if not math.isfinite(x.percent)]
    why = f"; {missing[0].parameter}: {missing[0].reason}" if missing else ""
    more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
    return f"service limits, outside the scatter: {told or 'none set'}{why}{more}"


def _options(choice: Choice) -> list[str]:
    given: dict[str, object] = {}
    if choice.repeat is not None:
        given = dict(choice.repeat.options)
    elif choice.trials:
        given = choice.trials[0].options
    lines = [] if choice.repeat is not None else estimator_lines(_model(choice)[0])
    lines += option_lines(given)
    return ["    options:", *lines] if lines else []


def reasons(survey: Survey, choice: Choice, count: int) -> list[str]:
    """Return why, in about ten lines.

    Parameters
    ----------
    survey : Survey
        Channels.
    choice : Choice
        What they are taken for.
    count : int
        Files that were given.
    """
    first = survey.recordings[0]
    looked = f", of which the first {MOST_FILES} were looked at" if count > MOST_FILES else ""
    channels = len({c.name for c in first.columns} - survey.made.keys())
    lines = [f"files: {count}{looked}; {channels} channels, {len(survey.still)} never change"]
    lines += [f"left out: {text}" for text in survey.refused[:_SHOWN]]
    notices = [text for r in survey.recordings for text in r.notices]
    lines += [f"read with care: {text}" for text in notices[:_SHOWN]]
    measured = "" if first.measured else "NOT MEASURED, rates are as doubtful as this: "
    lines.append(
        f"time: {measured}{first.clock}; {survey.period_s:.6g} s a sample, "
        f"{100.0 * survey.jitter:.2g} % of the steps off by a tenth"
    )
    lines += [f"refused: {text}" for text in list(choice.copies.values())[:_SHOWN]]
    if choice.driven is not None:
        lines += [f"{r.signal}: '{r.source}': {r.evidence}" for r in choice.driven.roles]
        lines += _trial_lines(choice)
    elif choice.repeat is not None and choice.repeat.command:
        lines += [
            f"command: '{choice.repeat.command}' begins each cycle",
            f"signal: '{choice.repeat.channel}': limit switches, no position: the valve moves "
            "where neither is on",
            f"model: {choice.repeat.model}: of each stroke rise_instant is the dead time, decay "
            "the stroke time, close_time that back, valve_lag by how much the middle is later; an "
            "end that is missed twice in a row is a fault",
        ]
    elif choice.repeat is not None:
        lines += [
            f"signal: '{choice.repeat.channel}' {choice.plan.reason}",
            f"model: {choice.repeat.model}: no command is recorded, so only timing and level of "
            "each cycle are followed",
        ]
        if not choice.repeat.options:
            lines.append(
                "doubt: the mean cycle ends in no steady part, so cycles will be refused; set "
                f"the windows of {choice.repeat.model} under options by hand"
            )
    else:
        lines += _pair_lines(survey, choice)
    lines.append(f"cycles: rule {choice.plan.rule.value}: {choice.plan.reason}")
    return lines


def not_proposed(choice: Choice) -> str:
    """Return why the best model is no proposal and what to do, empty where it is one.

    Parameters
    ----------
    choice : Choice
        What the channels are taken for.
    """
    if not choice.trials or not choice.trials[0].fit <= 0.0:
        return ""
    best, pair = choice.trials[0], choice.pair
    assert pair is not None  # there are trials
    return (
        f"nothing is proposed: the best model ({best.model}) follows '{pair.answer}' worse than "
        f"its mean does (free run {_percent(best.fit)}); record steps of several sizes with rests "
        "between, without what was changed by hand meanwhile, or name the channel that answers "
        "with --position"
    )


def _black_box(choice: Choice) -> str:
    if choice.baseline is None:
        return ""
    return f", a black box ({choice.baseline.model}) {_percent(choice.baseline.fit)}"


def _pair_lines(survey: Survey, choice: Choice) -> list[str]:
    pair, best = choice.pair, choice.trials[0]
    assert pair is not None  # there are trials
    how = "names and data" if pair.named else "data alone: no name says so"
    lines = [
        f"command: '{pair.command}' ({_range(survey, pair.command, best.command)}), by {how}",
        f"answer: '{pair.answer}' ({_range(survey, pair.answer, best.answer)}), "
        f"most alike {pair.lag} samples later, correlation {pair.correlation:.2f}",
    ]
    if choice.others:
        near = ", ".join(
            f"'{p.command}' -> '{p.answer}' (ARX {_percent(p.arx)})" for p in choice.others
        )
        lines.append(f"other pairs: {near}")
    return lines + _trial_lines(choice)


def _trial_lines(choice: Choice) -> list[str]:
    """Say how well the models followed that were tried, and why the choice is in doubt."""
    pair = choice.pair
    if pair is None:
        return ["doubt: too few cycles to hold any model against; give a longer part"]
    best, halves = choice.trials[0], choice.halves
    tried: dict[str, tuple[float, str]] = {}
    for trial in choice.trials:
        tried.setdefault(trial.model, (trial.fit, trial.reason))
    told = ", ".join(
        f"{name} {_percent(fit)}" + (f" ({in_short(why)})" if why else "")
        for name, (fit, why) in tried.items()
    )
    on = "each later cycle" if halves and halves.begins else "the half that was not fitted"
    lines = [
        f"models, free run on {on}: {told}; beside them ARX "
        f"{_percent(pair.arx)}, a line through the command {_percent(pair.line)}"
        f"{_black_box(choice)}"
    ]
    rival = next((t for t in choice.trials if t.fit > best.fit), None)
    if choice.driven is not None and rival is not None:
        lines.append(
            f"doubt: {rival.model} follows as well: where the commands move a cylinder, a tank "
            f"or a drive, take it with '{pair.command}'"
        )
    if halves is not None and halves.doubt:
        lines.append(f"doubt: {halves.doubt}")
    box = choice.baseline.fit if choice.baseline is not None else math.nan
    beside = (pair.arx, pair.line, box - _TIE, 0.0)
    peer = max((f for f in beside if math.isfinite(f)), default=0.0)
    if not best.fit > peer:
        lines.append(
            f"doubt: {best.model} follows no better than its baselines; a longer part with steps "
            "of several sizes would tell more"
        )
    elif best.fit < _LIKELY:
        lines.append(f"doubt: {best.model} leaves much of the answer unexplained")
    return lines
