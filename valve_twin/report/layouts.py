# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Layouts for PlotJuggler and Foxglove, generated from the message definitions.

Every plotted field is looked up in the .msg files: a field that was renamed or is not a number
stops the generation instead of leaving an empty plot on a user's screen.

    python -m valve_twin.report.layouts msg_defs/msg layouts [/press/valve_1 [MODEL]]
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg

from valve_twin.core.valves.registry import DEFAULT_MODEL, get_model
from valve_twin.io.whole import write_whole
from valve_twin.report.text import render

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.valves.interface import ValveModel

_COLOURS = ("#1b2026", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#7a4f00", "#e69f00")


@dataclass(frozen=True, slots=True)
class Curve:
    """A field of a message on a topic.

    Attributes
    ----------
    message, topic, field : str
        Message type of valve_twin_msgs, topic relative to the valve, numeric field.
    """

    message: str
    topic: str
    field: str


@dataclass(frozen=True, slots=True)
class Plot:
    """Curves that share a plot."""

    title: str
    curves: tuple[Curve, ...]


@dataclass(frozen=True, slots=True)
class Tab:
    """Plots below each other on one page; `states` are shown as coloured words where possible."""

    title: str
    plots: tuple[Plot, ...]
    states: tuple[Curve, ...] = ()


def _curves(message: str, topic: str, *fields: str) -> tuple[Curve, ...]:
    return tuple(Curve(message, topic, field) for field in fields)


def tabs(model: ValveModel) -> tuple[Tab, ...]:
    """Return what is shown of a valve: the running cycle, the estimates, the aging trends."""
    prediction = ("Prediction", "twin/prediction")
    estimate = ("Estimate", "twin/estimate")
    commands = tuple(Curve("Float64Stamped", f"command/{name}", "value") for name in model.inputs)
    position = (
        Plot("Position [1]", _curves(*prediction, "measured", "predicted", "simulated")),
        Plot("Residual [1]", _curves(*prediction, "residual", "residual_sigma")),
        Plot("Commands [1]", commands),
    )
    quality = (
        Plot("Free-run fit [%]", _curves(*estimate, "fit_test", "fit_train")),
        Plot("One-step mean squared error [1]", _curves(*estimate, "mse_test", "mse_train")),
        Plot("Noise at rest [1]", _curves(*estimate, "noise_sigma")),
        Plot(
            "Samples",
            _curves(
                *estimate,
                "samples_used",
                "samples_masked_seat",
                "samples_masked_stuck",
                "samples_masked_stale",
            ),
        ),
    )
    return (
        Tab("Cycle", position, _curves(*prediction, "validity")),
        Tab("Estimates", quality, _curves(*estimate, "status")),
        *(_trend_tab(p.name) for p in model.parameters if p.trend),
    )


def _trend_tab(parameter: str) -> Tab:
    trend = ("Trend", f"aging_monitor/trend/{parameter}")
    level = _curves(
        *trend,
        "level",
        "mean_lower_95",
        "mean_upper_95",
        "prediction_lower_95",
        "prediction_upper_95",
        "reference",
        "threshold",
        "warning",
    )
    drift = _curves(
        *trend, "drift_reference", "drift_reference_lower_95", "drift_reference_upper_95"
    )
    remaining = _curves(*trend, "remaining_low", "remaining_median", "remaining_high")
    return Tab(
        parameter,
        (
            Plot(f"{parameter}: level and intervals", level),
            Plot(f"{parameter}: drift against new [%]", drift),
            Plot(f"{parameter}: remaining until the service limit", remaining),
        ),
        (*_curves(*trend, "status"), Curve("Verdict", "aging_monitor/verdict", "verdict")),
    )


def numeric_fields(text: str) -> frozenset[str]:
    """Return the names of the fields of a .msg text that hold one number.

    Parameters
    ----------
    text : str
        Content of a .msg file.
    """
    name = "valve_twin_msgs/msg/Message"
    _, fields = get_types_from_msg(text, name)[name]
    return frozenset(
        field for field, (node, kind) in fields if node is Nodetype.BASE and kind[0] != "string"
    )


def read_definitions(folder: str | Path) -> dict[str, frozenset[str]]:
    """Return the numeric fields of every .msg file of a folder, by message name."""
    files = sorted(Path(folder).glob("*.msg"))
    return {file.stem: numeric_fields(file.read_text(encoding="utf-8")) for file in files}


def check(pages: Sequence[Tab], definitions: Mapping[str, frozenset[str]]) -> None:
    """Refuse curves that no message has.

    Raises
    ------
    ValueError
        With the message, the field and the numeric fields that there are.
    """
    for page in pages:
        for curve in (*(c for plot in page.plots for c in plot.curves), *page.states):
            fields = definitions.get(curve.message)
            if fields is None:
                msg = f"layout '{page.title}': there is no message {curve.message}"
                raise ValueError(msg)
            if curve.field not in fields:
                known = ", ".join(sorted(fields))
                msg = (
                    f"layout '{page.title}': {curve.message} has no numeric field "
                    f"'{curve.field}'; there are {known}"
                )
                raise ValueError(msg)


def plotjuggler(pages: Sequence[Tab], valve: str) -> str:
    """Return the layout for PlotJuggler (XML)."""
    shown = [
        (page.title, [*page.plots, *([Plot("State", page.states)] if page.states else [])])
        for page in pages
    ]
    return f"{render('plotjuggler.xml', pages=shown, valve=valve, coloured=_coloured)}\n"


def _coloured(plot: Plot) -> list[tuple[Curve, str]]:
    return list(zip(plot.curves, _COLOURS, strict=False))


def foxglove(pages: Sequence[Tab], valve: str) -> str:
    """Return the layout for Foxglove (JSON)."""
    panels: dict[str, object] = {}
    tab_list = []
    for number, page in enumerate(pages):
        ids = []
        for k, plot in enumerate(page.plots):
            ids.append(f"Plot!{number}p{k}")
            panels[ids[-1]] = _foxglove_plot(plot, valve)
        if page.states:
            ids.append(f"StateTransitions!{number}s")
            panels[ids[-1]] = {
                "foxglovePanelTitle": "State",
                "isSynced": True,
                "paths": [_foxglove_path(c, valve) for c in page.states],
            }
        tab_list.append({"title": page.title, "layout": _column(ids)})
    panels["Tab!pages"] = {"activeTabIdx": 0, "tabs": tab_list}
    panels["DiagnosticSummary!all"] = {
        "minLevel": 0,
        "pinnedIds": [],
        "hardwareIdFilter": "",
        "topicToRender": "/diagnostics",
        "sortByLevel": True,
    }
    layout = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row",
            "first": "Tab!pages",
            "second": "DiagnosticSummary!all",
            "splitPercentage": 78,
        },
    }
    return json.dumps(layout, indent=1) + "\n"


def _foxglove_plot(plot: Plot, valve: str) -> dict[str, object]:
    return {
        "foxglovePanelTitle": plot.title,
        "paths": [{**_foxglove_path(c, valve), "color": colour} for c, colour in _coloured(plot)],
        "xAxisVal": "timestamp",
        "isSynced": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "showPlotValuesInLegend": False,
        "showXAxisLabels": True,
        "showYAxisLabels": True,
    }


def _foxglove_path(curve: Curve, valve: str) -> dict[str, object]:
    return {
        "value": f"{valve}/{curve.topic}.{curve.field}",
        "label": f"{curve.topic.rsplit('/', 1)[-1]} {curve.field}".replace("_", " "),
        "enabled": True,
        "timestampMethod": "headerStamp",
    }


def _column(ids: Sequence[str]) -> object:
    """Return panels below each other, all of one height."""
    if len(ids) == 1:
        return ids[0]
    share = round(100 / len(ids), 3)
    return {
        "direction": "column",
        "first": ids[0],
        "second": _column(ids[1:]),
        "splitPercentage": share,
    }


def write_layouts(
    messages: str | Path, out: str | Path, valve: str = "", model: str = DEFAULT_MODEL
) -> list[Path]:
    """Write both layouts.

    Parameters
    ----------
    messages : str or Path
        Folder of the .msg files.
    out : str or Path
        Folder for plotjuggler.xml and foxglove.json.
    valve : str
        Namespace of the valve; empty = that of its demonstration. It can be replaced in the files.
    model : str
        Its model, whose commands and trended parameters are shown.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    ValueError
        If a plotted field is not a number of its message, or there is no such model.
    """
    shown = get_model(model)
    pages, valve = tabs(shown), valve or shown.demonstration.namespace or f"/{model}/valve_1"
    check(pages, read_definitions(messages))
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    texts = {"plotjuggler.xml": plotjuggler(pages, valve), "foxglove.json": foxglove(pages, valve)}
    for name, text in texts.items():
        write_whole(folder / name, text)
    return [folder / name for name in texts]


if __name__ == "__main__":
    write_layouts(*sys.argv[1:5])
