# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Recursive Hammerstein-Wiener identification: paper 004, equations (1)-(10), and what it lacks.

The literal algorithm ("equation_error") predicts from measured outputs: noise on them biases it.
The corrected one ("output_error") predicts from its own past outputs and follows the exact
gradient of that free run; it starts where the literal one stands after `settle` samples. Both are
steps from state to state: the same bits for any length of block.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.recursive.kernel import (
    FORGETTING,
    MEMORY_SIZE,
    SEEN,
    RecursiveState,
    adapt_block,
    correct_block,
    run_free,
)
from valve_twin.core.prediction import fit_percent

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Structure:
    """Orders of the model: y(t) = -sum a_i y(t-i) + sum b_j u(t-j-nk+1) + powers of u and y_lin.

    Attributes
    ----------
    na, nb, nk, nl : int
        Outputs, inputs, delay of the input [samples] (all 1 or more), highest power (1 = linear).
    """

    na: int
    nb: int
    nk: int = 1
    nl: int = 1

    def __post_init__(self) -> None:
        """Refuse orders below 1."""
        for name in ("na", "nb", "nk", "nl"):
            if getattr(self, name) < 1:
                message = f"Structure.{name} = {getattr(self, name)!r}: must be at least 1"
                raise ValueError(message)

    @property
    def size(self) -> int:
        """Number of parameters P."""
        return self.na + self.nb + 2 * (self.nl - 1)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the P parameters in their order, paper 004 eq. (7)."""
        powers = range(2, self.nl + 1)
        return (
            *(f"a_{i}" for i in range(1, self.na + 1)),
            *(f"b_{j}" for j in range(1, self.nb + 1)),
            *(f"beta_{k}" for k in powers),
            *(f"gamma_{k}" for k in powers),
        )

    @property
    def orders(self) -> IntArray:
        """The orders as the kernels take them, (4,)."""
        return np.array([self.na, self.nb, self.nk, self.nl], dtype=np.int64)


@dataclass(frozen=True, slots=True)
class Adaptation:
    """How fast the parameters follow.

    Attributes
    ----------
    initial_gain : float
        F(0) = initial_gain * identity.
    forgetting : float
        Weight of the past a sample; 1 = nothing is forgotten and the gain goes to 0.
    max_trace : float
        Forgetting lets the trace of F grow to this and no further.
    settle : int
        Samples of the literal algorithm before the corrected one starts.
    start_gain : float
        F of the corrected algorithm at its start: it starts near, so it need not leap.
    early_forgetting, early_rate : float
        The corrected algorithm forgets more at its start, and approaches `forgetting` at this rate
        a sample.
    max_radius : float
        Largest pole radius the corrected algorithm takes.
    """

    initial_gain: float = 1e3
    forgetting: float = 1.0
    max_trace: float = 1e6
    settle: int = 200
    start_gain: float = 1.0
    early_forgetting: float = 0.97
    early_rate: float = 0.01
    max_radius: float = 0.9995

    def __post_init__(self) -> None:
        """Refuse what adapts to nothing or forgets everything."""
        ranges = {
            "initial_gain": (0.0, 1e12),
            "forgetting": (0.5, 1.0),
            "max_trace": (0.0, 1e15),
            "settle": (1, 10**9),
            "start_gain": (0.0, 1e12),
            "early_forgetting": (0.5, 1.0),
            "early_rate": (0.0, 1.0),
            "max_radius": (0.0, 1.0),
        }
        for name, (lower, upper) in ranges.items():
            value = getattr(self, name)
            if not lower <= value <= upper:
                message = f"Adaptation.{name} = {value!r}: must be from {lower:g} to {upper:g}"
                raise ValueError(message)


@dataclass(frozen=True, slots=True)
class Adapted:
    """What a block of N samples gave: the state behind it and the outputs (N,), NaN at a start."""

    state: RecursiveState
    prior: FloatArray
    posterior: FloatArray


@dataclass(frozen=True, slots=True)
class Fits:
    """The three fits that one word "fit" can mean, 100 (1 - |y - yhat| / |y - mean(y)|) [%].

    Attributes
    ----------
    a_priori : float
        One-step prediction before the sample was learned.
    a_posteriori : float
        Equation (10): after it was learned.
    free_run : float
        Simulation with the last parameters from the first samples on.
    """

    a_priori: float
    a_posteriori: float
    free_run: float


def start(
    structure: Structure, adaptation: Adaptation, theta: FloatArray | None = None
) -> RecursiveState:
    """Return the state before the first sample.

    Parameters
    ----------
    structure, adaptation : Structure, Adaptation
        The model and how fast it follows.
    theta : (P,) array, optional
        Parameters to start from [1]; zero if left out.
    """
    size = structure.size
    memory = np.zeros(MEMORY_SIZE)
    memory[FORGETTING] = adaptation.forgetting
    return RecursiveState(
        theta=np.zeros(size) if theta is None else np.array(theta, dtype=np.float64),
        upper=np.eye(size),
        diagonal=np.full(size, adaptation.initial_gain),
        past_y=np.zeros(structure.na),
        past_u=np.zeros(structure.nk + structure.nb - 1),
        gradients=np.zeros((structure.na + 1, size)),
        memory=memory,
    )


def reset_gain(state: RecursiveState, gain: float) -> RecursiveState:
    """Return the state with F = gain * identity: the parameters stay, what they may do is new."""
    size = len(state.theta)
    return state._replace(upper=np.eye(size), diagonal=np.full(size, float(gain)))


def adapt(
    structure: Structure,
    adaptation: Adaptation,
    state: RecursiveState,
    y: FloatArray,
    u: FloatArray,
) -> Adapted:
    """Learn N samples by the literal algorithm, paper 004 eq. (4)-(10).

    Parameters
    ----------
    structure, adaptation : Structure, Adaptation
        The model and how fast it follows.
    state : RecursiveState
        Where it stands; not changed.
    y, u : (N,) arrays
        Output and input [1]; a sample that is not finite is a gap.
    """
    new, prior, posterior = _copies(state, y)
    adapt_block(
        new,
        structure.orders,
        float(adaptation.max_trace),
        _column(y),
        _column(u),
        prior,
        posterior,
    )
    return Adapted(new, prior, posterior)


def adapt_corrected(
    structure: Structure,
    adaptation: Adaptation,
    state: RecursiveState,
    y: FloatArray,
    u: FloatArray,
) -> Adapted:
    """Learn N samples by the corrected algorithm; parameters as `adapt`."""
    new, prior, posterior = _copies(state, y)
    settings = np.array(
        [adaptation.max_trace, adaptation.max_radius, adaptation.forgetting, adaptation.early_rate]
    )
    correct_block(new, structure.orders, settings, _column(y), _column(u), prior, posterior)
    return Adapted(new, prior, posterior)


def start_corrected(
    structure: Structure, adaptation: Adaptation, literal: RecursiveState
) -> RecursiveState:
    """Return the start of the corrected algorithm from where the literal one stands.

    Parameters
    ----------
    structure, adaptation : Structure, Adaptation
        The model and how fast it follows.
    literal : RecursiveState
        State of the literal algorithm; not changed.
    """
    theta = project_stable(literal.theta, structure, radius=min(0.98, adaptation.max_radius))
    state = start(structure, adaptation, theta)
    state.past_u[:] = literal.past_u
    state.past_y[:] = literal.past_y
    state.memory[:] = literal.memory
    state.memory[SEEN] = min(literal.memory[SEEN], len(state.past_u) + len(state.past_y))
    state.memory[FORGETTING] = min(adaptation.early_forgetting, adaptation.forgetting)
    return reset_gain(state, adaptation.start_gain)


def identify(
    structure: Structure,
    y: FloatArray,
    u: FloatArray,
    *,
    adaptation: Adaptation | None = None,
    corrected: bool = True,
    theta: FloatArray | None = None,
) -> Adapted:
    """Identify a record of N samples in one pass.

    Parameters
    ----------
    structure : Structure
        The model.
    y, u : (N,) arrays
        Output and input [1].
    adaptation : Adaptation, optional
        How fast it follows.
    corrected : bool
        Whether the bias of measured outputs in the regressor is corrected.
    theta : (P,) array, optional
        Where to start [1], e.g. what an earlier record gave; the corrected algorithm then starts
        at once, without the literal one.
    """
    how = adaptation or Adaptation()
    first = start(structure, how, theta)
    if not corrected:
        return adapt(structure, how, first, y, u)
    settle = min(how.settle, len(y)) if theta is None else 0
    literal = adapt(structure, how, first, y[:settle], u[:settle])
    second = start_corrected(structure, how, literal.state)
    later = adapt_corrected(structure, how, second, y[settle:], u[settle:])
    return Adapted(
        later.state,
        np.concatenate([literal.prior, later.prior]),
        np.concatenate([literal.posterior, later.posterior]),
    )


def project_stable(
    theta: FloatArray, structure: Structure, *, radius: float = 0.999
) -> FloatArray:
    """Return parameters (P,) whose linear part is stable: poles farther out go to `radius`.

    Needed before any prediction over more than one step: the printed G(z) of paper 004, eq. (11),
    has a pole at 1.0206 and its free run diverges.

    Parameters
    ----------
    theta : (P,) array
        Parameters [1].
    structure : Structure
        The model.
    radius : float
        Largest distance of a pole from the origin [1].
    """
    poles = np.roots(np.concatenate([[1.0], theta[: structure.na]]))
    outside = np.abs(poles) > radius
    out = np.array(theta, dtype=np.float64)
    if outside.any():
        poles[outside] *= radius / np.abs(poles[outside])
        out[: structure.na] = np.real(np.poly(poles))[1:]
    return out


def free_run(theta: FloatArray, structure: Structure, y: FloatArray, u: FloatArray) -> FloatArray:
    """Simulate (N,) from the first measured samples on; NaN there, held at 1e9 where it diverges.

    Parameters
    ----------
    theta : (P,) array
        Parameters [1]; project them first.
    structure : Structure
        The model.
    y, u : (N,) arrays
        Output (only its first samples count) and input [1].
    """
    simulated = np.empty(len(y))
    run_free(np.ascontiguousarray(theta), structure.orders, _column(y), _column(u), simulated)
    return simulated


def fits(
    structure: Structure, adapted: Adapted, y: FloatArray, u: FloatArray, *, skip: int = 0
) -> Fits:
    """Return the three fits of a record of N samples that has been learned.

    Parameters
    ----------
    structure : Structure
        The model.
    adapted : Adapted
        What learning the record gave.
    y, u : (N,) arrays
        Output and input [1].
    skip : int
        First samples that do not count: those of an adaptation that started from nothing.
    """
    theta = project_stable(adapted.state.theta, structure)
    return Fits(
        fit_percent(y[skip:], adapted.prior[skip:]),
        fit_percent(y[skip:], adapted.posterior[skip:]),
        fit_percent(y[skip:], free_run(theta, structure, y, u)[skip:]),
    )


def _column(values: FloatArray) -> FloatArray:
    return np.ascontiguousarray(values, dtype=np.float64)


def _copies(state: RecursiveState, y: FloatArray) -> tuple[RecursiveState, FloatArray, FloatArray]:
    new = RecursiveState(*(part.copy() for part in state))
    return new, np.empty(len(y)), np.empty(len(y))
