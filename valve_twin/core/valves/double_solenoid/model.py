# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The model of the double-solenoid valve: what is estimated from one cycle, how it predicts."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.diagnosis.generic.features import feature_set
from valve_twin.core.estimation.data.robust import difference_sigma
from valve_twin.core.physics.coenergy import linear_map
from valve_twin.core.physics.coenergy_tables import CoenergyTables
from valve_twin.core.physics.solenoid_map import CURRENT_NODES
from valve_twin.core.quantity import QuantityError
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.types import (
    Estimate,
    EstimateStatus,
    MaskCounts,
    ParameterStatus,
    ParameterValue,
)
from valve_twin.core.valves.double_solenoid.bench_fits import BENCH_FITS
from valve_twin.core.valves.double_solenoid.designed import (
    doubt_lists,
    follow_step,
    map_lists,
    margin_of,
    numbers_of,
)
from valve_twin.core.valves.double_solenoid.dimensions.apart import tell_apart
from valve_twin.core.valves.double_solenoid.dimensions.estimate import judge_cycle
from valve_twin.core.valves.double_solenoid.dimensions.published import ESTIMATOR as DIMENSIONS
from valve_twin.core.valves.double_solenoid.dimensions.table import options_of
from valve_twin.core.valves.double_solenoid.eddy.fit import EddyFit, fit_eddies, named
from valve_twin.core.valves.double_solenoid.motion import MotionFit, fit_motion
from valve_twin.core.valves.double_solenoid.parameters import (
    BRANCHES,
    COILS,
    EDDIES,
    ESTIMATOR,
    MECHANICAL,
    NAMES,
    PARAMETERS,
    DoubleSolenoidOptions,
    constants_of,
    doubted,
    known_valve,
)
from valve_twin.core.valves.double_solenoid.plant import (
    INPUTS,
    STRANGERS,
    DoubleSolenoidPlant,
    default_simulation,
)
from valve_twin.core.valves.double_solenoid.predictor import (
    N_COEFFICIENTS,
    STATE_SIZE,
    coefficients,
    predict_block,
    predict_map,
)
from valve_twin.core.valves.double_solenoid.record import (
    Record,
    coil_of,
    longest_part,
    make_record,
    warm_resistances,
)
from valve_twin.core.valves.interface import Demonstration, Scale
from valve_twin.core.valves.kit.compiled import CompiledModel
from valve_twin.core.valves.kit.outcome import Evidence, blank, conclude, withheld
from valve_twin.core.valves.kit.record import usable, whole_refusal
from valve_twin.core.valves.kit.tolerances import Doubt

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from valve_twin.core.diagnosis.features import FeatureSet
    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.types import BoolArray, Cycle, FloatArray, Parameter
    from valve_twin.core.valves.bench_fit import BenchFit
    from valve_twin.core.valves.designed import Apart, Designed, Loop, Numbers, Wear

LONGEST_PERIOD_S = 2e-4
"""Slowest sampling that shows the force behind currents that change in 0.3 ms [s], assumed."""

_FEWEST = 500  # fewest usable samples of a cycle, assumed
_MIN_TRAVEL = 0.02  # of half the stroke: less motion shows no friction [1], assumed
_MAX_CONDITION = 300.0
_MISFIT = 3.0
"""Residual of the motion over the noise at rest above which it is another valve, assumed."""

_MAX_NOISE = 0.02  # of half the stroke: more is no sensor's noise [1], assumed
_MISFIT_FLOOR = 1e-3
"""Residual that counts as none, of half the stroke [1]: ripple of the currents, assumed."""

_FEATURE_SET = feature_set(
    exclude=("gain_up", "gain_down"),  # near an end the free run drifts away by itself
    least={"unfollowed": 0.1},  # so it may miss the end of one move of nine
    by_model=True,
)


_SHOWN = Demonstration(rate=0.5, file="designed_solenoid.yaml")  # half a core for its control


@dataclass(frozen=True, slots=True)
class DoubleSolenoidModel(CompiledModel):
    """Implements `ValveModel` for two coils, their voltages and currents, and one spool."""

    name: str = "double_solenoid"
    inputs: tuple[str, ...] = INPUTS
    output: str = "position"
    driven_by: tuple[str, ...] = INPUTS[3:]  # the currents
    parameters: tuple[Parameter, ...] = PARAMETERS
    options: DoubleSolenoidOptions = field(default_factory=DoubleSolenoidOptions)
    kernel = predict_block
    state_size = STATE_SIZE
    follows = "setpoint"
    reach_s = 0.02
    trend_estimator: str = ESTIMATOR
    normalised: bool = True
    feature_set: FeatureSet = _FEATURE_SET
    demonstration: Demonstration = _SHOWN

    def estimate(
        self, cycle: Cycle, options: DoubleSolenoidOptions, earlier: Sequence[Estimate] = ()
    ) -> tuple[Estimate, ...]:
        """Estimate coils, force gain, friction and preload from one cycle.

        Parameters
        ----------
        cycle : Cycle
            Some steps of the setpoint, sampled every 0.2 ms or faster.
        options : DoubleSolenoidOptions
            The model's options.
        earlier : sequence of Estimate
            What the dimensions are compared with; nothing is pooled.

        Returns
        -------
        tuple of Estimate
            One an estimator; REFUSED with its reason where the cycle says nothing.
        """
        known = usable(cycle.frames, first_input=1)
        valve, refusal = _valve(options)
        refusal = refusal or _refusal(cycle, known)
        if refusal or valve is None:
            return (_estimate(cycle, blank(NAMES, refusal), known, refused=refusal),)
        record = make_record(cycle.frames, known, cycle.period_s, valve)
        refusal = _beyond(record, valve)
        if refusal:
            return (_estimate(cycle, blank(NAMES, refusal), known, refused=refusal),)
        branches, given = _branches(record, valve, options), (valve, record)
        if branches is not None:
            valve = known_valve(options, named(branches.numbers))
            record = make_record(cycle.frames, known, cycle.period_s, valve)
        constants = constants_of(options)
        here = valve, record
        aside = _aside(cycle, options, here, branches)
        names = (*constants.names, *options.map_doubt_names)
        coils = _coils(here, aside, names)
        variations = [(r, v.valve(), v.tables()) for v, r in aside]
        fit = fit_motion(record, valve.valve(), valve.tables(), variations)
        noise = _rest_noise(record.x)
        values = (*coils, *_mechanical(fit, valve, noise, names))
        values += () if branches is None else branches.values()
        balance = _estimate(cycle, values, known, fit=fit, valve=valve)
        if DIMENSIONS not in options.estimators:
            return (balance,)
        valve, record = given  # with the eddy currents of the options: they would hide wear
        if branches is not None:
            fit = fit_motion(record, valve.valve(), valve.tables())
        told, guards = judge_cycle(cycle, (record, fit), valve, options, earlier)
        return replace(balance, guards=guards), told

    @property
    def variants(self) -> tuple[Mapping[str, object], ...]:  # type: ignore[override]
        """A map of both coils, on which further kernels run."""
        return (map_lists(linear_map(0.04, -8e-3, 2.5e-3, 4, 4)),)

    def kernel_of(self, coefficients: FloatArray) -> Callable[..., None]:
        """Return the kernel that takes these coefficients (K,)."""
        return predict_block if len(coefficients) == N_COEFFICIENTS else predict_map

    def scales(self, options: DoubleSolenoidOptions) -> dict[str, Scale]:
        """Return millimetres, volts and amperes, as `ValveModel.scales`."""
        half = 1e3 * options.half_stroke
        place = Scale("mm", 2.0 * half, -half, "port B opens below 0, port A above")
        volts, amperes = Scale("V", options.supply_voltage), Scale("A", options.current_scale)
        scales = (place, volts, volts, amperes, amperes, place)
        return dict(zip((*self.inputs, self.output), scales, strict=True))

    def bench_fits(self) -> tuple[BenchFit, ...]:
        """Return the kinds of bench records, as `ValveModel.bench_fits`."""
        return BENCH_FITS

    def coefficients(
        self,
        values: Mapping[str, float],
        lag: int,
        period_s: float,
        options: DoubleSolenoidOptions,
    ) -> FloatArray:
        """Return the coefficients, parameters as `ValveModel.coefficients`.

        What is not estimated comes from the options.
        """
        del lag
        told = (*NAMES, *(f"{EDDIES}{n}" for n in BRANCHES))
        finite = {n: v for n, v in values.items() if n in told and np.isfinite(v)}
        try:
            return coefficients(known_valve(options, finite), period_s)
        except ValueError:
            return np.full(N_COEFFICIENTS, np.nan)

    def strangers(self) -> Mapping[str, Mapping[str, object]]:
        """Return valves that are not as the options say."""
        return STRANGERS

    def of_design(self, found: Designed) -> Numbers:
        """Return a designed solenoid's numbers, as `Designable.of_design`."""
        return numbers_of(found)

    def loop(
        self, numbers: Numbers, share: float, changes: Mapping[str, float], start: float = 0.0,
        draw: int = 0,
    ) -> Loop:  # fmt: skip
        """Follow a step of the setpoint, parameters as `Designable.loop`."""
        return follow_step(numbers, share, changes, start, draw)

    def force_margin(self, numbers: Numbers) -> float:
        """Return the force that is left, as `Designable.force_margin`."""
        return margin_of(numbers)

    def of_wear(self, wear: Sequence[Wear]) -> Mapping[str, object]:
        """Return the options that name a dimension, as `Designable.of_wear`."""
        chosen = {"estimators": (ESTIMATOR, FEATURES, DIMENSIONS)}
        return {**options_of(wear), **chosen}

    def of_doubts(self, doubts: Sequence[Wear]) -> Mapping[str, object]:
        """Return the options that hold doubts about the map, as `Designable.of_doubts`."""
        return doubt_lists(doubts)

    def told_apart(self, numbers: Numbers, wear: Sequence[Wear]) -> Apart:
        """Return which dimensions a cycle tells apart, as `Designable.told_apart`."""
        return tell_apart(numbers, wear)

    def simulation(self) -> SimulationConfig:
        """Return the default simulation."""
        return default_simulation()


def _valve(options: DoubleSolenoidOptions) -> tuple[DoubleSolenoidPlant | None, str]:
    """Return the valve of the options, or why there is none."""
    try:
        for other in doubted(options):
            known_valve(other, {}).tables()
        return known_valve(options, {}), ""
    except QuantityError as error:
        return None, Refusal(RefusalCode.OPTIONS, error.reason)
    except ValueError as error:  # of the curves
        return None, Refusal(RefusalCode.OPTIONS, str(error))


def _refusal(cycle: Cycle, known: BoolArray) -> str:
    if cycle.period_s > LONGEST_PERIOD_S:
        text = (
            f"sampled every {cycle.period_s:g} s: currents that change in 0.3 ms need "
            f"{LONGEST_PERIOD_S:g} s or faster"
        )
        return Refusal(RefusalCode.WRONG_PERIOD, text)
    why = "voltages and currents are summed up over the samples"
    return whole_refusal(cycle, known, _FEWEST, why)


def _beyond(record: Record, valve: DoubleSolenoidPlant) -> str:
    """Return why the currents cannot be those of this valve, empty if they can."""
    m = valve.tables()
    end = m.largest if isinstance(m, CoenergyTables) else (CURRENT_NODES - 1) / m.per_current
    largest = float(max(np.abs(record.current_a).max(), np.abs(record.current_b).max()))
    if largest <= end:
        return ""
    text = f"a current of {largest:.3g} A lies beyond the curves, which end at {end:g} A"
    return Refusal(RefusalCode.IMPLAUSIBLE, text)


def _branches(
    record: Record, valve: DoubleSolenoidPlant, options: DoubleSolenoidOptions
) -> EddyFit | None:
    """Return the eddy currents by the flux balance, where there are any and it can be had."""
    if not valve.eddies.gain_1:
        return None
    widths = np.array([attrgetter(f"{EDDIES}{n}")(options.tolerances) for n in BRANCHES])
    return fit_eddies(record, valve, warm_resistances(record, valve), widths)


def _aside(
    cycle: Cycle,
    options: DoubleSolenoidOptions,
    here: tuple[DoubleSolenoidPlant, Record],
    branches: EddyFit | None,
) -> list[tuple[DoubleSolenoidPlant, Record]]:
    """Return valve and record with each constant, then the map, moved by standard deviations.

    Eddy currents that were fitted move by their standard errors, and with every constant that
    the flux balance depends on.
    """
    constants = constants_of(options)
    moved, (ours, record) = [], here
    found = {} if branches is None else named(branches.numbers)
    errors = {} if branches is None else named(branches.errors)

    def seen(at: DoubleSolenoidOptions, given: Mapping[str, float]) -> DoubleSolenoidPlant:
        valve = known_valve(at, {**found, **given})
        same = valve.tables() is ours.tables() and _seen_by(valve) == _seen_by(ours)
        if branches is None or same or any(name in found for name in given):
            return valve
        first = make_record(cycle.frames, record.known, cycle.period_s, valve)
        return known_valve(at, {**given, **named(branches.of(first, known_valve(at, given)))})

    sigmas = dict(zip(constants.names, constants.sigmas.tolist(), strict=True))
    for name in constants.names:
        sigma, value = errors.get(name, sigmas[name]), found.get(name, attrgetter(name)(options))
        try:
            valve = seen(options, {name: value * (1.0 + sigma)})
        except ValueError:  # it stands at its limit: as far the other way
            valve = seen(options, {name: value * (1.0 - sigma)})
        moved.append(valve)
    moved += [seen(other, {}) for other in doubted(options)]
    return [
        (v, record)
        if _seen_by(v) == _seen_by(ours)
        else (v, make_record(cycle.frames, record.known, cycle.period_s, v))
        for v in moved
    ]


def _seen_by(valve: DoubleSolenoidPlant) -> tuple[object, ...]:
    """Return the numbers that a record depends on."""
    return valve.half_stroke, valve.current_scale, valve.supply_voltage, valve.eddies


def _coils(
    here: tuple[DoubleSolenoidPlant, Record],
    aside: list[tuple[DoubleSolenoidPlant, Record]],
    names: tuple[str, ...],
) -> list[ParameterValue]:
    """Return the resistances; they need every sample, their sums have no room for gaps."""
    known = here[1].known
    part = longest_part(known)
    if part.stop - part.start < _FEWEST and not known.all():
        bad = int(np.count_nonzero(~known))
        return list(blank(COILS, f"{bad} samples cannot be used, no long part is whole"))
    values: list[ParameterValue] = []
    for column, name in enumerate(COILS):
        fit = coil_of(here[1], here[0], part, column)
        if fit.reason:
            status = ParameterStatus.REFUSED if fit.refused else ParameterStatus.NOT_EXCITED
            values += blank((name,), fit.reason, status)
            continue
        others = [
            coil_of(r, v, part, column).resistance if _shows((v, r), here) else fit.resistance
            for v, r in aside
        ]
        moved = np.nan_to_num(np.array(others) - fit.resistance, nan=fit.resistance)
        values.append(Doubt(moved, names).around(name, fit.resistance))
    return values


def _shows(
    one: tuple[DoubleSolenoidPlant, Record], here: tuple[DoubleSolenoidPlant, Record]
) -> bool:
    """Whether what is aside changes anything that a resistance is found from."""
    (valve, record), (ours, measured) = one, here
    return not (valve.tables() is ours.tables() and record is measured)


def _mechanical(
    fit: MotionFit | None, valve: DoubleSolenoidPlant, noise: float, names: tuple[str, ...]
) -> tuple[ParameterValue, ...]:
    status, reason = _doubt(fit, valve, noise)
    if fit is None or reason:
        return blank(MECHANICAL, reason, status)
    found = zip(MECHANICAL, fit.values.tolist(), fit.moved, strict=True)
    return tuple(Doubt(row, names).around(name, value) for name, value, row in found)


def _doubt(
    fit: MotionFit | None, valve: DoubleSolenoidPlant, noise: float
) -> tuple[ParameterStatus, str]:
    """Return why the motion cannot be used, and as what; empty if it can."""
    if fit is None:
        return ParameterStatus.NOT_EXCITED, "no three parts of 10 ms are whole and off the stops"
    if fit.travel < _MIN_TRAVEL * valve.half_stroke:
        reason = f"the spool moved by {1e6 * fit.travel:.2f} um: no friction shows"
        return ParameterStatus.NOT_EXCITED, reason
    if not fit.condition <= _MAX_CONDITION:
        reason = f"the motion does not tell it apart: condition {fit.condition:.2g}"
        return ParameterStatus.NOT_EXCITED, reason
    if not noise <= _MAX_NOISE * valve.half_stroke:
        reason = f"the position jumps by {1e6 * noise:.1f} um from sample to sample: not a spool"
        return ParameterStatus.REFUSED, reason
    limit = float(np.hypot(_MISFIT * noise, _MISFIT_FLOOR * valve.half_stroke))
    if not fit.rms <= limit:
        reason = (
            f"the motion leaves {1e6 * fit.rms:.2f} um, the noise is {1e6 * noise:.2f} um: a "
            "force is missing, coils are exchanged or an option is wrong (mass, springs, curves)"
        )
        return ParameterStatus.REFUSED, reason
    return ParameterStatus.OK, ""


def _rest_noise(x: FloatArray) -> float:
    """Return the noise of the position [m] from its second differences."""
    return difference_sigma(np.diff(x, 2), 2)


def _estimate(
    cycle: Cycle,
    values: tuple[ParameterValue, ...],
    known: BoolArray,
    *,
    fit: MotionFit | None = None,
    valve: DoubleSolenoidPlant | None = None,
    refused: str = "",
) -> Estimate:
    judged = withheld(values)
    if refused or all(not np.isfinite(v.value) for v in values):
        hidden = Refusal(RefusalCode.NOT_EXCITED, values[0].reason)
        judged = EstimateStatus.REFUSED, refused or hidden
    noise = float("nan")
    if valve is not None:
        noise = _rest_noise(np.nan_to_num(cycle.frames.position[known]))
    bad = int(np.count_nonzero(~known))
    evidence = Evidence(MaskCounts(0, bad=bad), noise=noise)
    if fit is not None:
        evidence = Evidence(MaskCounts(fit.used, bad=bad), fit.condition, noise)
    return conclude("double_solenoid", ESTIMATOR, cycle, values, judged, evidence)


MODEL = DoubleSolenoidModel()
