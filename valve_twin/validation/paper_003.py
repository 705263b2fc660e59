# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Paper 003, the hydraulic servosystem: what can be recomputed of a paper that prints no number.

Its results are figures without a stated parameter: their values cannot be compared. What can:
areas, signs of the equations, loops of the hysteresis, and the step response beside an independent
integration of the same equations (BDF of another program, equations.md 3.2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.physics import hysteresis
from valve_twin.core.valves.servo_system.areas import ORIFICES, areas
from valve_twin.core.valves.servo_system.dynamics import (
    IS,
    OM,
    P1,
    P2,
    PLR,
    PLS,
    STATES,
    TH,
    VP,
    XP,
    XV,
)
from valve_twin.core.valves.servo_system.integrate import FIRST_STEP, rest, span
from valve_twin.core.valves.servo_system.loops import FREQUENCIES_HZ, valve_loop
from valve_twin.core.valves.servo_system.numbers import BS, KS
from valve_twin.core.valves.servo_system.plant import ServoSystemPlant
from valve_twin.validation.check import Check, Kind, cannot, within_range, within_share
from valve_twin.validation.registry import Paper

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.types import FloatArray

NAN = float("nan")
_NO_SCALE = "a figure without parameter values: shape, not numbers, can be compared"
STEP_M = 0.01
"""Step of figures 8 to 18 here [m]; the paper's is not stated."""

LENGTH_S = 0.6


@dataclass(frozen=True, slots=True)
class Step:
    """A step response, every millisecond.

    Attributes
    ----------
    time_s : (N,) array
        Time since the step [s].
    states : (N, 13) array
        See `dynamics.STATES`, SI units.
    load, load_speed, force : (N,) arrays
        Position [m] and speed [m/s] of the load, force in the compliant member [N].
    """

    time_s: FloatArray
    states: FloatArray
    load: FloatArray
    load_speed: FloatArray
    force: FloatArray

    @property
    def rise_s(self) -> float:
        """Return the time from 10 to 90 % of the way to the end [s]."""
        way = self.states[:, XP] / self.states[-1, XP]
        return float(self.time_s[np.argmax(way >= 0.9)] - self.time_s[np.argmax(way >= 0.1)])


def recompute(advance: Callable[[], None]) -> tuple[Check, ...]:
    """Recompute what can be; `advance` is called once a part."""
    plant = ServoSystemPlant()
    checks: list[Check] = []
    for part in (_areas, _loops, _step):
        checks += part(plant)
        advance()
    return tuple(checks)


def _areas(plant: ServoSystemPlant) -> list[Check]:
    """Check the areas of eqs. (7) to (11) over the whole travel and beyond."""
    r, c = plant.port_radius, plant.clearance
    u_s, u_r = plant.supply_underlap, plant.return_underlap
    travel = np.linspace(-3.0 * r, 3.0 * r, 4001)
    found, slope = np.empty((len(travel), ORIFICES)), np.empty(ORIFICES)
    for n, x in enumerate(travel):
        areas(float(x), r, c, u_s, u_r, found[n], slope)
    mirrored = found[::-1]
    uneven = float(np.abs(found[:, [0, 2, 4]] - mirrored[:, [1, 3, 4]]).max())
    printed = (2.0 * r - travel - u_s) / (2.0 * r)
    outside = float(np.mean(np.abs(printed[np.abs(travel) <= plant.valve_travel]) > 1.0))
    whole = 8.0 * np.pi * r * c
    balance = (found[:, 4] - found[:, [2, 3]].min(axis=1)) / whole
    return [
        within_range("Eqs. (7)-(11)", "A1(x) - A2(-x), A3, A4, A_L alike [m^2]", "symmetric valve",
                     uneven, upper=1e-18, kind=Kind.DERIVED),
        within_range("Eqs. (7)-(11)", "smallest area for any x_v [m^2]", "areas",
                     float(found.min()), lower=-1e-18, upper=1e-18,
                     kind=Kind.DERIVED,
                     note="limited distances instead of the printed branches"),
        within_range("Eq. (11)", "leak over the smaller return area, less 1 [1]",
                     "part of the clearance", float(balance.max()), upper=1e-9,
                     kind=Kind.DERIVED,
                     note="the leak is what the supply strips leave of 8 pi r c"),
        cannot("Eqs. (7), (8)", "share of the travel with an arc cosine beyond 1 [1]", "areas",
               outside, "as printed the arguments leave [-1, 1] where |x_v| > u_s: no number"),
        cannot("Eq. (7)", "orifice 1 closes at [m]", "x_v < -u_r", -u_s,
               "the branch must be -u_s, where its arc cosine ends"),
    ]  # fmt: skip


def _loops(plant: ServoSystemPlant) -> list[Check]:
    """Check what the paper asks of the hysteresis, and draw figures 5 to 7."""
    found = [valve_loop(plant, f, 0.06) for f in FREQUENCIES_HZ]
    minor = valve_loop(plant, FREQUENCIES_HZ[0], 0.01, mean=0.02)
    gap = max(abs(float(x.position[0] - x.position[-1])) for x in (*found, minor))
    scale = float(np.ptp(found[0].position))
    areas_ = [valve_loop(plant, 0.105, a).area for a in (0.06, 0.03, 0.015)]
    growth = min(areas_[0] / areas_[1], areas_[1] / areas_[2])
    checks = [
        within_range("Hysteresis", "gap of a minor loop over the full scale [1]",
                     "major and minor loops", _minor_gap(), upper=1e-12,
                     note="plays: exactly closed; Bouc-Wen misses by 0.044"),
        within_range("Figs. 5-7", "gap between crest and next crest over the travel [1]",
                     "closed loops", gap / scale, upper=3e-4),
        within_range("Hysteresis", "least growth of the area when the amplitude doubles [1]",
                     "area grows with amplitude", growth, lower=1.5),
        within_range("Figs. 5, 6, 7", "width at 6.30 Hz over that at 0.105 Hz [1]",
                     "loops widen with frequency", found[2].width / found[0].width, lower=1.5,
                     note="the lag of the valve adds to a hysteresis that knows no time"),
    ]  # fmt: skip
    for number, f, loop in zip((5, 6, 7), FREQUENCIES_HZ, found, strict=True):
        checks.append(cannot(f"Fig. {number}", f"width of the loop at {f:g} Hz [mA]", "a figure",
                             1e3 * loop.width, _NO_SCALE))  # fmt: skip
    return checks


def _minor_gap() -> float:
    """Return by how much the output misses after a minor loop, over the full output [1]."""
    memory = np.zeros(hysteresis.PLAYS)
    out = []
    for u in (0.06, -0.06, 0.02, -0.01, 0.02, 0.01, 0.02):
        out.append(hysteresis.output(u, 0.0, memory, 0.01, 0.4)[0])
        hysteresis.remember(u, memory, 0.01)
    return max(abs(out[4] - out[2]), abs(out[6] - out[2])) / 0.12


def _step(plant: ServoSystemPlant) -> list[Check]:
    """Check the closed loop with corrected signs on a step of 10 mm."""
    good, printed = step_response(plant, STEP_M), step_response(plant, STEP_M, sign=-1.0)
    x, lag = good.states[:, XP], good.load - good.states[:, XP]
    checks = [
        within_range("Figs. 10, 12", "final error of a 10 mm step [mm]", "position loop",
                     1e3 * abs(float(x[-1]) - STEP_M), upper=0.6, kind=Kind.REGRESSION,
                     note="hysteresis and break-away friction leave a static error"),
        within_range("Figs. 10, 12", "largest distance of load and piston [mm]",
                     "load follows the piston", 1e3 * float(np.abs(lag).max()), upper=0.5,
                     note="5 % of the step; the compliant member"),
        *_independent(good),
        cannot("Eq. (20)", "piston speed with the printed +b_s, last 0.1 s [m/s rms]", "a model",
               float(np.sqrt(np.mean(printed.states[-100:, VP] ** 2))),
               "the printed sign feeds the oscillation between piston and load"),
        cannot("Eq. (16)", "fittings of the supply line", "+ (sum k) rho Q^2/(2 A^2)", NAN,
               "the printed sign drives the flow; corrected against it"),
        cannot("Eq. (20)", "loss of the line to chamber 2", "-128 mu l Q/(pi d^4)", NAN,
               "the printed sign makes the loss push the piston; the bracket is open as well"),
        cannot("Eq. (22)", "torque on the load", "F cos(theta)", NAN,
               "a force: the arm l_a is missing"),
        cannot("Eq. (12)", "factor of the outer loops", "1 + k_f", NAN,
               "adds a number to A/N; here k_f counts by a nominal force over the current limit"),
        cannot("Eq. (6)", "flow force", "k_Q (Q1 + Q2 + Q3 + Q4)/sqrt(|x_v| + k_1)", NAN,
               "pushes one way only; here the odd sum |Q1| + |Q4| - |Q2| - |Q3|"),
        cannot("Section 4", "computing time of a run [s]", 26.5, NAN,
               "of a VAXstation II, the length of the run is not stated"),
    ]  # fmt: skip
    return checks + [cannot(*row, _NO_SCALE) for row in _figures(good)]


def _independent(step: Step) -> list[Check]:
    """Compare with the independent integration of the same equations."""
    y = step.states
    rows = (
        ("Figs. 10, 12", "rise from 10 to 90 % [ms]", 139.0, 1e3 * step.rise_s, 0.03),
        ("Fig. 11", "largest piston speed [m/s]", 0.14, float(y[:, VP].max()), 0.03),
        ("Fig. 9", "largest valve position [um]", 220.0, 1e6 * float(y[:, XV].max()), 0.03),
        ("Fig. 8", "largest current [mA]", 53.0, 1e3 * float(y[:, IS].max()), 0.03),
        ("Fig. 14", "largest force in the member [N]", 533.0, float(np.abs(step.force).max()),
         0.03),
        ("Fig. 17", "least supply line pressure [MPa]", 19.4, 1e-6 * float(y[:, PLS].min()), 0.03),
        ("Fig. 18", "largest return line pressure [MPa]", 0.86, 1e-6 * float(y[:, PLR].max()),
         0.05),
    )  # fmt: skip
    note = "an independent integration by BDF, 10 mm"
    return [within_share(*row, note, Kind.REGRESSION) for row in rows]


def _figures(step: Step) -> list[tuple[str, str, str, float]]:
    """Return what figures 8 to 18 would be compared by: ours, a step of 10 mm."""
    y = step.states
    return [
        ("Fig. 13", "largest load speed [m/s]", "a figure", float(step.load_speed.max())),
        (
            "Fig. 15",
            "largest pressure of chamber 1 [MPa]",
            "a figure",
            1e-6 * float(y[:, P1].max()),
        ),
        (
            "Fig. 16",
            "largest pressure of chamber 2 [MPa]",
            "a figure",
            1e-6 * float(y[:, P2].max()),
        ),
    ]


def step_response(plant: ServoSystemPlant, step_m: float, *, sign: float = 1.0) -> Step:
    """Return the response to a step of the desired position from rest in the middle.

    Parameters
    ----------
    plant : ServoSystemPlant
        The servosystem.
    step_m : float
        Step [m].
    sign : float
        Factor on the damping of the member: -1 as printed, +1 corrected [1].
    """
    p, y, memory = plant.numbers(), np.zeros(STATES), np.zeros(hysteresis.PLAYS)
    rest(0.0, p, y, memory)
    p[BS] *= sign
    out = np.full((round(1e3 * LENGTH_S), STATES), np.nan)
    span(y, memory, p, np.array([step_m, np.nan, 0.0, 0.0]), 1e-3, FIRST_STEP, 1e-6, out)
    load = plant.arm * np.sin(out[:, TH])
    speed = plant.arm * out[:, OM] * np.cos(out[:, TH])
    force = p[KS] * (out[:, XP] - load) + p[BS] * (out[:, VP] - speed)
    time_s: FloatArray = 1e-3 * np.arange(1.0, len(out) + 1.0)
    return Step(time_s, out, load, speed, force)


PAPER = Paper("003", "the hydraulic servosystem", 3, recompute)
