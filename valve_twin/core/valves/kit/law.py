# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A law of motion and its parameters, and how it gets into the compiled loops."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.types import Parameter
from valve_twin.core.valves.kit import loops
from valve_twin.core.valves.kit.bind import bind
from valve_twin.core.valves.kit.prediction import predictor

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.kit.bind import Loop

    Step = Callable[[FloatArray, FloatArray, FloatArray, float], None]


@dataclass(frozen=True, slots=True)
class LawParameter:
    """One parameter of a law: what is published of it, and its value in a new valve."""

    published: Parameter
    value: float

    @property
    def name(self) -> str:
        """Name as published and as configured."""
        return self.published.name


def parameter(
    name: str,
    value: float,
    unit: str,
    text: str,
    *,
    lower: float,
    upper: float,
    trend: bool = True,
    sided: tuple[str, str] | tuple[()] = (),
) -> LawParameter:
    """Declare one parameter of a law.

    Parameters
    ----------
    name : str
        Name as published and as configured.
    value : float
        Value in a new valve: the simulated one has it, the fit starts from it [`unit`].
    unit : str
        SI unit, "1" = dimensionless.
    text : str
        One line: what it is.
    lower, upper : float
        Bounds that simulation and fit obey, both ends included [`unit`].
    trend : bool
        Whether the aging monitor follows it by default.
    sided : tuple of str
        Where another one is the same of another direction: what, and of which direction this is,
        such as ("gain", "rising").

    Raises
    ------
    ValueError
        If value and bounds are not finite and in order.
    """
    if not (lower <= value <= upper and lower < upper and np.isfinite(upper - lower)):
        message = (
            f"parameter '{name}' = {value!r}: must lie between its bounds, "
            f"which are {lower!r} and {upper!r} [{unit}]; both must be finite"
        )
        raise ValueError(message)
    return LawParameter(
        Parameter(name, unit, text, lower, upper, trend, sided=sided), float(value)
    )


def published(
    known: Sequence[Parameter], name: str, value: float, *, lower: float, upper: float
) -> LawParameter:
    """Declare a parameter of a law that an estimate gives, as it is published.

    Parameters
    ----------
    known : sequence of Parameter
        What the model publishes.
    name, value, lower, upper : str, float, float, float
        As of `parameter`.
    """
    (found,) = (p for p in known if p.name == name)
    unit, text = found.unit, found.description
    return parameter(name, value, unit, text, lower=lower, upper=upper, sided=found.sided)


@dataclass(frozen=True)
class Law:
    """A law of motion of discrete samples.

    Attributes
    ----------
    step : callable
        Compiled (`numba.njit`) `step(x, u, p, period_s)`: advances the state x (S,) in place by
        `period_s` [s] under the inputs u (M,), which are held, with the parameters p (P,). x[0] is
        what is measured. Finite for every finite state and every p inside its bounds.
    states : int
        Number S of states.
    parameters : tuple of LawParameter
        The P parameters in the order of p.
    rest : callable, optional
        Compiled `rest(x, u, p)`: fills x[1:] where x[0] is known and nothing else; without it
        they are 0.
    """

    step: Step
    states: int
    parameters: tuple[LawParameter, ...]
    rest: Callable[[FloatArray, FloatArray, FloatArray], None] | None = None

    @property
    def values(self) -> FloatArray:
        """The (P,) values of a new valve."""
        return np.array([p.value for p in self.parameters])

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """The (P,) lower and the (P,) upper bounds."""
        published = [p.published for p in self.parameters]
        return np.array([p.lower for p in published]), np.array([p.upper for p in published])

    @cached_property
    def predict(self) -> Loop:
        """The prediction loop of this law."""
        return predictor(
            self._compiled(loops.advance, forceinline=True),
            self._compiled(loops.follow, forceinline=True),
            run=self.states,
            numbers=loops.numbers,
        )

    @cached_property
    def free_run(self) -> Loop:
        """`loops.free_run` of this law."""
        return self._compiled(loops.free_run)

    @cached_property
    def simulate(self) -> Loop:
        """`loops.simulate` of this law."""
        return self._compiled(loops.simulate)

    def _compiled(self, loop: Callable[..., object], *, forceinline: bool = False) -> Loop:
        rest = self.rest or loops.rest
        return bind(
            loop,
            self.step,
            forceinline=forceinline,
            STATES=self.states,
            step=self.step,
            rest=rest,
        )


class Lawful:
    """A model whose motion is a law of one sample: what runs the law alone has to know of it.

    Attributes
    ----------
    inputs, output, normalised, trend_estimator : tuple of str, str, bool, str
        As of `ValveModel`.
    law : Law
        The law; its parameters are those of the trend's estimator, or `law_values` gives them.
    """

    __slots__ = ()
    inputs: tuple[str, ...]
    output: str
    normalised: bool
    trend_estimator: str
    law: Law

    def law_lag(self, values: Mapping[str, float], lag: int, period_s: float) -> int:
        """Return after how many whole samples an input acts, as the prediction takes it.

        Parameters
        ----------
        values : mapping
            Known parameters by name [unit of each].
        lag : int
            What the scan found [samples].
        period_s : float
            Sampling time [s].
        """
        del values, period_s
        return lag

    def law_values(self, values: Mapping[str, float], period_s: float) -> Mapping[str, float]:
        """Return what the prediction takes for parameters of the law that a cycle does not show.

        Parameters
        ----------
        values : mapping
            Known ones by name [unit of each].
        period_s : float
            Sampling time [s].

        Raises
        ------
        ValueError
            If the law does not hold for them.
        """
        del values, period_s
        return {}
