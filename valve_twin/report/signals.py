# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""All measured signals of a cycle in their units, those of one kind in one pair of axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.interface import Scale
from valve_twin.report.svg import Panel, drawing, thin

if TYPE_CHECKING:
    from collections.abc import Sequence

    from markupsafe import Markup

    from valve_twin.core.types import Cycle, FloatArray, IntArray
    from valve_twin.core.valves.interface import Options, ValveModel

_BINS = 400
_LEFT, _RIGHT, _HEIGHT, _GAP, _HEAD = 64.0, 944.0, 110.0, 52.0, 38.0
_COLOURS = 5  # classes s0 .. s4 of the style sheet
_LETTER = 7.2  # mean width of a letter of a label [1]


@dataclass(frozen=True, slots=True)
class Signal:
    """A signal as it is shown: name, scale, values (N,) in its unit."""

    name: str
    scale: Scale
    values: FloatArray


def signals_of(cycle: Cycle, model: ValveModel, options: Options) -> tuple[Signal, ...]:
    """Return position and commands of a cycle in their units, the position first.

    Parameters
    ----------
    cycle : Cycle
        Its samples.
    model : ValveModel
        Tells the names and scales.
    options : dataclass
        The model's options.
    """
    scales = model.scales(options)
    columns = [cycle.frames.position, *cycle.frames.inputs.T]
    found = []
    for name, values in zip((model.output, *model.inputs), columns, strict=True):
        scale = scales.get(name, Scale("1" if model.normalised else ""))
        found.append(Signal(name, scale, scale.zero + scale.size * values))
    return tuple(found)


def plot_signals(stamp_ns: IntArray, signals: Sequence[Signal]) -> Markup:
    """Draw signals over time, one pair of axes for each unit and full scale.

    Parameters
    ----------
    stamp_ns : (N,) array
        Stamps [ns], N >= 2.
    signals : sequence of Signal
        What is drawn, in its order.

    Returns
    -------
    Markup
        SVG element.
    """
    t = (stamp_ns - stamp_ns[0]) / 1e9
    groups: dict[tuple[object, ...], list[Signal]] = {}
    for signal in signals:
        unit = signal.scale.unit
        groups.setdefault((unit, signal.scale.size) if unit else (signal.name,), []).append(signal)
    parts: list[str] = []
    for row, group in enumerate(groups.values()):
        top = _HEAD + row * (_HEIGHT + _GAP)
        panel = Panel(_LEFT, top, _RIGHT - _LEFT, _HEIGHT, (0.0, float(t[-1])), _range(group))
        last = row == len(groups) - 1
        panel.axes(
            x_label="time since the start of the cycle [s]", x_texts=last, x_ticks=8, y_ticks=4
        )
        _head(panel, group)
        for colour, signal in enumerate(group):
            panel.line(*thin(t, signal.values, _BINS), f"signal s{colour % _COLOURS}")
        parts += panel.parts
    height = _HEAD + len(groups) * (_HEIGHT + _GAP)
    return drawing(960.0, height, parts, "Measured signals over the cycle", "wide")


def _head(panel: Panel, group: Sequence[Signal]) -> None:
    """Write unit and ends, then the names in the colours of their lines."""
    scale = group[0].scale
    x, y = panel.left, panel.top - 9.0
    for colour, signal in enumerate(group):
        panel.text(x, y, signal.name, f"head t{colour % _COLOURS}")
        x += _LETTER * len(signal.name) + 12.0
    words = f"[{scale.unit}]" if scale.unit else "as configured"
    panel.text(x, y, f"{words}{'; ' if scale.ends else ''}{scale.ends}", "label")


def _range(group: Sequence[Signal]) -> tuple[float, float]:
    values = np.concatenate([s.values for s in group])
    values = values[np.isfinite(values)]
    if not len(values):
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    half = max(0.5 * (high - low), 0.01 * abs(low + high), 1e-9)
    middle = 0.5 * (low + high)
    return middle - 1.08 * half, middle + 1.08 * half
