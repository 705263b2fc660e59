# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The model of the hybrid actuator: what is estimated from one cycle and how it predicts."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.robust import NORMAL_975, difference_sigma
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.types import (
    Estimate,
    EstimateStatus,
    MaskCounts,
    ParameterStatus,
    ParameterValue,
)
from valve_twin.core.valves.hybrid_actuator.bench_fits import BENCH_FITS
from valve_twin.core.valves.hybrid_actuator.doubt import Friction, by_constants, pooled_friction
from valve_twin.core.valves.hybrid_actuator.electrical import CoilFit, fit_coil
from valve_twin.core.valves.hybrid_actuator.flight import (
    SHARED,
    FlightFit,
    Flights,
    find_strokes,
    fit_flights,
)
from valve_twin.core.valves.hybrid_actuator.law import AsLaw
from valve_twin.core.valves.hybrid_actuator.parameters import (
    ESTIMATOR,
    NAMES,
    PARAMETERS,
    HybridActuatorOptions,
    refusal_of,
)
from valve_twin.core.valves.hybrid_actuator.plant import (
    INPUTS,
    STRANGERS,
    check_period,
    default_simulation,
)
from valve_twin.core.valves.hybrid_actuator.predictor import (
    N_COEFFICIENTS,
    STATE_SIZE,
    coefficients,
    predict_block,
)
from valve_twin.core.valves.interface import Scale
from valve_twin.core.valves.kit.compiled import CompiledModel
from valve_twin.core.valves.kit.outcome import Evidence, blank, conclude, not_excited, withheld
from valve_twin.core.valves.kit.record import held, usable, whole_refusal
from valve_twin.core.valves.kit.tolerances import Doubt, Tolerated, tolerated

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.types import BoolArray, Cycle, FloatArray, Parameter
    from valve_twin.core.valves.bench_fit import BenchFit

_MAX_CONDITION = 1e5
_REST_SHARE = 6e-3  # of the full scale: a current below it counts as none [1], assumed
_MISFIT = 1.3
"""Flights' residual over the noise at rest above which the model is another valve's, assumed."""

_MISFIT_FLOOR = 6e-5
"""Residual that counts as none, of the stroke [1]: currents between samples are straight lines."""

_SIDES = ("opener", "closer")
_FLIGHT = (*SHARED, "natural_frequency", "damping_ratio", "rubbing", "coulomb_friction")

_FEWEST_AT_REST = 12  # fewest samples on a seat that show the noise, assumed
_FEWEST = 50  # fewest usable samples of a cycle, assumed


@dataclass(frozen=True, slots=True)
class HybridActuatorModel(AsLaw, CompiledModel):
    """Implements `ValveModel` for two solenoids, their currents and one armature."""

    name: str = "hybrid_actuator"
    inputs: tuple[str, ...] = INPUTS
    output: str = "position"
    driven_by: tuple[str, ...] = INPUTS[2:]  # the currents
    parameters: tuple[Parameter, ...] = PARAMETERS
    options: HybridActuatorOptions = field(default_factory=HybridActuatorOptions)
    kernel = predict_block
    state_size = STATE_SIZE
    trend_estimator: str = ESTIMATOR
    normalised: bool = True

    def estimate(
        self, cycle: Cycle, options: HybridActuatorOptions, earlier: Sequence[Estimate] = ()
    ) -> tuple[Estimate, ...]:
        """Estimate coils, spring, damping, magnet and seating speeds from one cycle.

        Parameters
        ----------
        cycle : Cycle
            One opening and one closing, sampled every 0.25 ms or faster.
        options : HybridActuatorOptions
            The model's options.
        earlier : sequence of Estimate
            Their Coulomb friction is pooled with that of this cycle.

        Returns
        -------
        tuple of Estimate
            One estimate; REFUSED with its reason where the cycle says nothing.
        """
        known = usable(cycle.frames)
        refusal = _refusal(cycle, options, known)
        if refusal:
            return (_estimate(cycle, blank(NAMES, refusal), refused=refusal),)
        record = _record(cycle, options, known)
        values = {p.name: p for p in _electrical(cycle, options, record, known)}
        strokes = find_strokes(cycle.frames.position, known, cycle.period_s)
        fit = fit_flights(record, strokes, options.armature(), options.magnetics())
        values.update({p.name: p for p in _mechanical(fit, options, cycle, known, earlier)})
        return (_estimate(cycle, tuple(values[n] for n in NAMES), fit=fit),)

    def scales(self, options: HybridActuatorOptions) -> dict[str, Scale]:
        """Return millimetres, volts and amperes, as `ValveModel.scales`."""
        travel = 2e3 * options.half_travel
        place = Scale("mm", travel, 0.0, f"0 = closed seat, {travel:g} = open seat")
        volts, amperes = Scale("V", options.supply_voltage), Scale("A", options.current_scale)
        scales = (volts, volts, amperes, amperes, place)
        return dict(zip((*self.inputs, self.output), scales, strict=True))

    def bench_fits(self) -> tuple[BenchFit, ...]:
        """Return the kinds of bench records, as `ValveModel.bench_fits`."""
        return BENCH_FITS

    def coefficients(
        self,
        values: Mapping[str, float],
        lag: int,
        period_s: float,
        options: HybridActuatorOptions,
    ) -> FloatArray:
        """Return the coefficients, parameters as `ValveModel.coefficients`.

        What is not estimated comes from the options.
        """
        del lag
        if refusal_of(options):
            return np.full(N_COEFFICIENTS, np.nan)
        known = {name: value for name, value in values.items() if np.isfinite(value)}
        return coefficients(
            options.armature(known), options.magnetics(known), options.current_scale, period_s
        )

    def strangers(self) -> Mapping[str, Mapping[str, object]]:
        """Return valves that are not as the options say."""
        return STRANGERS

    def simulation(self) -> SimulationConfig:
        """Return the default simulation."""
        return default_simulation()


def _refusal(cycle: Cycle, options: HybridActuatorOptions, known: BoolArray) -> str:
    if conflict := refusal_of(options):
        return Refusal(RefusalCode.OPTIONS, conflict)
    if slow := check_period(cycle.period_s):
        return Refusal(RefusalCode.WRONG_PERIOD, slow)
    why = "pulses and flights are timed by counting samples"
    return whole_refusal(cycle, known, _FEWEST, why)


def _record(cycle: Cycle, options: HybridActuatorOptions, known: BoolArray) -> Flights:
    """Return position and currents in SI units; unusable samples repeat the last usable one."""
    scale, travel = options.current_scale, options.half_travel
    inputs = held(cycle.frames.inputs, known)
    return Flights(
        position=travel * (2.0 * held(cycle.frames.position, known) - 1.0),
        opener=np.ascontiguousarray(inputs[:, 2] * scale),
        closer=np.ascontiguousarray(inputs[:, 3] * scale),
        known=known,
        period_s=cycle.period_s,
    )


def _electrical(
    cycle: Cycle, options: HybridActuatorOptions, record: Flights, known: BoolArray
) -> list[ParameterValue]:
    constants = tolerated(options)
    found: list[ParameterValue] = []
    for column, side in enumerate(_SIDES):
        fit = _fit_side(cycle, options, record, known, column)
        if fit.reason:
            names = (f"resistance_{side}", f"inductance_{side}")
            found += blank(names, fit.reason, ParameterStatus.NOT_EXCITED)
            continue
        moved = np.empty((2, len(constants.names)))
        for k, (name, sigma) in enumerate(zip(constants.names, constants.sigmas, strict=True)):
            changed = replace(options, **{name: getattr(options, name) * (1.0 + float(sigma))})
            moving = _record(cycle, changed, known)
            aside = _fit_side(cycle, changed, moving, known, column, rounded=False)
            moved[:, k] = aside.resistance - fit.resistance, aside.inductance - fit.inductance
        doubts = (
            Doubt(row, constants.names, other)
            for row, other in zip(moved, fit.rounding, strict=True)
        )
        values = (("resistance", fit.resistance), ("inductance", fit.inductance))
        found += [
            doubt.around(f"{what}_{side}", value)
            for (what, value), doubt in zip(values, doubts, strict=True)
        ]
    return found


def _fit_side(
    cycle: Cycle,
    options: HybridActuatorOptions,
    record: Flights,
    known: BoolArray,
    column: int,
    *,
    rounded: bool = True,
) -> CoilFit:
    """Return resistance and inductance of the opener (0) or the closer (1)."""
    travel, residual = options.half_travel, options.residual_gap
    sign = -1.0 if column == 0 else 1.0
    current = record.opener if column == 0 else record.closer
    voltage = np.nan_to_num(cycle.frames.inputs[:, column])
    return fit_coil(
        np.ascontiguousarray(voltage * options.supply_voltage),
        current,
        travel + residual + sign * np.clip(record.position, -travel, travel),
        known,
        options.magnetics(),
        period_s=cycle.period_s,
        rest=_REST_SHARE * options.current_scale,
        seat_gap=residual,
        rounded=rounded,
    )


def _mechanical(
    fit: FlightFit | None,
    options: HybridActuatorOptions,
    cycle: Cycle,
    known: BoolArray,
    earlier: Sequence[Estimate],
) -> list[ParameterValue]:
    if fit is None:
        reason = "the armature did not cross from seat to seat"
        return [*blank(NAMES[4:], reason, ParameterStatus.NOT_EXCITED)]
    constants = tolerated(options)
    moved = by_constants(fit, lambda o: _record(cycle, o, known), options, constants)
    status, reason = _doubt(fit, cycle, 2.0 * options.half_travel)
    values: list[ParameterValue] = []
    if reason:
        values += blank(_FLIGHT, reason, status)
    else:
        values += _told(fit, options, moved[:3], constants, pooled_friction(fit, earlier))
    for opening, side in ((True, "open"), (False, "closed")):
        values += _seating(fit, opening, side, cycle.period_s, moved[3:], constants)
    return values


def _told(
    fit: FlightFit,
    options: HybridActuatorOptions,
    moved: FloatArray,
    constants: Tolerated,
    friction: Friction,
) -> list[ParameterValue]:
    """Return spring, damping, magnet, Coulomb friction and what follows from them."""
    rubbing, option, mass = fit.rubbing, options.coulomb_friction, options.mass
    shown = friction.shown(option)
    spring, damping, magnet = (float(v) for v in (rubbing.values if shown else fit.values))
    unsure = 0.0 if shown else float(np.hypot(friction.mean - option, friction.error))
    frequency = float(np.sqrt(spring / mass))
    critical = 2.0 * float(np.sqrt(max(spring * mass, 1e-300)))
    ratio = damping / critical
    k, c, m = np.column_stack([moved, unsure * rubbing.slopes])
    heavier = np.append(np.array(constants.names) == "mass", False)
    by_mass = heavier * np.append(constants.sigmas, 0.0)
    rows = (
        ("spring_rate", spring, k),
        ("damping", damping, c),
        ("magnet_force", magnet, m),
        ("natural_frequency", frequency, frequency * 0.5 * (k / spring - by_mass)),
        ("damping_ratio", ratio, c / critical - 0.5 * ratio * (k / spring + by_mass)),
    )
    names = (*constants.names, "coulomb_friction")
    found = [Doubt(row, names).around(name, value) for name, value, row in rows]
    half = NORMAL_975 * rubbing.error
    low, high = rubbing.friction - half, rubbing.friction + half
    alone = ParameterValue(
        "rubbing", rubbing.friction, ParameterStatus.OK, "", rubbing.error, low, high
    )
    hidden = f"{friction.mean:.2g} N, its standard error is {friction.error:.2g}: damping holds it"
    coulomb = not_excited("coulomb_friction", hidden)
    if shown:
        coulomb = replace(alone, name="coulomb_friction", reason="damping is freed of it")
    return [*found, alone, coulomb]


def _doubt(fit: FlightFit, cycle: Cycle, stroke: float) -> tuple[ParameterStatus, str]:
    """Return why spring, damping and magnet cannot be used, and as what; empty if they can."""
    if fit.condition > _MAX_CONDITION:
        reason = f"the flights do not tell it apart: condition {fit.condition:.2g}"
        return ParameterStatus.NOT_EXCITED, reason
    noise = _rest_noise(cycle) * stroke
    if not np.isfinite(noise):
        return ParameterStatus.REFUSED, "no rest on a seat tells the noise to judge the flights by"
    limit = float(np.hypot(_MISFIT * noise, _MISFIT_FLOOR * stroke))
    if fit.rms > limit:
        reason = (
            f"the flights leave {1e6 * fit.rms:.1f} um, the noise is {1e6 * noise:.1f} um: a "
            "force is missing or an option is wrong (gas_force, mass, gap, kernel)"
        )
        return ParameterStatus.REFUSED, reason
    return ParameterStatus.OK, ""


def _seating(
    fit: FlightFit,
    opening: bool,
    side: str,
    period_s: float,
    moved: FloatArray,
    constants: Tolerated,
) -> list[ParameterValue]:
    """Return speed at the seat and flight time of the first stroke in a direction."""
    for stroke, speed, row in zip(fit.strokes, fit.seating, moved, strict=True):
        if stroke.opening is opening and np.isfinite(speed):
            lasted = (stroke.end - stroke.first) * period_s
            return [
                Doubt(row, constants.names).around(f"seating_speed_{side}", speed),
                ParameterValue(f"flight_time_{side}", lasted),
            ]
    reason = f"no stroke reached the {side} seat"
    names = (f"seating_speed_{side}", f"flight_time_{side}")
    return [*blank(names, reason, ParameterStatus.NOT_EXCITED)]


def _estimate(
    cycle: Cycle,
    values: tuple[ParameterValue, ...],
    *,
    fit: FlightFit | None = None,
    refused: str = "",
) -> Estimate:
    judged = withheld([v for v in values if v.name != "coulomb_friction"])
    if refused or all(not np.isfinite(v.value) for v in values):
        still = Refusal(RefusalCode.NOT_EXCITED, "neither pulse nor stroke in the cycle")
        judged = EstimateStatus.REFUSED, refused or still
    bad = len(cycle.frames) - int(np.count_nonzero(usable(cycle.frames)))
    noise = float("nan") if refused else _rest_noise(cycle)
    evidence = Evidence(MaskCounts(0, bad=bad), noise=noise)
    if fit is not None:
        evidence = Evidence(MaskCounts(fit.used, bad=bad), fit.condition, noise)
    return conclude("hybrid_actuator", ESTIMATOR, cycle, values, judged, evidence)


def _rest_noise(cycle: Cycle) -> float:
    """Return the noise of the seated position [1] from second differences, NaN without rest."""
    position = cycle.frames.position
    steps = np.diff(position, 2)
    rest = np.abs(position[1:-1] - np.round(position[1:-1])) < 5e-3
    calm = steps[rest & np.isfinite(steps)]
    if len(calm) < _FEWEST_AT_REST:
        return float("nan")
    return difference_sigma(calm, 2)


MODEL = HybridActuatorModel()
