# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Where a mean cycle has its spike and its steady part: options that `configure` proposes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.cycle_timing.timing import self_centred

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import FloatArray

_STEADY = 0.05  # spread around the level, in the range, that counts as steady, assumed
_ROOM = 2.0  # widths of the spike that are looked through before and behind it


def windows_of(cycle: FloatArray, period_s: float) -> Mapping[str, object]:
    """Return the options that place spike and steady part.

    Parameters
    ----------
    cycle : (N,) array
        Mean flow over a cycle [unit of the signal].
    period_s : float
        Sampling time [s].

    Returns
    -------
    mapping
        Empty where the cycle ends in no steady part.
    """
    n, span = len(cycle), float(np.ptp(cycle))
    least = max(1, n // 8)
    for part in (n // 2, least):  # a cycle of several levels is steady at its end only
        level = float(np.median(cycle[-part:]))
        off = np.flatnonzero(np.abs(cycle - level) > _STEADY * span)
        settled = int(off[-1]) + 1 if len(off) else 0
        if n - settled >= least:
            break
    if span == 0.0 or n - settled < least:
        return {}
    # the last lonely peak before the steady part: a start-up at the cycle's begin has no rise
    above = np.flatnonzero(cycle[: settled + 1] > level + 0.25 * span)
    groups = np.split(above, np.flatnonzero(np.diff(above) > 1) + 1) if len(above) else []
    spikes = [g for g in groups if len(g) and g[0] > 0]
    margin = max(1, (n - settled) // 20)
    steady: dict[str, object] = {
        "steady_start_s": (settled + margin) * period_s,
        "steady_end_s": (n - margin) * period_s,
        "healthy_flow": level,
    }
    if not spikes:
        return steady
    spike = max(spikes, key=lambda g: float(cycle[g].max()))
    peak = int(spike[np.argmax(cycle[spike])])
    width = max(len(spike), 3)
    low = max(0, round(spike[0] - _ROOM * width))
    high = min(settled + width, round(spike[-1] + _ROOM * width))
    width_s = width * period_s
    instant = self_centred(
        np.arange(n, dtype=np.float64) * period_s, np.maximum(cycle, 0.0), peak * period_s, width_s
    )
    return steady | {
        "spike_start_s": low * period_s,
        "spike_end_s": high * period_s,
        "spike_half_width_s": width_s,
        "healthy_instant_s": instant,
    }
