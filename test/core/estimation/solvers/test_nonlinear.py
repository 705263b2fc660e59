# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Certified values: NIST Statistical Reference Datasets, nonlinear regression (public domain)."""

from dataclasses import dataclass

import numpy as np
import pytest

from valve_twin.core.estimation.solvers.nonlinear import (
    Curve,
    CurveFunction,
    FitParameter,
    FitStatus,
    Method,
    fit_curves,
)


@dataclass(frozen=True)
class Certified:
    function: CurveFunction
    x: tuple[float, ...]
    y: tuple[float, ...]
    starts: tuple[tuple[float, ...], ...]
    values: tuple[float, ...]
    errors: tuple[float, ...]
    residual_sum: float


def numbers(text):
    return tuple(float(word) for word in text.split())


def _lanczos(x, b):
    return b[0] * np.exp(-b[1] * x) + b[2] * np.exp(-b[3] * x) + b[4] * np.exp(-b[5] * x)


def _thurber(x, b):
    above = b[0] + x * (b[1] + x * (b[2] + x * b[3]))
    return above / (1.0 + x * (b[4] + x * (b[5] + x * b[6])))


SETS = {
    "Misra1a": Certified(
        lambda x, b: -b[0] * np.expm1(-b[1] * x),
        numbers(
            "77.6 114.9 141.1 190.8 239.9 289.0 332.8 378.4 434.8 477.3 536.8 593.1 689.1 760.0 "
        ),
        numbers(
            "10.07 14.73 17.94 23.93 29.61 35.18 40.02 44.82 50.76 55.05 61.01 66.40 75.47 81.78 "
        ),
        ((500.0, 1e-4), (250.0, 5e-4)),
        (2.3894212918e02, 5.5015643181e-04),
        (2.7070075241e00, 7.2668688436e-06),
        1.2455138894e-01,
    ),
    "Lanczos3": Certified(
        _lanczos,
        tuple(0.05 * k for k in range(24)),
        numbers(
            "2.5134 2.0443 1.6684 1.3664 1.1232 0.9269 0.7679 0.6389 "
            "0.5338 0.4479 0.3776 0.3197 0.2720 0.2325 0.1997 0.1723 "
            "0.1493 0.1301 0.1138 0.1000 0.0883 0.0783 0.0698 0.0624 "
        ),
        ((1.2, 0.3, 5.6, 5.5, 6.5, 7.6), (0.5, 0.7, 3.6, 4.2, 4.0, 6.3)),
        numbers(
            "8.6816414977e-02 9.5498101505e-01 8.4400777463e-01 "
            "2.9515951832e00 1.5825685901e00 4.9863565084e00 "
        ),
        numbers(
            "1.7197908859e-02 9.7041624475e-02 4.1488663282e-02 "
            "1.0766312506e-01 5.8371576281e-02 3.4436403035e-02 "
        ),
        1.6117193594e-08,
    ),
    "Thurber": Certified(
        _thurber,
        numbers(
            "-3.067 -2.981 -2.921 -2.912 -2.840 -2.797 -2.702 -2.699 -2.633 -2.481 "
            "-2.363 -2.322 -1.501 -1.460 -1.274 -1.212 -1.100 -1.046 -0.915 -0.714 "
            "-0.566 -0.545 -0.400 -0.309 -0.109 -0.103 0.010 0.119 0.377 0.790 "
            "0.963 1.006 1.115 1.572 1.841 2.047 2.200 "
        ),
        numbers(
            "80.574 84.248 87.264 87.195 89.076 89.608 89.868 90.101 92.405 95.854 "
            "100.696 101.060 401.672 390.724 567.534 635.316 733.054 759.087 894.206 "
            "990.785 1090.109 1080.914 1122.643 1178.351 1260.531 1273.514 1288.339 "
            "1327.543 1353.863 1414.509 1425.208 1421.384 1442.962 1464.350 1468.705 "
            "1447.894 1457.628 "
        ),
        ((1000, 1000, 400, 40, 0.7, 0.3, 0.03), (1300, 1500, 500, 75, 1, 0.4, 0.05)),
        numbers(
            "1.2881396800e03 1.4910792535e03 5.8323836877e02 7.5416644291e01 "
            "9.6629502864e-01 3.9797285797e-01 4.9727297349e-02 "
        ),
        numbers(
            "4.6647963344e00 3.9571156086e01 2.8698696102e01 5.5675370270e00 "
            "3.1333340687e-02 1.4984928198e-02 6.5842344623e-03 "
        ),
        5.6427082397e03,
    ),
    "MGH09": Certified(
        lambda x, b: b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3]),
        (4.0, 2.0, 1.0, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625),
        (0.1957, 0.1947, 0.1735, 0.16, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246),
        ((25.0, 39.0, 41.5, 39.0), (0.25, 0.39, 0.415, 0.39)),
        (1.9280693458e-01, 1.9128232873e-01, 1.2305650693e-01, 1.3606233068e-01),
        (1.1435312227e-02, 1.9633220911e-01, 8.0842031232e-02, 9.0025542308e-02),
        3.0750560385e-04,
    ),
}


def digits(got, certified):
    """Return how many significant digits agree, the fewest of all values."""
    got, certified = np.asarray(got), np.asarray(certified)
    off = np.maximum(np.abs(got / certified - 1.0), 1e-16)
    return float(-np.log10(off.max()))


def fitted(certified, start, method):
    parameters = [FitParameter(f"b{k + 1}", float(b)) for k, b in enumerate(start)]
    curve = Curve(np.array(certified.x), np.array(certified.y))
    return fit_curves(certified.function, [curve], parameters, method=method)


@pytest.mark.parametrize("method", Method, ids=lambda m: m.value)
@pytest.mark.parametrize("start", [0, 1], ids=["far", "near"])
@pytest.mark.parametrize("name", SETS)
def test_reaches_the_certified_values_and_standard_errors(name, start, method):
    certified = SETS[name]
    fit = fitted(certified, certified.starts[start], method)
    assert fit.status is FitStatus.OK
    assert digits(fit.values, certified.values) > 6.0
    assert digits(fit.standard_errors, certified.errors) > 6.0
    assert digits([fit.residual_sum], [certified.residual_sum]) > 8.0
    assert fit.reduced_chi_square == pytest.approx(fit.residual_sum / fit.freedom)


def test_r_square_is_that_of_a_straight_line_in_closed_form():
    x, y = np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.1, 0.9, 2.2, 2.8])
    fit = fit_curves(
        lambda x, p: p[0] + p[1] * x,
        [Curve(x, y)],
        [FitParameter("a", 0.0), FitParameter("b", 0.0)],
    )
    correlation = np.corrcoef(x, y)[0, 1]
    assert fit.r_square == pytest.approx(correlation**2, rel=1e-12)
    assert fit.adjusted_r_square == pytest.approx(1 - (1 - correlation**2) * 3 / 2, rel=1e-12)


def decays(seed=3, sigma=0.0):
    rng = np.random.default_rng(seed)
    x = np.linspace(0.0, 3.0, 40)
    heights = (1.0, 2.0, 5.0)
    return [Curve(x, h * np.exp(-0.7 * x) + sigma * rng.standard_normal(40)) for h in heights]


SHARED_AND_LOCAL = (FitParameter("height", 1.0, local=True), FitParameter("rate", 0.1))


def decay(x, p):
    return p[0] * np.exp(-p[1] * x)


def test_shared_and_local_parameters_are_kept_apart():
    fit = fit_curves(decay, decays(), SHARED_AND_LOCAL, method=Method.LEVENBERG_MARQUARDT)
    assert fit.names == ("rate", "height[0]", "height[1]", "height[2]")
    assert fit.value("rate") == pytest.approx(0.7, rel=1e-10)
    heights = [fit.value(f"height[{k}]") for k in range(3)]
    np.testing.assert_allclose(heights, [1.0, 2.0, 5.0], rtol=1e-10)


@pytest.mark.no_cover
def test_the_standard_error_is_the_scatter_over_many_records():
    fits = [fit_curves(decay, decays(seed, 0.01), SHARED_AND_LOCAL) for seed in range(120)]
    rates = np.array([f.value("rate") for f in fits])
    told = np.mean([f.standard_error("rate") for f in fits])
    assert told == pytest.approx(rates.std(ddof=1), rel=0.2)  # 3 sigma of a scatter of 120
    assert abs(rates.mean() - 0.7) < 4.0 * told / np.sqrt(120)


def test_curves_weigh_by_their_sigma():
    x = np.zeros(2)
    curves = [Curve(x, np.full(2, 1.0), 0.1), Curve(x, np.full(2, 2.0), 0.2)]
    fit = fit_curves(lambda x, p: p[0] + x, curves, [FitParameter("level", 0.0)])
    assert fit.value("level") == pytest.approx((4 * 1.0 + 2.0) / 5, rel=1e-9)


def test_a_parameter_on_its_bound_is_reported_without_an_error():
    parameters = (FitParameter("height", 1.0, local=True), FitParameter("rate", 0.5, 0.0, 0.6))
    fit = fit_curves(decay, decays(), parameters)
    assert fit.value("rate") == pytest.approx(0.6, rel=1e-6)
    assert fit.value("rate") <= 0.6


def test_what_the_curves_do_not_determine_is_a_status():
    x = np.linspace(0.0, 1.0, 10)
    parameters = [FitParameter("a", 1.0), FitParameter("b", 1.0)]
    fit = fit_curves(lambda x, p: (p[0] + p[1]) * x, [Curve(x, 3.0 * x)], parameters)
    assert fit.status is FitStatus.NOT_IDENTIFIED
    assert np.isnan(fit.standard_errors).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FitParameter("m", -1.0, 0.0, 5.0), "m starts at -1.0: must be a number from 0"),
        (lambda: Curve(np.zeros(2), np.array([1.0, np.nan])), "not finite"),
        (lambda: Curve(np.zeros(2), np.zeros(3)), "2 abscissae and 3 ordinates"),
        (lambda: Curve(np.zeros(1), np.zeros(1), 0.0), "sigma = 0.0"),
        (
            lambda: fit_curves(decay, [Curve(np.zeros(1), np.zeros(1))], SHARED_AND_LOCAL),
            "1 ordinates cannot determine 2 parameters",
        ),
        (
            lambda: fit_curves(
                decay,
                decays(),
                [FitParameter("h", 1.0), FitParameter("r", 0.1, lower=0.0)],
                method=Method.LEVENBERG_MARQUARDT,
            ),
            "keeps no bounds",
        ),
        (
            lambda: fit_curves(decay, decays(), [FitParameter("h", 1.0), FitParameter("h", 0.1)]),
            "each name must stand once",
        ),
    ],
)
def test_refuses_what_cannot_be_fitted(make, message):
    with pytest.raises(ValueError, match=message):
        make()
