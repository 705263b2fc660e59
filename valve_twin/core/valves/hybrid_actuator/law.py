# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The law of the hybrid actuator as a step of one sample: the free run of its prediction.

Measured currents move the armature, voltages do not. The state holds the position as measured,
position [m], speed [m/s], and the currents of the sample before [A].
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.core.quantity import describe
from valve_twin.core.valves.hybrid_actuator.parameters import HybridActuatorOptions, refusal_of
from valve_twin.core.valves.hybrid_actuator.predictor import (
    CURRENT_SCALE,
    armature_of,
    begun,
    coefficients,
    move,
    shown_position,
    solenoid_of,
)
from valve_twin.core.valves.kit.law import Law, Lawful, parameter
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.kit.law import LawParameter

_NAMES = ("mass", "spring_rate", "damping", "half_travel", "residual_gap", "restitution",
          "gas_force", "gas_length", "kernel", "beta", "kappa", "saturation_flux", "c1", "c2",
          "c3", "magnet_force", "magnet_length", "magnet_coupling", "coulomb_friction",
          "current_scale")  # fmt: skip
"""Parameters in the order of the prediction's coefficients."""


@njit(cache=True)
def step(x: FloatArray, u: FloatArray, p: FloatArray, period_s: float) -> None:
    """Advance the state, as `Law.step`.

    Parameters
    ----------
    x : (5,) array
        Position as measured [1], position [m], speed [m/s] and last currents [A], in place.
    u : (4,) array
        Voltages and currents of opener and closer at the end of the sample [1].
    p : (20,) array
        In the order of `LAW.parameters`.
    period_s : float
        Sampling time [s].
    """
    a = armature_of(p)
    m = solenoid_of(p)
    now = (x[3], x[4])
    then = (u[2] * p[CURRENT_SCALE], u[3] * p[CURRENT_SCALE])
    x[1], x[2] = move(a, m, x[1], x[2], now, then, period_s)
    x[0] = shown_position(x[1], a.travel)
    x[3], x[4] = then


@njit(cache=True)
def rest(x: FloatArray, u: FloatArray, p: FloatArray) -> None:
    """Let the armature stand where it is, under the present currents, as `Law.rest`.

    Parameters
    ----------
    x, u, p : (5,), (4,), (20,) arrays
        As of `step`.
    """
    a = armature_of(p)
    x[1], x[2] = begun(x[0], a.travel), 0.0
    x[3], x[4] = u[2] * p[CURRENT_SCALE], u[3] * p[CURRENT_SCALE]


def _parameters() -> tuple[LawParameter, ...]:
    usual = HybridActuatorOptions()
    known = {d.name: d for d in describe(usual)}
    about = "0 = linear, 1 = saturating, 2 = saturating_fit"
    return tuple(
        parameter(name, 1.0, "1", about, lower=0.0, upper=2.0)
        if name == "kernel"
        else parameter(
            name,
            getattr(usual, name),
            known[name].unit,
            known[name].text,
            lower=known[name].lower,
            upper=known[name].upper,
        )
        for name in _NAMES
    )


LAW = Law(step=step, states=5, parameters=_parameters(), rest=rest)


class AsLaw(Lawful):
    """What of the model makes it one by a law."""

    __slots__ = ()
    options: HybridActuatorOptions
    law = LAW

    def law_lag(self, values: Mapping[str, float], lag: int, period_s: float) -> int:
        """Return 0: the currents of a sample move the armature up to it.

        Parameters
        ----------
        values : mapping
            Known parameters by name [unit of each].
        lag : int
            What the scan found [samples].
        period_s : float
            Sampling time [s].
        """
        del values, lag, period_s
        return 0

    def law_values(self, values: Mapping[str, float], period_s: float) -> Mapping[str, float]:
        """Return the data sheet and what is not estimated, as `Lawful.law_values`.

        Parameters
        ----------
        values : mapping
            Known ones by name [unit of each].
        period_s : float
            Sampling time [s].

        Raises
        ------
        ValueError
            If these numbers cannot be used together.
        """
        options = self.options
        if refusal := refusal_of(options):
            raise ValueError(refusal)
        armature, solenoid = options.armature(values), options.magnetics(values)
        c = coefficients(armature, solenoid, options.current_scale, period_s)
        return dict(zip(_NAMES, c[: len(_NAMES)].tolist(), strict=True))
