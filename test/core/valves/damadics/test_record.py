# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import numpy as np
import pytest

from valve_twin.core.valves.damadics.motion import AIR, PRESSURE, ROD, rest
from valve_twin.core.valves.damadics.record import WHITE, Fault, Process, Wave, simulate

F, X = 5, 4


def constant(command, step_s, step, warm):
    return Process(Wave(command, step_s=step_s, step=step), Wave(3.5e6), Wave(2.6e6), warm)


def test_a_step_runs_as_in_the_first_example():
    true = simulate(51, seed=None, process=constant(0.5, 25.0, 0.5, 20.0)).true
    published = {
        4: (0.1946, 136.044),
        6: (0.4778, 33.0256),
        8: (0.4987, 29.7455),
        20: (0.5004, 29.4884),
        26: (0.6097, 17.0713),
        30: (0.9579, 2.9934),
        40: (0.9972, 0.3103),
        50: (0.9983, 0.1881),
    }
    for t, (x, flow) in published.items():
        assert true[t] == pytest.approx((x, flow), rel=1e-3, abs=1e-4)


FAULTED = {  # X' / F at 31, 35, 59, 62, 64, 90 s, and the chamber's pressure [Pa]
    (0, 0.0): (
        ".5004/29.381 .5004/29.381 .5004/29.381 .7080/10.407 .7562/8.178 .7592/8.055",
        185591,
    ),
    (1, 0.5): (".5/29.443 .5/29.443 .5/29.443 .5/29.443 .5/29.443 .5/29.443", 575680),
    (2, 0.75): (
        ".4965/12.028 .4997/11.841 .5004/11.797 .6838/4.717 .7555/3.294 .7592/3.234",
        203195,
    ),
    (7, 0.25): (
        "0/391.140 .0607/284.317 .4999/27.353 .5711/18.632 .6345/13.203 .7584/6.705",
        450057,
    ),
    (10, 0.5): (
        ".0164/330.414 .3303/68.790 .4951/30.172 .5946/18.347 .6810/11.908 .7540/8.267",
        369315,
    ),
    (13, 0.25): (
        ".6125/34.777 .5033/52.733 .5004/53.308 .7516/20.476 .7570/20.061 .7592/19.889",
        154968,
    ),
    (16, 0.75): (
        ".5004/29.381 .5004/29.381 .5004/29.381 .5241/26.098 .5395/24.169 .5454/23.466",
        150000,
    ),
    (18, 0.25): (
        ".5004/44.194 .5004/44.194 .5004/44.194 .7080/25.220 .7562/22.991 .7592/22.868",
        185591,
    ),
}


@pytest.mark.parametrize(("fault", "published"), FAULTED.items())
def test_a_faulty_valve_runs_as_in_the_sheet(fault, published):
    number, strength = fault
    faults = [Fault(number, strength, 30.0)] if number else []
    record = simulate(91, faults, seed=None, process=constant(0.5, 60.0, 0.25, 43.0))
    cells, chamber = published
    for t, cell in zip((31, 35, 59, 62, 64, 90), cells.split(), strict=True):
        x, flow = map(float, cell.split("/"))
        assert record.signals[t, X] == pytest.approx(x, abs=1e-4)
        assert record.true[t, 1] == pytest.approx(flow, rel=1e-3)
    assert record.hidden[90, 2] * 1e6 == pytest.approx(chamber, rel=1e-4)


GENERATED = {  # X' / F' at 901, 925, 950, 975, 1000 s
    (0, 0.0): ".4999/.7870 .7962/.1665 .5031/.7182 .2768/1 .4827/.7917",
    (1, 0.75): ".25/1 .25/1 .25/1 .25/1 .25/1",
    (2, 0.75): ".4636/.3788 .8016/.0651 .5029/.2887 .2810/.8730 .4823/.3185",
    (7, 0.25): "0/1 .7598/.1664 .5170/.6239 .2458/1 .4834/.7477",
    (10, 0.5): "0/1 .7977/.1652 .5137/.6812 .3034/1 .4748/.8235",
    (13, 0.25): ".5125/1 .7983/.4260 .5033/1 .2835/1 .4831/1",
    (16, 0.75): ".4383/1 .5386/.6034 .4894/.7691 .2769/1 .4432/.9648",
    (18, 0.25): ".4999/1 .7962/.5347 .5031/1 .2768/1 .4827/1",
}


@pytest.mark.parametrize(("fault", "published"), GENERATED.items())
def test_the_data_generator_runs_as_in_the_sheet(fault, published):
    number, strength = fault
    record = simulate(1001, [Fault(number, strength, 900.0)] if number else [], seed=None)
    for t, cell in zip((901, 925, 950, 975, 1000), published.split(), strict=True):
        x, flow = map(float, cell.split("/"))
        assert record.signals[t, X] == pytest.approx(x, abs=2e-4)
        assert record.signals[t, F] == pytest.approx(flow, abs=6e-4)


DEPARTURES = {  # rms of X' and F' from the healthy run, 905 to 1500 s [1/1000], section 7
    (1, 0.5): (189, 351),
    (2, 0.75): (7.0, 293),
    (7, 0.25): (54, 103),
    (8, 0.75): (0.4, 0.4),
    (10, 0.75): (170, 330),
    (11, 0.75): (19, 33),
    (12, -0.75): (25, 54),
    (13, 0.75): (12, 495),
    (14, -0.75): (0, 0),
    (15, 0.75): (441, 609),
    (16, 0.5): (5.1, 8.8),
    (17, 0.75): (38, 180),
    (19, -0.5): (0, 132),
}


@pytest.mark.no_cover
def test_faults_depart_from_the_healthy_run_as_in_the_sheet():
    healthy = simulate(1500, seed=None).signals
    for (number, strength), published in DEPARTURES.items():
        signals = simulate(1500, [Fault(number, strength, 900.0)], seed=None).signals
        rms = 1e3 * np.sqrt(np.mean((signals - healthy)[905:, [X, F]] ** 2, axis=0))
        assert rms == pytest.approx(published, rel=0.02, abs=0.5), number


@pytest.mark.no_cover
def test_the_chamber_of_the_library_drifts_and_the_consistent_one_does_not():
    for consistent, ratio in ((False, 0.984), (True, 1.0)):  # of the sheet, at 5100 s
        z = rest()
        simulate(5100, state=z, consistent=consistent)
        gas = z[PRESSURE] * (0.0055 + 0.0290 * z[ROD]) / (z[AIR] * 287.0 * 293.0)
        assert gas == pytest.approx(ratio, abs=1e-3)


def test_a_fault_is_zero_at_its_start_and_grows_along_its_ramp():
    fault = Fault(13, -1.0, 900.0, 900.0, 2000.0)
    assert fault.at(np.array([900.0, 990.0, 1800.0, 1999.0, 2000.0])) == pytest.approx(
        [0.0, 0.1, 1.0, 1.0, 0.0]
    )


def test_the_noise_is_that_of_the_sensors_and_of_the_seed():
    clean, noisy = (simulate(2000, seed=seed).signals for seed in (None, 3))
    found = (noisy - clean)[:, 1:4].std(axis=0)
    assert found == pytest.approx(WHITE, rel=0.07)  # 2000 samples: 1.6 % each, four sigma
    assert np.array_equal(noisy, simulate(2000, seed=3).signals)
    assert not np.array_equal(noisy, simulate(2000, seed=4).signals)
    assert np.array_equal(noisy[:, 0], clean[:, 0])  # the command that is seen is clean
