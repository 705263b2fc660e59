# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Values that a position sensor did not renew while what it measures moved on."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.estimation.data.robust import difference_sigma

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

_STEPS_OF_QUANTUM = 3.0  # least step of a motion that no rounding makes a repeat [quanta]
_STEPS_OF_NOISE = 4.0  # the same of noise: 0 false ones in 2240 cycles of strangers [deviations]
_AGAIN = 0.75  # share of a refresh period by which a value stays longer than usual, assumed [1]
_ALIKE = 0.35  # relative gap between the speed through a repeat and that around it, assumed [1]
_CAUGHT_UP = 1.5  # least size of the step behind a repeat, in that of the steps around [1]
_AROUND = [0, 1, 3, 4]  # places about the middle of five values


class Missed(NamedTuple):
    """How many values a sensor left out and how many it owed, both in motion [1].

    `quantum` is the least step of the position [unit of the position], 0 = it never changed.
    """

    missed: int
    due: int
    quantum: float = 0.0


NOTHING = Missed(0, 0)


def missed_values(x: FloatArray) -> Missed:
    """Count the values that a sensor repeated although the position went on.

    A value counts as left out where it stays longer than the others of the same motion, and the
    step behind it makes up for the time: a spool that stands still for a moment is late ever
    after. So neither a slow sensor, nor rounding, nor a lost command looks like it. Only values
    count whose steps are well above rounding and noise.

    Parameters
    ----------
    x : (N,) array
        Position of one cycle, without gaps [1].

    Returns
    -------
    Missed
        No value is due in a cycle without a motion that is large enough.
    """
    first = np.flatnonzero(np.diff(x) != 0.0) + 1
    if len(first) < len(_AROUND) + 4 or not np.isfinite(x).all():
        return NOTHING
    step = np.lib.stride_tricks.sliding_window_view(np.diff(x)[first[1:] - 1], 5)
    held = np.lib.stride_tricks.sliding_window_view(np.diff(first), 5)
    one_way = (np.sign(step) == np.sign(step[:, 2:3])).all(axis=1)
    quantum = float(np.abs(step).min())
    if not one_way.any():
        return Missed(0, 0, quantum)
    refresh = max(int(np.quantile(held[one_way, 2], 0.75)), 1)
    bends = x[2 * refresh :] - 2.0 * x[refresh:-refresh] + x[: -2 * refresh]
    noise = max(difference_sigma(bends, 2), quantum / np.sqrt(12.0))
    around = np.abs(step[:, _AROUND])
    least = max(_STEPS_OF_QUANTUM * quantum, _STEPS_OF_NOISE * noise)
    due = one_way & (around.min(axis=1) >= least)
    if not due.any():
        return Missed(0, 0, quantum)
    usual = float(np.quantile(held[due, 2], 0.75))
    speed = np.median(around / held[:, _AROUND], axis=1)
    alike = np.abs(np.abs(step[:, 2]) - speed * held[:, 2]) < _ALIKE * speed * held[:, 2]
    caught_up = np.abs(step[:, 2]) > _CAUGHT_UP * np.median(around, axis=1)
    longer = held[:, 2] >= usual + max(1.0, _AGAIN * usual)
    values = np.round(held[:, 2] / usual)
    missed = due & longer & alike & caught_up
    return Missed(int(np.sum(values[missed] - 1.0)), int(np.sum(values[due])), quantum)
