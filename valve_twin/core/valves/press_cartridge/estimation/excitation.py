# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a cycle can show: excitation of each direction and of each term, as values with reasons."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.kernels import choose_independent, excitation_sums
from valve_twin.core.estimation.data.masks import contiguous
from valve_twin.core.valves.press_cartridge.estimation.regression import TERMS, Gram

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import Frames, IntArray


@dataclass(frozen=True, slots=True)
class GuardOptions:
    """When a parameter is refused; the numbers are assumed.

    Attributes
    ----------
    active_command : float
        Command above which an input acts [1].
    min_samples : int
        Fewest rows in which an input has to act [1].
    min_travel : float
        Least travel while it acts [1].
    noise_travel : float
        Least travel in standard deviations of the position noise [1].
    min_level_spread : float
        Least spread of an input's level (standard deviation / mean while it acts) that separates
        its square from itself [1].
    max_condition : float
        Largest condition number of the column-scaled regressor [1].
    max_noise : float
        Largest position noise at rest [1]: intervals were measured up to 4e-3.
    max_gap : float
        Largest relative difference of a gain between equation error and output error [1]: the
        former is biased by noise, the latter is not.
    max_pole_gap : float
        Largest difference of the pole between the two [1]: it shows noise first.
    """

    active_command: float = 0.01
    min_samples: int = 5
    min_travel: float = 2e-3
    noise_travel: float = 5.0
    min_level_spread: float = 0.05
    max_condition: float = 1e6
    max_noise: float = 5e-3
    max_gap: float = 0.2
    max_pole_gap: float = 0.3


@dataclass(frozen=True, slots=True)
class Excitation:
    """What one input did in the rows of a fit.

    Attributes
    ----------
    samples : int
        Rows in which it acted.
    travel : float
        Sum of the position increments in those rows, absolute [1].
    level : float
        Mean level while acting [1]; NaN where it never acted.
    level_spread : float
        Standard deviation of that level relative to its mean [1]; NaN where it never acted.
    excited, graded : bool
        Whether its gain, and the dependence of the gain on its level, can be estimated.
    reason : str
        Why not; empty where both.
    needed : float
        Travel needed to estimate the gain [1].
    """

    samples: int
    travel: float
    level: float
    level_spread: float
    excited: bool
    graded: bool
    reason: str = ""
    needed: float = float("nan")


def assess_input(
    frames: Frames,
    rows: IntArray,
    lag: int,
    column: int,
    *,
    noise_sigma: float = float("nan"),
    options: GuardOptions | None = None,
) -> Excitation:
    """Assess what one input did in the rows of a fit.

    Parameters
    ----------
    frames : Frames
        Samples of one cycle.
    rows : (R,) int64 array
        Rows of the fit, each at least max(1, lag).
    lag : int
        Command to position lag [samples].
    column : int
        Column of the input.
    noise_sigma : float
        Position noise [1]; NaN = unknown, then only `min_travel` counts.
    options : GuardOptions, optional
        Limits; defaults where omitted.
    """
    options = options or GuardOptions()
    count, travel, mean, deviation = excitation_sums(
        contiguous(frames.position),
        contiguous(frames.inputs),
        rows,
        lag,
        column,
        options.active_command,
    )
    if count == 0:
        return Excitation(0, 0.0, np.nan, np.nan, False, False, "the command is never on")
    spread = deviation / mean
    need = options.min_travel
    if np.isfinite(noise_sigma):
        need = max(need, options.noise_travel * noise_sigma)
    reason, excited, graded = "", True, spread >= options.min_level_spread
    if count < options.min_samples:
        reason = f"the command is on in {count} rows, {options.min_samples} needed"
        excited = False
    elif travel < need:
        reason = f"travel {travel:.2g} while the command is on, {need:.2g} needed"
        excited = False
    elif not graded:
        reason = f"the command has one level only (spread {spread:.1%})"
    graded = excited and graded
    return Excitation(count, travel, mean, spread, excited, graded, reason, need)


def term_reasons(inflow: Excitation, outflow: Excitation, gram: Gram) -> tuple[str, ...]:
    """Return for theta_1 ... theta_8 why the cycle does not excite the term; empty where it does.

    Parameters
    ----------
    inflow, outflow : Excitation
        Of the two commands.
    gram : Gram
        Normal equations of all eight terms (for the product of the commands).
    """
    motion = "" if inflow.excited or outflow.excited else "the spool does not move on command"

    def gain(of: Excitation, name: str) -> str:
        return "" if of.excited else f"{name}: {of.reason}"

    def grade(of: Excitation, name: str) -> str:
        return "" if of.graded else f"{name}: {of.reason}"

    product = "" if gram.matrix[5, 5] > 0.0 else "both commands are never on together"
    reasons = (
        motion,
        gain(inflow, "inflow"),
        gain(outflow, "outflow"),
        grade(inflow, "inflow"),
        grade(outflow, "outflow"),
        product or gain(inflow, "inflow") or gain(outflow, "outflow"),
        gain(inflow, "inflow"),
        gain(outflow, "outflow"),
    )
    assert len(reasons) == TERMS
    return reasons


def independent_terms(gram: Gram, terms: Sequence[int], max_condition: float) -> tuple[int, ...]:
    """Return the terms, in their order, that are not combinations of earlier ones.

    Parameters
    ----------
    gram : Gram
        Normal equations of all eight terms.
    terms : sequence of int
        Candidates, numbered from 1.
    max_condition : float
        A column whose part outside the earlier ones is smaller than its length over this is left
        out [1].
    """
    columns = np.array(terms, dtype=np.int64) - 1
    chosen = np.empty(len(columns), np.int64)
    least = max(max_condition**-2.0, 1e-14)
    count = choose_independent(np.array(gram.matrix, order="C"), columns, least, chosen)
    return tuple((chosen[:count] + 1).tolist())
