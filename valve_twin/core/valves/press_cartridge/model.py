# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The press cartridge valve: what is identified from one cycle, and how it predicts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from valve_twin.core.diagnosis import features
from valve_twin.core.diagnosis.features import FeatureOptions, cycle_features
from valve_twin.core.estimation.cycle.plausibility import (
    LARGEST,
    drive_fault,
    known_rows,
    same_fault,
    still_fault,
    unit_fault,
)
from valve_twin.core.estimation.data.masks import MaskOptions, Masks, find_masks
from valve_twin.core.estimation.data.noise import rest_noise
from valve_twin.core.types import (
    ByteArray,
    Cycle,
    Estimate,
    EstimateStatus,
    FloatArray,
    Guard,
    MaskCounts,
    Parameter,
    ParameterValue,
)
from valve_twin.core.valves.interface import Option, Options, ValveModel, number
from valve_twin.core.valves.press_cartridge.estimation import kalman, output_error
from valve_twin.core.valves.press_cartridge.estimation.checks import check_gap
from valve_twin.core.valves.press_cartridge.estimation.constraints import THETA, parse_inequalities
from valve_twin.core.valves.press_cartridge.estimation.equation_error import (
    ESTIMATORS as EQUATION_ERROR,
)
from valve_twin.core.valves.press_cartridge.estimation.equation_error import (
    EquationErrorOptions,
    fit_equation_error,
)
from valve_twin.core.valves.press_cartridge.estimation.free_run import OutputErrorOptions
from valve_twin.core.valves.press_cartridge.estimation.guards import GuardOptions
from valve_twin.core.valves.press_cartridge.estimation.kalman import fit_kalman, pool_ratios
from valve_twin.core.valves.press_cartridge.estimation.lag import LagScan, scan_lag
from valve_twin.core.valves.press_cartridge.estimation.output_error import fit_output_error
from valve_twin.core.valves.press_cartridge.plant import default_simulation
from valve_twin.core.valves.press_cartridge.predictor import (
    COEFFICIENTS,
    MAX_LAG,
    STATE,
    predict_block,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.simulation.config import SimulationConfig

_GAIN = "1/sample of stroke per unit command"

PARAMETERS = (
    Parameter(
        "pole", "1", "pole of the spool speed, z = 1 + theta_1 (paper 002, eq. (17))", 0.0, 1.0
    ),
    Parameter(
        "K_in",
        "1",
        f"steady inflow gain theta_2/(-theta_1) at v_in_mean, {_GAIN}",
        0.0,
        trend=True,
    ),
    Parameter(
        "K_in_slope",
        "1",
        "change of the inflow gain with the command (pilot saturation)",
        upper=0.0,
    ),
    Parameter(
        "v_in_mean", "1", "displacement-weighted mean inflow command of the cycle", 0.0, 1.0
    ),
    Parameter(
        "K_out",
        "1",
        f"steady outflow gain -(theta_3 + theta_5 v)/(-theta_1) at v_ref, {_GAIN}",
        0.0,
        trend=True,
    ),
    Parameter(
        "K_out_slope",
        "1",
        "change of the outflow gain with the command, theta_5/theta_1",
        upper=0.0,
    ),
    Parameter("leak", "1/s", "loss of stroke off the seat", 0.0, trend=True),
    Parameter(
        "noise_ratio", "1", "kalman: variance of process noise over that of measurement noise", 0.0
    ),
    Parameter("theta_1", "1", "paper 002, eq. (18): speed"),
    Parameter("theta_2", "1", "paper 002, eq. (18): inflow command"),
    Parameter("theta_3", "1", "paper 002, eq. (18): outflow command"),
    Parameter("theta_4", "1", "paper 002, eq. (18): inflow command squared"),
    Parameter("theta_5", "1", "paper 002, eq. (18): outflow command squared"),
    Parameter("theta_6", "1", "paper 002, eq. (18): product of the commands"),
    Parameter("theta_7", "1", "paper 002, eq. (18): inflow command times speed"),
    Parameter("theta_8", "1", "paper 002, eq. (18): outflow command times speed"),
    *features.FEATURES,
)

OPTIONS = (
    Option(
        "estimators",
        [output_error.ESTIMATOR, kalman.ESTIMATOR, "equation_error_qp4"],
        "estimators to run",
        choices=(
            output_error.ESTIMATOR,
            kalman.ESTIMATOR,
            *EQUATION_ERROR,
            features.ESTIMATOR,
        ),
    ),
    Option(
        "output_error",
        True,
        "run the output error in every cycle, which trend and prediction need; false = only the "
        "estimators listed, each cycle by itself, without test errors and intervals: to "
        "re-estimate an archive by constrained least squares",
    ),
    Option("v_ref", 0.3, "outflow command at which K_out is published [A]", "1", 0.0, 1.0),
    Option("v_max", 0.8, "greatest command: gains are positive up to it [A]", "1", 0.01, 1.0),
    Option(
        "lag", -1, "command to position lag, -1 = search in each cycle", "samples", -1, MAX_LAG
    ),
    Option("max_lag", 4, "longest lag tried", "samples", 0, MAX_LAG),
    Option("pole_fixed", -1.0, "pole of the output error, -1 = search", "1", -1.0, 0.98),
    Option(
        "wander",
        0.03,
        "random walk of the level in motion, variance a sample over noise variance [A]",
        "1",
        0.0,
        1e6,
    ),
    Option("lower_seat", 0.0, "position on the lower seat", "1", -1.0, 2.0),
    Option("upper_seat", 1.0, "position on the upper seat", "1", -1.0, 2.0),
    Option("seat_margin", 0.01, "distance from a seat that counts as on it [A]", "1", 0.0, 0.2),
    Option("v_offset_in", 0.0, "inflow command below which the pilots stay shut", "1", 0.0, 0.5),
    Option("v_offset_out", 0.0, "outflow command below which the pilots stay shut", "1", 0.0, 0.5),
    Option("active_command", 0.01, "command above which an input acts [A]", "1", 0.0, 0.5),
    Option("min_travel", 2e-3, "least travel that tells a gain [A]", "1", 0.0, 1.0),
    Option(
        "min_hold", 30, "fewest samples of hold off the seat that tell a leak [A]", "samples", 1
    ),
    Option(
        "extended_constraints",
        True,
        "equation error: also pole and monotone flows at every command, which the paper lacks",
    ),
    Option(
        "constraints",
        cast("list[str]", []),
        'equation error: further linear inequalities, e.g. "theta_2 + 0.3*theta_3 <= 0"',
    ),
    Option("solver", "exact", "solver of the equation error", choices=("exact", "cvxpy")),
)

_PUSH = (1.0, -1.0)

_SHARP = 0.005
"""Least relative rise of the one-step error at any other lag that settles the lag [A].

Below it the one-step error cannot tell and the free run decides. The free run alone prefers one
sample less with a slow pole in a fifth of the cycles that begin with the command (noise 1e-3),
which moves K_out by 4 %.
"""


@dataclass(frozen=True, slots=True)
class PressCartridgeModel(ValveModel):
    """Implements `ValveModel` for the two-stage cartridge valve of paper 002."""

    name: str = "press_cartridge"
    inputs: tuple[str, ...] = ("v_in", "v_out")
    output: str = "spool_position"
    parameters: tuple[Parameter, ...] = PARAMETERS
    options: tuple[Option, ...] = OPTIONS
    trend_estimator: str = output_error.ESTIMATOR

    def estimate(
        self, cycle: Cycle, options: Options, earlier: Sequence[Estimate] = ()
    ) -> tuple[Estimate, ...]:
        """Estimate the cycle with every configured estimator, the output error unless it is off.

        Parameters
        ----------
        cycle : Cycle
            One cycle of N samples (N > 0).
        options : mapping
            The model's options, complete.
        earlier : sequence of Estimate
            Those of the cycles before, oldest first; their noise ratios are pooled.

        Returns
        -------
        tuple of Estimate
            One an estimator; REFUSED with its reason where the cycle says nothing.
        """
        frames = cycle.frames
        masks = find_masks(frames, cycle.period_s, push=_PUSH, options=_mask_options(options))
        sigma = rest_noise(frames, masks, active_command=number(options, "active_command")).sigma
        scan = _scan(cycle, masks, options)
        always = (self.trend_estimator,) if options["output_error"] else ()
        names = dict.fromkeys((*always, *_names(options, "estimators")))
        results = []
        for name in names:
            if name == features.ESTIMATOR:
                results.append(self._features(cycle, masks, sigma, options))
            elif name in EQUATION_ERROR:
                results.append(self._equation_error(name, cycle, masks, sigma, scan, options))
            else:
                results.append(self._gains(name, cycle, masks, sigma, scan, options, earlier))
        return _with_gap(results, options)

    def features(self, cycle: Cycle, options: Options) -> tuple[ParameterValue, ...]:
        """Return what the cycle shows of faults, see `diagnosis.features`."""
        mask = _mask_options(options)
        masks = find_masks(cycle.frames, cycle.period_s, push=_PUSH, options=mask)
        return cycle_features(cycle.frames, masks, cycle.period_s, _feature_options(options))

    def signatures(self) -> SignatureTable:
        """Return how faults change the features, derived by simulation."""
        from valve_twin.core.valves.press_cartridge.signatures import TABLE

        return TABLE

    def judges(self, options: Options) -> bool:
        """Tell whether estimates are judged by the cycles before: not without the output error."""
        return bool(options["output_error"])

    def input_fault(self, cycle: Cycle, options: Options) -> str:
        """Return why the signals cannot be those of a press valve, empty where they can.

        Parameters
        ----------
        cycle : Cycle
            At least one sample.
        options : mapping
            The model's options, complete.
        """
        known = known_rows(cycle.frames)
        if len(known) == 0:
            return ""
        seats = number(options, "lower_seat"), number(options, "upper_seat")
        names, columns = (self.output, *self.inputs), (known.position, *known.inputs.T)
        faults = [
            unit_fault(name, u, LARGEST - 2.0, LARGEST)
            for name, u in zip(self.inputs, columns[1:], strict=True)
        ]
        reach = (LARGEST - 1.0) * (seats[1] - seats[0])
        faults.append(unit_fault(self.output, known.position, seats[0] - reach, seats[1] + reach))
        faults.append(same_fault(names, columns) or still_fault(self.inputs, columns[1:]))
        max_lag = int(number(options, "max_lag"))
        faults.append(
            drive_fault(names, known.position, known.inputs, seats=seats, max_lag=max_lag)
        )
        return next((fault for fault in faults if fault), "")

    def coefficients(
        self, values: Mapping[str, float], lag: int, period_s: float, options: Options
    ) -> FloatArray:
        """Return the (16,) coefficients of `predict`, from gains or from theta.

        NaN stands where a gain that the prediction needs has never been estimated.
        """
        c = np.zeros(COEFFICIENTS)
        if "theta_1" in values:
            c[:8] = [values.get(name, 0.0) for name in THETA]
        else:
            _set_gains(c, values, period_s, options)
        c[9] = min(max(lag, 0), MAX_LAG)
        c[10:] = [
            number(options, name)
            for name in (
                "lower_seat",
                "upper_seat",
                "seat_margin",
                "v_offset_in",
                "v_offset_out",
                "active_command",
            )
        ]
        return c

    def simulation(self) -> SimulationConfig:
        """Return the default simulation."""
        return default_simulation()

    def initial_state(self) -> FloatArray:
        """Return the (22,) state before the first sample."""
        return np.zeros(STATE)

    def predict(
        self,
        state: FloatArray,
        coefficients: FloatArray,
        position: FloatArray,
        inputs: FloatArray,
        restart: ByteArray,
        predicted: FloatArray,
        simulated: FloatArray,
        validity: ByteArray,
    ) -> None:
        """Predict a block of samples; see `ValveModel.predict`."""
        predict_block(
            state,
            coefficients,
            np.ascontiguousarray(position),
            np.ascontiguousarray(inputs),
            restart,
            predicted,
            simulated,
            validity,
        )

    def _gains(
        self,
        name: str,
        cycle: Cycle,
        masks: Masks,
        sigma: float,
        scan: LagScan,
        options: Options,
        earlier: Sequence[Estimate],
    ) -> Estimate:
        settled = scan.lag >= 0 and scan.sharpness >= _SHARP
        chosen = _output_error_options(options, scan.lag if settled else -1)
        data = (cycle.frames, masks, cycle.period_s)
        if name == kalman.ESTIMATOR:
            ratios = [e.value("noise_ratio") for e in earlier if e.estimator == kalman.ESTIMATOR]
            pooled = pool_ratios(np.array(ratios))
            fit = fit_kalman(*data, noise_sigma=sigma, pooled=pooled, options=chosen)
        else:
            fit = fit_output_error(*data, noise_sigma=sigma, options=chosen)
        return self._estimate(
            name,
            cycle,
            fit.parameters,
            (fit.status, fit.reason),
            fit.condition_number,
            fit.lag,
            sigma,
            fit.counts,
            fit.guards,
        )

    def _features(self, cycle: Cycle, masks: Masks, sigma: float, options: Options) -> Estimate:
        shown = cycle_features(cycle.frames, masks, cycle.period_s, _feature_options(options))
        count = sum(p.usable for p in shown)
        whole = count == len(shown)
        status = EstimateStatus.ACCEPTED if whole else EstimateStatus.PARTIAL
        reason = f"{count} of {len(shown)} features of faults are shown"
        counts = MaskCounts(
            int(np.count_nonzero(~masks.any)),
            seat=int(np.count_nonzero(masks.seat)),
            stuck=int(np.count_nonzero(masks.stuck)),
            stale=int(np.count_nonzero(masks.stale)),
            bad=int(np.count_nonzero(masks.bad)),
        )
        return self._estimate(
            features.ESTIMATOR, cycle, shown, (status, reason), np.nan, 0, sigma, counts
        )

    def _equation_error(
        self,
        name: str,
        cycle: Cycle,
        masks: Masks,
        sigma: float,
        scan: LagScan,
        options: Options,
    ) -> Estimate:
        fit = fit_equation_error(
            cycle.frames,
            masks,
            name,
            lag=scan.lag,
            noise_sigma=sigma,
            options=_equation_error_options(options),
        )
        return self._estimate(
            name,
            cycle,
            fit.parameters,
            (fit.status, fit.reason),
            fit.condition_number,
            max(fit.lag, 0),
            sigma,
            fit.counts,
        )

    def _estimate(
        self,
        estimator: str,
        cycle: Cycle,
        parameters: tuple[ParameterValue, ...],
        verdict: tuple[EstimateStatus, str],
        condition_number: float,
        lag: int,
        sigma: float,
        counts: MaskCounts,
        guards: tuple[Guard, ...] = (),
    ) -> Estimate:
        return Estimate(
            model=self.name,
            estimator=estimator,
            parameters=parameters,
            status=verdict[0],
            reason=verdict[1],
            condition_number=condition_number,
            lag=lag,
            noise_sigma=sigma,
            counts=counts,
            used_by_trend=estimator == self.trend_estimator,
            guards=guards,
            **cycle.origin,
        )


def _with_gap(estimates: Sequence[Estimate], options: Options) -> tuple[Estimate, ...]:
    """Hold the gains against those of the equation error, where that was run."""
    paper = next((e for e in estimates if e.estimator in EQUATION_ERROR), None)
    if paper is None:
        return tuple(estimates)
    theta = {p.name: p.value for p in paper.parameters}
    v_ref, guard = number(options, "v_ref"), _guard(options)
    return tuple(
        replace(
            e,
            guards=(
                *e.guards,
                *check_gap({p.name: p.value for p in e.parameters}, theta, v_ref, guard),
            ),
        )
        if e.guards
        else e
        for e in estimates
    )


def _set_gains(
    c: FloatArray, values: Mapping[str, float], period_s: float, options: Options
) -> None:
    """Write theta_1 ... theta_5 and the leak of the output error's parameters."""
    pole = values.get("pole", 0.0)
    share = 1.0 - pole
    slope_in, slope_out = values.get("K_in_slope", 0.0), values.get("K_out_slope", 0.0)
    at_in, at_out = values.get("v_in_mean", 0.0), number(options, "v_ref")
    c[0] = -share
    c[1] = share * (values.get("K_in", np.nan) - slope_in * at_in)
    c[2] = -share * (values.get("K_out", np.nan) - slope_out * at_out)
    c[3] = share * slope_in
    c[4] = -share * slope_out
    c[8] = share * values.get("leak", 0.0) * period_s


def _names(options: Options, name: str) -> list[str]:
    return [str(item) for item in cast("Sequence[object]", options[name])]


def _mask_options(options: Options) -> MaskOptions:
    return MaskOptions(
        lower_stop=number(options, "lower_seat"),
        upper_stop=number(options, "upper_seat"),
        stop_margin=number(options, "seat_margin"),
        active_command=number(options, "active_command"),
        max_lag=int(number(options, "max_lag")),
    )


def _feature_options(options: Options) -> FeatureOptions:
    lag = int(number(options, "lag"))
    return FeatureOptions(
        lower_seat=number(options, "lower_seat"),
        upper_seat=number(options, "upper_seat"),
        active_command=number(options, "active_command"),
        lag=lag if lag >= 0 else FeatureOptions().lag,
    )


def _guard(options: Options) -> GuardOptions:
    return GuardOptions(
        active_command=number(options, "active_command"),
        min_travel=number(options, "min_travel"),
    )


def _scan(cycle: Cycle, masks: Masks, options: Options) -> LagScan:
    """Find the lag, or take the configured one as settled."""
    lag, max_lag = int(number(options, "lag")), int(number(options, "max_lag"))
    if lag >= 0:
        return LagScan(lag, np.full(max_lag + 1, np.nan), np.inf)
    return scan_lag(cycle.frames, masks, max_lag=max_lag)


def _output_error_options(options: Options, lag: int) -> OutputErrorOptions:
    return OutputErrorOptions(
        v_ref=number(options, "v_ref"),
        v_max=number(options, "v_max"),
        lag=lag,
        max_lag=int(number(options, "max_lag")),
        pole=number(options, "pole_fixed"),
        wander=number(options, "wander"),
        lower_seat=number(options, "lower_seat"),
        upper_seat=number(options, "upper_seat"),
        seat_margin=number(options, "seat_margin"),
        offset_in=number(options, "v_offset_in"),
        offset_out=number(options, "v_offset_out"),
        min_hold=int(number(options, "min_hold")),
        guard=_guard(options),
    )


def _equation_error_options(options: Options) -> EquationErrorOptions:
    constraints = _names(options, "constraints")
    return EquationErrorOptions(
        v_in_max=number(options, "v_max"),
        v_out_max=number(options, "v_max"),
        extended=bool(options["extended_constraints"]),
        constraints=parse_inequalities(constraints) if constraints else None,
        solver=str(options["solver"]),
        guard=_guard(options),
    )


MODEL = PressCartridgeModel()
