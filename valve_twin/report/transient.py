# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The picture of a transient field: currents, force with and without eddy currents, heat."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from valve_twin.report.svg import Panel, drawing

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

_Rows: TypeAlias = "tuple[tuple[str, tuple[tuple[FloatArray, FloatArray, str], ...]], ...]"

_WIDTH, _ROW = 760.0, 190.0
_STYLE = """<style>
svg { font: 12px sans-serif; fill: #1b2026; } path { fill: none; }
.tick, .label { fill: #545d68; } .end { text-anchor: end; } .mid { text-anchor: middle; }
.grid { stroke: #e4e7eb; } .axis { stroke: #8a929b; } .a { stroke: #0072b2; stroke-width: 1.6; }
.b { stroke: #c2500a; stroke-width: 1.4; stroke-dasharray: 5 3; }
</style>
<rect width="100%" height="100%" fill="#fff"/>"""


def draw_transient(
    time_s: FloatArray,
    current: FloatArray,
    force: FloatArray,
    static: tuple[FloatArray, FloatArray],
    joule: FloatArray,
) -> str:
    """Return the picture as an SVG document.

    Parameters
    ----------
    time_s, current, force, joule : (T,) arrays
        Times [s], current of the first coil [A], force [N] and heat of the eddy currents [W].
    static : pair of (S,) arrays
        Times [s] and force without eddy currents [N].
    """
    ms = 1e3 * time_s
    rows: _Rows = (
        ("current [A]", ((ms, current, "a"),)),
        ("force [N]; dashed: static", ((ms, force, "a"), (1e3 * static[0], static[1], "b"))),
        ("eddy currents [W]", ((ms[1:], joule[1:], "a"),)),
    )
    return _drawn(rows, "transient field")


def draw_switched(
    time_s: FloatArray,
    signals: tuple[FloatArray, FloatArray, FloatArray],
    switched: tuple[FloatArray, FloatArray],
    resistance: float,
) -> str:
    """Return figures 5 and 6 of paper 000 as an SVG document; dashed: from switched voltages.

    Parameters
    ----------
    time_s : (T,) array
        Control samples [s].
    signals : tuple of (T,) arrays
        Flux linkage [Wb] and current [A] of the first coil, force [N], of the field.
    switched : pair of (8 T - 7,) arrays
        Flux linkage from switched voltages [Wb] and i_s of it [A], every sub-step.
    resistance : float
        Of the coil [ohm].
    """
    flux, current, force = signals
    rebuilt, static = switched
    ms, fine = 1e3 * time_s, 1e3 * np.linspace(time_s[0], time_s[-1], len(rebuilt))
    middle, each = 0.5 * (ms[1:] + ms[:-1]), (len(rebuilt) - 1) // (len(ms) - 1)
    induced, made = (np.diff(psi) / np.diff(time_s) for psi in (flux, rebuilt[::each]))
    rows: _Rows = (
        (f"V - {resistance:.3g} ohm i [V]; means", ((middle, induced, "a"), (middle, made, "b"))),
        ("flux linkage [mWb]", ((ms, 1e3 * flux, "a"), (fine, 1e3 * rebuilt, "b"))),
        ("current [A]; dashed: i_s", ((ms, current, "a"), (fine, static, "b"))),
        ("force [N]", ((ms, force, "a"),)),
    )
    return _drawn(rows, "identification of dynamics")


def _drawn(rows: _Rows, title: str) -> str:
    last = float(rows[-1][1][0][0][-1])
    parts: list[str] = [_STYLE]
    for k, (label, curves) in enumerate(rows):
        values = np.concatenate([y for _, y, _ in curves])
        low, high = min(0.0, float(values.min())), float(values.max())
        margin = 0.06 * (high - low)
        panel = Panel(62.0, 26.0 + _ROW * k, _WIDTH - 84.0, _ROW - 62.0, (0.0, last),
                      (low - margin, high + margin))  # fmt: skip
        panel.axes(x_label="time [ms]", y_label=label, x_texts=k + 1 == len(rows))
        for x, y, style in curves:
            panel.line(x, y, style)
        parts += panel.parts
    svg = str(drawing(_WIDTH, _ROW * len(rows) + 10.0, parts, title))
    return svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1) + "\n"
