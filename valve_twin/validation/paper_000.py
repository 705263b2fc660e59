# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Paper 000, the double-solenoid valve: what it states, recomputed.

The paper prints no parameter, no table and no axis in units: its statements can be tested, its
curves cannot. The valve is the parameter set of equations.md 5.2; what stands for the field
computation is the model itself with known dynamics.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.control.current_loop import PATTERNS, SUB_STEPS, mean_voltage
from valve_twin.core.control.trajectory_set import TrajectorySetConfig
from valve_twin.core.valves.double_solenoid.dynamics_fit import (
    excite,
    fit_current_dynamics,
    fit_force_dynamics,
    model_bench,
    trapezoid,
)
from valve_twin.core.valves.double_solenoid.flux_reconstruction import (
    error_bound,
    reconstruct_flux,
)
from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant
from valve_twin.core.valves.double_solenoid.plant_kernel import (
    GA_1,
    PSI_A,
    STEP_S,
    friction_force,
)
from valve_twin.core.valves.double_solenoid.step_response import STEPS, step_response
from valve_twin.validation.check import Check, cannot, within_range, within_share
from valve_twin.validation.registry import Paper

if TYPE_CHECKING:
    from collections.abc import Callable

MILLIWEBER = 1e-3
MS = 1e-3
SETTLED_MS = 40.0

_FAST = 100.0  # speed at which the smoothed friction has its level [m/s]
_STATES = 10
_STEEP_S = 0.2e-3


def recompute(advance: Callable[[], None]) -> tuple[Check, ...]:
    """Recompute every statement; `advance` is called once a step of the setpoint."""
    plant = DoubleSolenoidPlant()
    checks = [*model(plant), *bridge(plant), *flux(plant), *dynamics(plant)]
    for share in STEPS:
        checks += control(plant, share)
        advance()
    return (*checks, *design())


def model(plant: DoubleSolenoidPlant) -> list[Check]:
    """Compare sections 2.1 and 2.2: friction, springs, states, step size."""
    v = plant.valve()
    level = friction_force(v, _FAST) - v.beta * _FAST
    states = 2 + (GA_1 - PSI_A) + 3 * 2
    return [
        within_share("Eq. (2)", "friction beside beta v at speed over F_h [1]", 0.5,
                     level / plant.friction, 1e-9, "F_h is peak to peak: each side holds half"),
        within_range("Eq. (2)", "friction at rest [N]", 0.0, friction_force(v, 0.0),
                     lower=0.0, upper=0.0),
        within_range("Eq. (5)", "states j of the valve", "j", float(states), lower=_STATES,
                     upper=_STATES, note="psi_A, psi_B, two each of G_A, G_B, G_F, x and v"),
        within_share("Section 2.2", "step of the simulation [us]", 12.5, STEP_S * 1e6, 1e-9),
        cannot("Eq. (3)", "winding layers zeta", "zeta(l_x, turns)", float("nan"),
               "printed as a function of l_x; layers follow from the length l_z over the wire"),
        cannot("Fig. 1", "parameters of the 4WRREH6", "-", float("nan"),
               "not printed; ours is assumed, see the options of the model"),
    ]  # fmt: skip


def bridge(plant: DoubleSolenoidPlant) -> list[Check]:
    """Compare section 3.2: switching patterns and their means."""
    means = {mean_voltage(up, plant.supply_voltage) for up in range(SUB_STEPS + 1)}
    return [
        within_range("Section 3.2", "combinations of the input voltage", 16.0, float(PATTERNS),
                     lower=16.0, upper=16.0),
        within_range("Section 3.2", "with the first voltage fixed", 8.0, PATTERNS / 2.0,
                     lower=8.0, upper=8.0, note=f"{len(means)} different mean voltages"),
    ]  # fmt: skip


def flux(plant: DoubleSolenoidPlant) -> list[Check]:
    """Compare section 3.2, fig. 5: the flux from switched voltages, and steep flanks."""
    supply, ohm = plant.supply_voltage, plant.resistance_a
    bench = model_bench(plant)
    of = excite(bench, resistance=ohm, supply=supply, flank_s=1.2e-3)
    current = trapezoid(_STEEP_S, 0.8, 2e-3)
    steep = reconstruct_flux(bench(current).flux[::SUB_STEPS], current[:-1], ohm, supply)
    reduced = excite(bench, resistance=ohm, supply=supply, flank_s=_STEEP_S)
    bound = error_bound(supply) / MILLIWEBER
    return [
        within_range("Fig. 5", "flux error, flank of 1.2 ms [mWb]", "high but limited",
                     float(np.abs(of.rebuilt.error).max()) / MILLIWEBER, upper=bound,
                     note=f"half a step of the means, U t_s; fit {of.rebuilt.fit:.1f} %"),
        within_range("Fig. 5", "flux error, flank of 0.2 ms [mWb]", "increasing error",
                     float(np.abs(steep.error).max()) / MILLIWEBER, lower=10.0 * bound,
                     note="the flank needs three times the supply"),
        within_range("Fig. 4", "flux error after the slope was reduced [mWb]", "reduced",
                     float(np.abs(reduced.rebuilt.error).max()) / MILLIWEBER, upper=bound,
                     note=f"flanks of {reduced.flank_s / MS:.2f} ms after {reduced.tries} tries"),
    ]  # fmt: skip


def dynamics(plant: DoubleSolenoidPlant) -> list[Check]:
    """Compare section 3.2, fig. 6: the character of G_A and G_F."""
    m = plant.tables()
    of = excite(model_bench(plant), resistance=plant.resistance_a, supply=plant.supply_voltage)
    current = fit_current_dynamics(of, m, rebuilt=False)
    rebuilt = fit_current_dynamics(of, m)
    force = fit_force_dynamics(of, m)
    lead = current.coefficients["b1"] - current.coefficients["a1"]
    lag = force.coefficients["d1"] - force.coefficients["f1"]
    return [
        within_range("Fig. 6", "b1 - a1 of G_A [ms]", "derivative character", lead, lower=0.0,
                     note=f"true 0.12; from the switched voltages the response keeps "
                     f"{rebuilt.rms:.3f} A of 0.8 A"),
        within_range("Fig. 6", "d1 - f1 of G_F [ms]", "delayed", lag, lower=0.0,
                     note="true 0.50"),
        within_range("Eq. (4)", "G_A at rest [1]", "b0", current.dynamics.out_1
                     + current.dynamics.direct, lower=1.0 - 1e-9, upper=1.0 + 1e-9,
                     note="b0 = f0 = 1, or the curves are wrong at rest"),
        cannot("Fig. 6", "coefficients of G_A and G_F", "-", float("nan"),
               "not printed; the time axis is in units of an unknown T"),
    ]  # fmt: skip


def control(plant: DoubleSolenoidPlant, share: float) -> list[Check]:
    """Compare section 4, fig. 7: a step by trajectory set control and by the PID."""
    at = f"{100.0 * share:g} % step"
    found = []
    for name, words in (("trajectory_set", "MPTSC"), ("pid", "nonlinear PID")):
        of = step_response(replace(plant, control=name), share)
        note = f"rise {of.rise_s / MS:.1f} ms, overshoot {100.0 * of.overshoot:.1f} %"
        found.append(
            within_range("Fig. 7", f"{words}: {at} settled [ms]", "similar to the PID",
                         of.settling_s / MS, upper=SETTLED_MS, note=note)
        )  # fmt: skip
    return found


def design() -> list[Check]:
    """List what is left of sections 2.2 and 4."""
    parameters = float(len(TrajectorySetConfig().weights()))
    return [
        within_range("Section 4", "parameters of MPTSC", 3.0, parameters, lower=3.0, upper=3.0,
                     note="which ones is not in the text: overshoot, speed, effort; assumed"),
        cannot("Section 2.2", "MPTSC at 10 kHz in real time", "proven in /20/", float("nan"),
               "a time, not a number of the model: `valve-twin bench solenoid` measures it"),
        cannot("Fig. 7", "step responses and currents", "curves", float("nan"),
               "no scale in the text; parameters of the valve not printed"),
        cannot("Section 4", "sensitivity to +-5 % of each dimension", "-", float("nan"),
               "needs the field computation, which is not public"),
    ]  # fmt: skip


PAPER = Paper("000", "the double-solenoid directional valve", len(STEPS), recompute)
