# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A valve ready to become an FMU: its law with the values that its history knows."""

from __future__ import annotations

import re
import uuid
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING

from valve_twin import __version__
from valve_twin.core.quantity import suggest
from valve_twin.core.types import EstimateStatus, ParameterStatus
from valve_twin.core.valves.kit import Lawful
from valve_twin.core.valves.registry import get_model, model_names
from valve_twin.gateway.fmu.c_code import Translation
from valve_twin.gateway.fmu.c_kinds import DOUBLE, Array, number
from valve_twin.io.errors import FmuError
from valve_twin.report.text import utc

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import Estimate, ParameterValue
    from valve_twin.core.valves.kit.law import Law, LawParameter
    from valve_twin.io.history.store import History
    from valve_twin.io.history.tables import CycleRecord

_NS = 1e-9
_SPACE = uuid.UUID("6f1c8a52-5f0d-4f5b-9a3e-0d7a3c2b9e11")  # of the tokens of our FMUs


@dataclass(frozen=True, slots=True)
class Quantity:
    """One variable of the FMU.

    Attributes
    ----------
    name, unit, text : str
        Name, SI unit ("1" = dimensionless), one line.
    start : float
        Value at the start [unit].
    lower, upper : float
        Limits that are stated, NaN = none [unit].
    """

    name: str
    unit: str
    text: str
    start: float
    lower: float = float("nan")
    upper: float = float("nan")


@dataclass(frozen=True, slots=True)
class FmuValve:
    """Everything that an FMU says.

    Attributes
    ----------
    identifier, token : str
        Name of its binary, and what tells this FMU from others.
    text : str
        Where its values come from, in one line.
    version : str
        Cycle and software that made it.
    made : str
        Last stamp of its cycle, ISO 8601: the same history gives the same bytes.
    code : str
        law.h.
    period_s, stop_s : float
        Sampling time and length of the cycle [s].
    inputs, parameters, states : tuples of Quantity
        The M inputs, the P parameters, the S - 1 states that are not measured.
    output, first, delay : Quantity
        What is measured, where it starts, and after which time an input acts [s].
    """

    identifier: str
    token: str
    text: str
    version: str
    made: str
    code: str
    period_s: float
    stop_s: float
    inputs: tuple[Quantity, ...]
    parameters: tuple[Quantity, ...]
    states: tuple[Quantity, ...]
    output: Quantity
    first: Quantity
    delay: Quantity

    @property
    def variables(self) -> tuple[Quantity, ...]:
        """All in the order of their value references, from 1 on: time is 0."""
        ends = (self.output, self.first, *self.parameters)
        return (*self.inputs, *ends, *self.states, self.delay)


def law_of(model: str) -> Lawful:
    """Return a valve that has a law.

    Raises
    ------
    FmuError
        If the model has none, or is unknown; says which have.
    """
    try:
        found = get_model(model)
    except ValueError as err:
        msg = f"model {err}"
        raise FmuError(msg) from err
    if isinstance(found, Lawful):
        return found
    fit = [n for n in model_names() if isinstance(get_model(n), Lawful)]
    msg = (
        f"model '{model}' has no law of one sample (core/valves/kit), nothing to translate "
        f"into C; those that are: {', '.join(fit)}, and every valve that a package adds by the kit"
    )
    raise FmuError(msg)


def stored_estimate(history: History, valve: str, cycle: int) -> tuple[Estimate, CycleRecord]:
    """Return the estimate of a cycle that feeds the trend, and the record of the cycle.

    Parameters
    ----------
    history : History
        Where it is stored.
    valve : str
        Name of the valve.
    cycle : int
        Number of the cycle; 0 = the newest that has a usable estimate.

    Raises
    ------
    FmuError
        If there is no such valve, its model is no law, there is no such cycle, or its estimate was
        refused; one line.
    """
    name = "/" + valve.strip("/")
    known = history.valves()
    if name not in known:
        msg = f"{history.where}: there is no valve '{name}'; {suggest(name, known)}"
        raise FmuError(msg)
    first = cycle or 0
    found = [
        e
        for e in history.estimates(name, first_cycle=first)
        if e.estimator == law_of(e.model).trend_estimator and (not cycle or e.cycle == cycle)
    ]
    usable = [e for e in found if e.status is not EstimateStatus.REFUSED]
    if not usable:
        what = f"cycle {cycle}" if cycle else "any cycle"
        why = f": {found[-1].reason}" if found else ""
        msg = (
            f"{history.where}: {name} has no usable estimate of {what}{why}; "
            f"its last cycle is {history.last_cycle(name)}, choose another --cycle"
        )
        raise FmuError(msg)
    estimate = usable[-1]
    record = next(
        (c for c in history.cycles(name, first_cycle=estimate.cycle) if c.cycle == estimate.cycle),
        None,
    )
    if record is None:
        msg = f"{history.where}: {name} has an estimate of cycle {estimate.cycle} without a cycle"
        raise FmuError(msg)
    return estimate, record


def valve_of(
    where: str, name: str, estimate: Estimate, record: CycleRecord, period_s: float = 0.0
) -> FmuValve:
    """Return the valve as one cycle knows it.

    Parameters
    ----------
    where, name : str
        History and valve, as they are told in its description.
    estimate, record : Estimate, CycleRecord
        Values and cycle.
    period_s : float
        Sampling time of law and lag [s]; 0 = that of the stamps of the cycle.

    Raises
    ------
    FmuError
        If the model is no law, the law has no translation, or a value is missing.
    """
    valve = law_of(estimate.model)
    law = valve.law
    period = period_s or _period(record)
    taken = _taken(valve, estimate, period)
    parameters = tuple(_parameter(p, estimate, taken) for p in law.parameters)
    found = valve.law_lag(_known(estimate), estimate.lag, period)
    lag = max(found, 1)
    least = "" if found else " (found 0: held inputs act one sample later at the earliest)"
    unit = "1" if valve.normalised else ""
    inputs = tuple(Quantity(n, unit, "held over a sample", 0.0) for n in valve.inputs)
    output = Quantity(valve.output, unit, "as measured, without noise", 0.0)
    first = Quantity(f"{valve.output}_start", unit, "where the output starts", 0.0)
    states = tuple(
        Quantity(f"state_{i}", "", "of the law, not measured", 0.0) for i in range(1, law.states)
    )
    delay = Quantity("input_delay", "s", "from a sample of the inputs to its effect", lag * period)
    code = _code(law, inputs, parameters, period, lag)
    made = utc(record.end_ns).strftime("%Y-%m-%dT%H:%M:%SZ")
    source = "given" if period_s else "from the stamps of the cycle"
    text = (
        f"{name} as estimated from cycle {estimate.cycle} ({made}) of {where}: model "
        f"{estimate.model}, estimator {estimate.estimator}, sampling time {period!r} s "
        f"({source}), lag {lag} samples{least}; min and max of a parameter are its 95 % interval; "
        f"valve_twin {__version__}"
    )
    text = text.encode("utf-8", "backslashreplace").decode()  # names of bytes that are no text
    starts = [repr(q.start) for q in (*inputs, output, first, *parameters, *states, delay)]
    names = [f'"{q.name}"' for q in (*inputs, output, first, *parameters, *states, delay)]
    token = "{" + str(uuid.uuid5(_SPACE, "\n".join([code, text, *starts]))) + "}"
    code += (
        f'\n#define VT_TOKEN "{token}"\n'
        f"static const double vt_start[] = {{0.0, {', '.join(starts)}}};\n"
        f'static const char *const vt_names[] = {{"time", {", ".join(names)}}};\n\n#endif\n'
    )
    return FmuValve(
        identifier=_identifier(name),
        token=token,
        text=text,
        version=f"cycle {estimate.cycle}",
        made=made,
        code=code,
        period_s=period,
        stop_s=(record.end_ns - record.start_ns) * _NS,
        inputs=inputs,
        parameters=parameters,
        states=states,
        output=output,
        first=first,
        delay=delay,
    )


def _period(record: CycleRecord) -> float:
    steps = record.samples + record.lost - 1
    if steps < 1:
        msg = (
            f"cycle {record.cycle} has {record.samples} samples: give the sampling time, --period"
        )
        raise FmuError(msg)
    return float(f"{(record.end_ns - record.start_ns) * _NS / steps:.9g}")


def _taken(valve: Lawful, estimate: Estimate, period_s: float) -> Mapping[str, float]:
    """Return what the valve's prediction takes for parameters that a cycle does not show."""
    try:
        return valve.law_values(_known(estimate), period_s)
    except ValueError as err:
        msg = f"cycle {estimate.cycle}: {err}; a valve without these options can be exported"
        raise FmuError(msg) from err


def _known(estimate: Estimate) -> dict[str, float]:
    return {p.name: p.value for p in estimate.parameters if isfinite(p.value)}


def _parameter(
    parameter: LawParameter, estimate: Estimate, taken: Mapping[str, float]
) -> Quantity:
    published = parameter.published
    name, unit, text = published.name, published.unit, published.description
    found = next((p for p in estimate.parameters if p.name == name), None)
    if found is not None and isfinite(found.value):
        lower, upper = _interval(found, published.lower, published.upper)
        return Quantity(name, unit, text, found.value, lower, upper)
    why = f": {found.reason}" if found else ""
    if name not in taken:
        msg = f"cycle {estimate.cycle}: {name} is not known{why}; choose another cycle, --cycle"
        raise FmuError(msg)
    text = f"{text}; not shown by the cycle{why}, as the prediction takes it" if found else text
    return Quantity(name, unit, text, taken[name], published.lower, published.upper)


def _interval(found: ParameterValue, lower: float, upper: float) -> tuple[float, float]:
    """Return the 95 % interval; what rests on a bound or has none gets the law's bounds."""
    low, high = found.lower_95, found.upper_95
    if found.status is not ParameterStatus.OK or not (isfinite(low) and isfinite(high)):
        return lower, upper
    return min(low, found.value), max(high, found.value)


def _identifier(name: str) -> str:
    plain = re.sub(r"\W", "_", name.strip("/"), flags=re.ASCII)
    return f"valve_{plain}" if not plain or plain[0].isdigit() else plain


def _code(
    law: Law,
    inputs: tuple[Quantity, ...],
    parameters: tuple[Quantity, ...],
    period_s: float,
    lag: int,
) -> str:
    """Return law.h up to what depends on the values."""
    x, u, p = Array(law.states), Array(len(inputs)), Array(len(parameters))
    translation = Translation()
    step = translation.add(law.step, (x, u, p, DOUBLE)).name
    rest = translation.add(law.rest, (x, u, p)).name if law.rest else ""
    bounds = [(q.published.lower, q.published.upper) for q in law.parameters]
    low, high = (
        ", ".join(number(float(b)).code for b in ends) for ends in zip(*bounds, strict=True)
    )
    return f"""\
/* Written by valve_twin {__version__} from the law of a valve. */
#ifndef VT_LAW_H
#define VT_LAW_H

{translation.text()}
#define VT_STATES {law.states}
#define VT_INPUTS {len(inputs)}
#define VT_PARAMETERS {len(parameters)}
#define VT_LAG {lag}
#define VT_PERIOD {period_s!r}

static void vt_step(double *x, double *u, double *p) {{ {step}(x, u, p, VT_PERIOD); }}
static void vt_rest(double *x, double *u, double *p)
{{
    (void)x, (void)u, (void)p;
    {f"{rest}(x, u, p);" if rest else ""}
}}
static const double vt_lower[] = {{{low}}}, vt_upper[] = {{{high}}}; /* of the law */
"""
