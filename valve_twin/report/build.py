# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Fill the report from a record that was just estimated, or from the history."""

from __future__ import annotations

import math
import statistics
import time
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from valve_twin import __version__
from valve_twin.core.aging.assess import assess
from valve_twin.core.operation.step_metrics import measure_steps
from valve_twin.core.operation.stroke_due import stroke_due
from valve_twin.core.quantity import describe, example, listed
from valve_twin.core.valves.registry import get_model
from valve_twin.io.errors import StoreError
from valve_twin.io.history.store import History
from valve_twin.io.history.tiers.extent import condensed
from valve_twin.io.history.tiers.reading import (
    condensates,
    condensed_refused,
    undisturbed,
    whole_past,
)
from valve_twin.io.offline.baseline import compare_baselines
from valve_twin.io.offline.run import join_predictions
from valve_twin.io.offline.sources import NOT_MEASURED
from valve_twin.io.tables.json_lines import FILES
from valve_twin.io.uncollected import uncollected
from valve_twin.report.data import ReportData
from valve_twin.report.page import write_report
from valve_twin.report.provenance.inputs import bag_origin, history_origin
from valve_twin.report.provenance.record import Provenance, configuration_text, versions
from valve_twin.report.signals import signals_of

if TYPE_CHECKING:
    from pathlib import Path

    from valve_twin.core.aging.assess import Assessment
    from valve_twin.core.aging.config import AgingConfig
    from valve_twin.core.valves.error_budget import Budget
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.io.offline.run import Record
    from valve_twin.report.provenance.record import Origin


def bag_data(
    config: ValveConfig,
    bag: str | Path,
    record: Record,
    assessment: Assessment,
    label: str = "",
    *,
    budget: Budget | None = None,
) -> ReportData:
    """Return what the page of an estimated bag shows.

    Parameters
    ----------
    config : ValveConfig
        The valve's configuration.
    bag : path
        Where the record comes from.
    record : Record
        What was found in it.
    assessment : Assessment
        Its trends and verdict.
    label : str
        What the axis is where it is not aging, default `aging.label` of the configuration.
    budget : Budget, optional
        Its error budget, to be shown as well.

    Returns
    -------
    ReportData
        Of this moment, without provenance.
    """
    model = get_model(config.model)
    return ReportData(
        valve=config.name,
        model=config.model,
        source=str(bag),
        parameters=model.parameters,
        cycles=tuple(record.cycles),
        estimates=tuple(record.estimates),
        assessment=assessment,
        prediction=join_predictions(record.predictions),
        label=label or config.aging.label,
        options={d.name: example(d.default) for d in describe(config.options)},
        version=__version__,
        written_ns=time.time_ns(),
        notes=(*trivial_note(record), *baseline_note(record)),
        warning=_warning(config),
        budget=budget,
        cycle=record.last,
        signals=signals_of(record.last, model, config.options) if record.last else (),
        counters=record.counters,
        steps=tuple(step for c in record.newest for step in measure_steps(c, model.inputs)),
        files={cycle: listed(names, FILES) for cycle, names in record.files.items()},
        nameplate=config.nameplate.given,
    )


def report_bag(
    config: ValveConfig,
    bag: str | Path,
    record: Record,
    assessment: Assessment,
    out: str | Path,
    label: str = "",
    *,
    budget: Budget | None = None,
    language: str = "en",
) -> Path:
    """Write the page of an estimated bag, with its provenance.

    Parameters
    ----------
    config, bag, record, assessment, label, budget
        As of `bag_data`.
    out : path
        Page to write.
    language : str
        Its code.

    Returns
    -------
    Path
        The page.
    """
    data = bag_data(config, bag, record, assessment, label, budget=budget)
    data = replace(data, language=language)
    return _write(config, data, bag_origin(config, bag), label, out)


def trivial_note(record: Record) -> tuple[str, ...]:
    """Say what the trivial model "position = command" reaches beside ours, if there is one.

    Compares over the same cycles: those on which an earlier estimate was tested.
    """
    pairs = [
        (e.fit_test, record.trivial_fits.get(e.cycle, math.nan))
        for e in record.estimates
        if e.used_by_trend
    ]
    both = [(ours, trivial) for ours, trivial in pairs if math.isfinite(ours + trivial)]
    if not both:
        return ()
    ours, trivial = (statistics.median(column) for column in zip(*both, strict=True))
    return (
        f"Fit of the free run, test (estimate of the cycle before), median of {len(both)} cycles: "
        f"{ours:.1f} %. The trivial model, position = command, reaches {trivial:.1f} % there.",
    )


def baseline_note(record: Record) -> tuple[str, ...]:
    """Say what ARX and a line through the inputs reach beside our model."""
    compared = compare_baselines(record)
    return () if compared is None else (compared.text,)


def report_history(
    config: ValveConfig,
    out: str | Path,
    label: str = "",
    *,
    budget: Budget | None = None,
    language: str = "en",
) -> Path:
    """Write the page of what the history holds about a valve; it keeps no samples.

    Parameters
    ----------
    config : ValveConfig
        The valve's configuration; its history is read.
    out : path
        Page to write.
    label, budget
        As of `bag_data`.
    language : str
        Its code.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    StoreError
        If the history cannot be read or does not know the valve.
    """
    data = configured_history_data(config, label, budget=budget)
    data = replace(data, language=language)
    return _write(config, data, history_origin(data), label, out)


def configured_history_data(
    config: ValveConfig, label: str = "", *, budget: Budget | None = None
) -> ReportData:
    """Return what the page of a configured valve shows of its history, without provenance.

    Parameters
    ----------
    config : ValveConfig
        The valve's configuration; its history is read.
    label, budget
        As of `bag_data`.

    Raises
    ------
    StoreError
        If the history cannot be read or does not know the valve.
    """
    with History(config.history_url, read_only=True) as history:
        data = history_data(history, config.name, config.aging, label, config.model)
    options = {d.name: example(d.default) for d in describe(config.options)}
    return replace(
        data,
        options=options,
        budget=budget,
        nameplate=config.nameplate.given,
        warning=_warning(config),
    )


def _warning(config: ValveConfig) -> str:
    return "" if config.csv.times_measured else NOT_MEASURED


def _write(
    config: ValveConfig, data: ReportData, origin: Origin, label: str, out: str | Path
) -> Path:
    """Write a page with what it is made from."""
    made = Provenance(
        valve=config.name,
        origin=origin,
        configuration=configuration_text(config),
        label=label,
        budget=data.budget is not None,
        versions=versions(),
        written_ns=data.written_ns,
    )
    return write_report(replace(data, provenance=made.text), out)


def history_data(
    history: History, valve: str, aging: AgingConfig, label: str = "", model: str = ""
) -> ReportData:
    """Return what a history holds about a valve, for its page.

    Parameters
    ----------
    history : History
        Where it is stored.
    valve : str
        Its name.
    aging : AgingConfig
        Rules of aging.
    label : str
        As of `bag_data`.
    model : str
        Its model, default that of its newest estimate.

    Raises
    ------
    StoreError
        If the history cannot be read or does not know the valve.
    ValueError
        If its model is not known here.
    """
    if valve not in history.valves():
        known = ", ".join(history.valves()) or "no valve"
        msg = f"{history.where}: knows nothing about {valve}; it holds {known}"
        raise StoreError(msg)
    with uncollected():
        data = undisturbed(history, valve, partial(_read, history, valve, aging, model))
    return replace(data, label=label or aging.label)


def _read(history: History, valve: str, aging: AgingConfig, model: str) -> ReportData:
    estimates = history.estimates(valve)
    maintenance = history.maintenance(valve)
    name = model or (estimates[-1].model if estimates else "")
    parameters = get_model(name).parameters if name else ()
    cycles, events = tuple(history.cycles(valve)), tuple(history.log.events(valve))
    past = whole_past(history, valve, estimates)
    of = next((e.estimator for e in reversed(estimates) if e.used_by_trend), "")
    return ReportData(
        valve=valve,
        model=name,
        source=history.where,
        parameters=parameters,
        cycles=cycles,
        estimates=tuple(estimates),
        assessment=assess(past, maintenance, aging, parameters=parameters, valve=valve),
        maintenance=tuple(maintenance),
        counters=history.log.counters(valve),
        events=events,
        stroke_due=stroke_due(events, cycles[-1].end_ns if cycles else 0, aging.stroke_test_days),
        version=__version__,
        written_ns=time.time_ns(),
        condensed=condensed(history, valve),
        condensed_refused=condensed_refused(history, valve),
        condensates=tuple(condensates(history, valve, estimator=of)),
    )
