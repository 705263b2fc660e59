# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Paper 002, the cartridge valve of a press: every published table, recomputed.

The measured data are not public. Table 1 and Fig. 5 are therefore recomputed on the simulated
reference experiment, in two measurement layers that make least squares err as published: a sensor
refreshed every third or every fourth sample, 0.4 % noise. Tables 3 to 5 and the poles follow from
the paper's own numbers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.trend import fit_line, quantile
from valve_twin.validation.check import (
    Check,
    Kind,
    cannot,
    within_factor,
    within_range,
    within_share,
)
from valve_twin.validation.layers_002 import (
    ESTIMATORS,
    Layer,
    LayerFits,
    fit_layer,
    outflow_gain,
    strongest,
)
from valve_twin.validation.registry import Paper
from valve_twin.validation.theory_002 import (
    FITTED,
    PERIOD_S,
    PUBLISHED,
    PUBLISHED_BOX,
    PUBLISHED_ERRORS,
    PUBLISHED_MSE,
    PUBLISHED_TOTALS,
    Box,
    corner_theta,
    pole_frequency_hz,
)

if TYPE_CHECKING:
    from collections.abc import Callable

CYCLES = 105
"""Cycles 429 to 533 of Fig. 5."""

GAIN_CYCLES = 30
"""Cycles of the outflow gain."""

QUIET_CYCLES = 10
"""Cycles of the layer with the stated noise."""

SEED = 11
"""Seed of all random numbers; none was picked."""

REFRESH_3 = Layer("refresh 3, noise 4e-3", 0, 3, 4e-3)
REFRESH_4 = Layer("refresh 4, noise 4e-3", 0, 4, 4e-3)
STATED = Layer("every sample fresh, noise 1e-5", 1, 1, 1e-5)

WIDEST = 0.8
"""Scatter of one cycle over the published value beyond which a term is not compared [1]."""

V_REF = 0.3
"""Command at which the outflow gain is compared [1]."""


def recompute(advance: Callable[[], None]) -> tuple[Check, ...]:
    """Recompute every published number; `advance` is called once a simulated cycle."""
    fits = [fit_layer(layer, CYCLES, SEED, advance) for layer in (REFRESH_3, REFRESH_4)]
    quiet = fit_layer(STATED, QUIET_CYCLES, SEED, advance)
    kalman = outflow_gain(REFRESH_4, GAIN_CYCLES, SEED, advance, v_ref=V_REF)
    checks = [check for fit in fits for check in table_1(fit)]
    checks += [*_gains(kalman), *_residual(fits, quiet), *pole_checks(), *table_4()]
    checks += [*table_5(), *fig_5(fits[1]), *_fig_6(fits[1])]
    return tuple(checks)


def table_1(fits: LayerFits) -> list[Check]:
    """Compare Table 1 with the mean over all cycles of one layer."""
    where = f"Table 1, {fits.layer.name}"
    checks = []
    for name in ESTIMATORS:
        for term, published in PUBLISHED[name].items():
            checks.append(_theta_check(fits, where, name, term, published))
        for kind, published, found in zip(
            ("training", "test"),
            PUBLISHED_MSE[name],
            (fits.mse[name].mean(), np.nanmean(fits.mse_test[name])),
            strict=True,
        ):
            quantity = f"{name} MSE {kind}"
            note = "cause not identified; test = the theta of the cycle before"
            checks.append(within_factor(where, quantity, published, float(found), 2.0, note))
    more = fits.mean("LS5", 1) - fits.mean("LS3", 1)
    ratio = float(np.mean(fits.mse["QP4"] / fits.mse["LS3"]))
    published_ratio = PUBLISHED_MSE["QP4"][0] / PUBLISHED_MSE["LS3"][0]
    growth = float(fits.condition_growth.mean())
    return [
        *checks,
        _inflow_gain(fits, where),
        within_range(where, "LS5 theta_1 - LS3 theta_1", -0.08, more, upper=0.0,
                     note="further from [-1, 0] with more terms"),
        within_range(where, "MSE of QP4 over that of LS3", published_ratio, ratio,
                     lower=1.0, upper=1.3),
        cannot(where, "condition number, 5 terms over 3", 100.0, growth,
               "two decades need fewer command levels than a whole cycle has"),
    ]  # fmt: skip


def _theta_check(fits: LayerFits, where: str, name: str, term: int, published: float) -> Check:
    """Compare one published term, a single cycle's, with the mean over the cycles."""
    quantity = f"{name} theta_{term}"
    found = fits.mean(name, term)
    if term == 1 and name == "QP4":
        return Check(where, quantity, published, found, -1.001, -0.999, "on its bound -1",
                     "the published -0.99 is taken for the bound")  # fmt: skip
    if term == 1:
        note = "errors-in-variables bias drives it below -1, to -1.5 at most"
        return within_range(where, quantity, published, found, lower=-1.6, upper=-1.05, note=note)
    if term == 4:
        share = float(np.mean(fits.theta[name][:, 3] > 0.0))
        why = f"its sign changes from cycle to cycle: positive in {share:.0%}"
        return cannot(where, quantity, published, found, why)
    if term == 2 or name == "LS3":
        return within_factor(where, quantity, published, found, 2.0,
                             "size only: pilot area and stroke are assumed")  # fmt: skip
    half = quantile(len(fits.cycles) - 1, 0.95) * fits.scatter(name, term)
    if half >= WIDEST * abs(published):
        why = f"one cycle scatters by {half:.2g} (95 %): a single published cycle says nothing"
        return cannot(where, quantity, published, found, why)
    return Check(where, quantity, published, found, published - half, published + half,
                 f"{half:.2g}, 95 % of one cycle", "a single published cycle")  # fmt: skip


def _inflow_gain(fits: LayerFits, where: str) -> Check:
    """Compare the filling gain, which survives the bias, with that of the simulated valve."""
    theta = fits.theta["QP4"]
    found = float(np.mean(theta[:, 1] / -theta[:, 0]))
    return _against_truth(where, "QP4 K_in", found, fits.k_in)


def _gains(kalman: tuple[float, float]) -> list[Check]:
    """Compare the emptying gain with the simulated valve's, and both with each other."""
    where = f"Table 1, {REFRESH_4.name}"
    checks = [_against_truth(where, f"Kalman K_out({V_REF:g}) at the right lag", *kalman)]
    return [*checks, *_area_ratio()]


def _area_ratio() -> list[Check]:
    """Compare the area ratio behind theta_2/theta_3 with its range in Table 3."""
    lower, upper = Box().area_ratio
    found = {}
    for name in ("LS3", "QP4"):
        ratio = PUBLISHED[name][2] / PUBLISHED[name][3]
        found[name] = 1.0 / (1.0 + ratio**2)
    quantity = "A_T/A_B that explains theta_2/theta_3 of"
    return [
        within_range("Table 1", f"{quantity} QP4", "anomaly", found["QP4"], lower=lower,
                     upper=upper, kind=Kind.DERIVED,
                     note="no anomaly between equal pilot groups: f_in/f_out = sqrt((1-r)/r), "
                     "limits are the range of Table 3"),
        cannot("Table 1", f"{quantity} LS3", f"{lower:g} .. {upper:g}", found["LS3"],
               "below the range, rounding reaches 0.9492 only: without theta_5 the saturation of "
               "the emptying group lowers |theta_3|, and the ratio with it"),
    ]  # fmt: skip


def _against_truth(where: str, quantity: str, found: float, truth: float) -> Check:
    """Compare an estimate with the truth of the simulated valve: within 5 %."""
    return Check(where, quantity, f"truth {truth:.4g}", found, 0.95 * truth, 1.05 * truth, "5 %",
                 "truth: gain of the simulated valve, where its estimate holds",
                 Kind.REGRESSION)  # fmt: skip


def _residual(fits: list[LayerFits], quiet: LayerFits) -> list[Check]:
    """Compare what the paper says about the error signal of Fig. 4."""
    third, fourth = (float(fit.line.mean()) for fit in fits)
    peak = PERIOD_S / strongest(fits[0].spectrum)
    quiet_mse = float(quiet.mse["QP4"].mean())
    return [
        within_range("Fig. 4", f"share of power at a period of 0.09 s, {REFRESH_3.name}",
                     "a component", third, lower=0.094, note="white noise: 0.047"),
        within_share("Fig. 4", f"period of the strongest line, {REFRESH_3.name} [s]", 0.09, peak,
                     0.05, "mean spectrum of the residuals of QP4 over all cycles"),
        cannot("Fig. 4", f"share of power at a period of 0.09 s, {REFRESH_4.name}", "a component",
               fourth, "only a sensor refreshed every third sample makes this line; no one layer "
               "reproduces line and theta_1 together"),
        cannot("Table 1, Table 5", "QP4 MSE under the stated noise variance 1e-10", 3.6e-5,
               quiet_mse, "stated noise and published one-step error contradict each other"),
    ]  # fmt: skip


def pole_checks() -> list[Check]:
    """Compare the statement about the pole of the least-squares model."""
    pole = 1.0 + PUBLISHED["LS3"][1]
    return [
        within_share("Section 4.1", "pole z of LS3", -0.16, pole, 1e-9, "1 + theta_1",
                     Kind.DERIVED),
        within_share("Section 4.1", "frequency of that pole [Hz]", 16.67,
                     pole_frequency_hz(pole), 5e-4, f"1/(2 T), T = {PERIOD_S} s", Kind.DERIVED),
    ]  # fmt: skip


def table_4() -> list[Check]:
    """Compare the intervals of Table 4 with the corners of the box of Table 3."""
    same, own = corner_theta(identical=True), corner_theta(identical=False)
    checks = []
    for term in FITTED:
        column = term - 1
        ends = PUBLISHED_BOX[term]
        found = (float(same[:, column].min()), float(same[:, column].max()))
        names = (f"theta_{term} lower end", f"theta_{term} upper end")
        if term == 1:
            why = (
                "forward Euler is not valid for so fast a pole; the interval meets the "
                "constraint -1 <= theta_1 only at -1 and does not hold the published -0.99"
            )
            checks += [
                cannot("Table 4", *row, why) for row in zip(names, ends, found, strict=True)
            ]
        elif term == 2:
            low = float(own[:, column].min())
            why = f"the box ends at {found[0]:.2g} for equal pilot groups, at {low:.2g} for any"
            checks += [
                cannot("Table 4", names[0], ends[0], low, why),
                within_factor("Table 4", names[1], ends[1], found[1], 2.0, "", Kind.DERIVED),
            ]
        elif term == 3:
            note = f"needs pilot groups of different area; equal ones: {found[1]:.2g}"
            checks += [
                within_factor("Table 4", names[0], ends[0], found[0], 2.0, "", Kind.DERIVED),
                within_factor(
                    "Table 4",
                    names[1],
                    ends[1],
                    float(own[:, column].max()),
                    2.0,
                    note,
                    Kind.DERIVED,
                ),
            ]
        else:
            checks += [
                within_factor("Table 4", *row, 2.0, "", Kind.DERIVED)
                for row in zip(names, ends, found, strict=True)
            ]
    return [*checks, _in_box()]


def _in_box() -> Check:
    """Compare the published theta_2 with the box; its gains do not depend on theta_1."""
    box = corner_theta(identical=True)
    theta = PUBLISHED["QP4"]
    k_in = theta[2] / -theta[1]
    inflow = box[:, 1] / -box[:, 0]
    return cannot("Table 3, Table 4", "theta_2 of QP4 in the box of equal pilot groups",
                  f"at least {box[:, 1].min():.2g}", theta[2],
                  f"below the box; its gain {k_in:.3g} lies inside, in "
                  f"{inflow.min():.1g} .. {inflow.max():.1g}: hardly to be missed")  # fmt: skip


def table_5() -> list[Check]:
    """Compare the totals of Table 5 with the sums of its rows."""
    sums = np.sum(list(PUBLISHED_ERRORS.values()), axis=0)
    checks = [
        cannot("Table 5", "total of theta_1", PUBLISHED_TOTALS[0], float(sums[0]),
               "misprint: the rows add up to a tenth of it")
    ]  # fmt: skip
    for k, term in enumerate(FITTED[1:], 1):
        checks.append(
            within_share("Table 5", f"total of theta_{term}", PUBLISHED_TOTALS[k], float(sums[k]),
                         0.03, "sum of the rows (a) to (k); printed with two digits", Kind.DERIVED)
        )  # fmt: skip
    for k, term in enumerate(FITTED[1:], 1):
        row = max(PUBLISHED_ERRORS, key=lambda letter, k=k: PUBLISHED_ERRORS[letter][k])  # type: ignore[misc]
        largest = PUBLISHED_ERRORS[row][k]
        why = f"its own table says row ({row}), {largest:g}, against {PUBLISHED_ERRORS['k'][k]:g}"
        checks.append(
            cannot("Table 5", f"largest source of theta_{term}", "compressibility", largest, why)
        )
    return checks


def fig_5(fits: LayerFits) -> list[Check]:
    """Compare the line through theta_2 over the cycles and its interval."""
    theta_2 = fits.theta["QP4"][:, 1]
    line = fit_line(fits.cycles, theta_2)
    first, last = float(fits.cycles[0]), float(fits.cycles[-1])
    drift = 100.0 * (line.level(last) / line.level(first) - 1.0)
    low, high = line.prediction_interval(line.center)
    half = 50.0 * (high - low) / line.mean
    where = f"Fig. 5, {fits.layer.name}"
    ends = line.mean_interval(line.center)
    mean_half = 50.0 * (ends[1] - ends[0]) / line.mean
    return [
        within_range(where, "error probability of a trend of theta_2", "a linear trend",
                     line.p_value, upper=1e-3),
        Check(where, "drift of theta_2 [%]", "true: -14.1", drift, -16.6, -11.6,
              "2.5 of the true drift", "filling pilot area -15 % over 105 cycles",
              Kind.REGRESSION),
        within_share(where, "half width of the 95 % interval [%]", 6.5, half, 0.15,
                     "published: slightly above 6.5; a prediction interval: that of the mean line "
                     f"would be {mean_half:.2g} %"),
    ]  # fmt: skip


def _fig_6(fits: LayerFits) -> list[Check]:
    """Compare what is said about the other parameters over the cycles."""
    where = f"Fig. 6, {fits.layer.name}"
    theta = fits.theta["QP4"]
    bound = float(np.mean(np.abs(theta[:, 0] + 1.0) < 1e-3))
    larger = float(np.mean(-theta[:, 2] > theta[:, 4]))
    half = len(theta) // 2
    growth = float(theta[half:, 2].std() / theta[:half, 2].std())
    return [
        within_range(where, "share of cycles with theta_1 on its bound", "all", bound,
                     lower=1.0, upper=1.0),
        within_range(where, "share of cycles with |theta_3| > theta_5", 71.0 / 105.0, larger,
                     lower=0.58, upper=0.77, note="71 of 105; two standard errors"),
        cannot(where, "scatter of theta_3, second half over first", "grows", growth,
               "what makes it grow is not stated; the layer stays the same over all cycles"),
    ]  # fmt: skip


PAPER = Paper(
    number="002",
    title="water hydraulic two-stage cartridge valve of a press",
    steps=2 * CYCLES + QUIET_CYCLES + GAIN_CYCLES,
    recompute=recompute,
)
