# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import pytest

from valve_twin.core.valves.damadics.fluid import (
    bypass_flow,
    density,
    recovery,
    relative_coefficient,
    rod_force,
    valve_flow,
    vapour_pressure,
)

P1, P2 = 3.5e6, 2.6e6


@pytest.mark.parametrize(
    ("x", "force", "flow"),
    [
        (0.0, 1767.1, 358.686),
        (0.25, 2019.6, 102.765),
        (0.5, 2437.4, 29.4427),
        (0.75, 3033.7, 8.4355),
        (0.9, 3534.3, 3.9846),
        (0.975, 3855.6, 2.7386),
        (0.99, 3927.0, 1.0954),
        (1.0, 4417.9, 0.0),
    ],
)
def test_the_static_map_is_that_of_the_sheet(x, force, flow):
    assert rod_force(x, P1, P2) == pytest.approx(force, rel=5e-5)
    assert valve_flow(x, relative_coefficient(x), P1, P2, 43.0) == pytest.approx(
        flow, rel=5e-5, abs=1e-9
    )


@pytest.mark.parametrize(
    ("warm", "force", "flow"),
    [(268.0, 8554.0, 27.338), (293.0, 16277.0, 35.661), (300.0, 18894.0, 38.093)],
)
def test_steam_chokes_the_flow_and_lifts_the_pressure(warm, force, flow):
    pv = vapour_pressure(warm)
    assert rod_force(0.5, max(P1, pv), P2) == pytest.approx(force, rel=1e-4)
    assert valve_flow(0.5, relative_coefficient(0.5), P1, P2, warm) == pytest.approx(
        flow, rel=1e-4
    )


def test_properties_of_water_are_those_of_the_sheet():
    assert density(P1, 43.0) == pytest.approx(992.713, abs=1e-3)
    assert density(P1, 20.0) == pytest.approx(999.917, abs=1e-3)
    assert vapour_pressure(43.0) == pytest.approx(8802.3, abs=0.1)
    assert vapour_pressure(268.0) == pytest.approx(5758519.0, rel=1e-6)


def test_the_bypass_adds_its_flow():
    assert bypass_flow(0.5, P1, P2, 43.0) == pytest.approx(29.625, abs=1e-3)
    assert bypass_flow(0.0, P1, P2, 43.0) == 0.0


def test_the_recovery_has_no_jump():
    steps = [recovery(x / 1000.0) - recovery((x - 1) / 1000.0) for x in range(1, 1001)]
    assert max(abs(s) for s in steps) < 0.006  # the steepest piece falls 0.05 in 0.01
