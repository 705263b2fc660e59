# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What of a stored valve goes into an FMU, and which valves are refused."""

import pytest

from valve_twin.core.types import Estimate, EstimateStatus, ParameterStatus, ParameterValue
from valve_twin.core.valves.kit import Lawful
from valve_twin.core.valves.registry import get_model, model_names
from valve_twin.gateway.fmu.valve import law_of, stored_estimate, valve_of
from valve_twin.io.errors import FmuError
from valve_twin.io.history.store import History
from valve_twin.io.history.tables import CycleRecord

VALUES = (
    ParameterValue("time_constant", 0.41, lower_95=0.4, upper_95=0.43),
    ParameterValue("dead_band", 0.0, ParameterStatus.AT_BOUND),
)


def made(cycle=3, values=VALUES, status=EstimateStatus.ACCEPTED, model="first_order", lag=1):
    return Estimate(
        model, "output_error", cycle, 0, 19_950_000_000, values, status, "why", lag=lag
    )


def record(cycle=3, samples=400, lost=0):
    return CycleRecord(cycle, 0, 19_950_000_000, samples, lost)


def test_only_a_law_is_taken_and_the_line_names_those_that_are():
    for name in model_names():
        model = get_model(name)
        if isinstance(model, Lawful):
            assert law_of(name).law is model.law
            continue
        with pytest.raises(FmuError, match=rf"'{name}' has no law of.* are: .*first_order"):
            law_of(name)
    laws = {name for name in model_names() if isinstance(get_model(name), Lawful)}
    assert {"first_order", "positioner", "press_cartridge", "stepper_servo"} <= laws
    with pytest.raises(FmuError, match=r"'first_ordr' is unknown.*first_order"):
        law_of("first_ordr")


def test_a_value_at_its_bound_has_the_bounds_of_the_law_for_limits():
    valve = valve_of("db", "/v", made(), record())
    tau, band = valve.parameters
    assert (tau.lower, tau.start, tau.upper) == (0.4, 0.41, 0.43)
    assert (band.lower, band.start, band.upper) == (0.0, 0.0, 0.2)


def test_lost_samples_do_not_stretch_the_sampling_time():
    assert valve_of("db", "/v", made(), record(samples=390, lost=10)).period_s == 0.05
    assert valve_of("db", "/v", made(), record(samples=390), 0.05).period_s == 0.05
    with pytest.raises(FmuError, match="cycle 3 has 1 samples: give the sampling time"):
        valve_of("db", "/v", made(), record(samples=1))


def test_other_values_are_another_token_and_the_same_ones_are_not():
    one = valve_of("db", "/v", made(), record())
    assert valve_of("db", "/v", made(), record()).token == one.token
    moved = (ParameterValue("time_constant", 0.42), VALUES[1])
    assert valve_of("db", "/v", made(values=moved), record()).token != one.token


def test_a_name_of_any_letters_becomes_one_of_c():
    assert valve_of("db", "/press/größe 3", made(), record()).identifier == "press_gr__e_3"
    assert valve_of("db", "/3", made(), record()).identifier == "valve_3"


def test_a_parameter_that_the_cycle_does_not_know_is_told():
    unknown = (VALUES[0], ParameterValue("dead_band", float("nan"), reason="not excited"))
    with pytest.raises(FmuError, match="cycle 3: dead_band is not known: not excited; choose"):
        valve_of("db", "/v", made(values=unknown), record())


def test_the_newest_usable_estimate_is_taken(tmp_path):
    refused = EstimateStatus.REFUSED
    with History(tmp_path / "h.sqlite") as history:
        for cycle, status in ((1, EstimateStatus.ACCEPTED), (2, refused)):
            history.store("/v", record(cycle), (made(cycle, status=status),))
        assert stored_estimate(history, "v", 0)[0].cycle == 1
        with pytest.raises(FmuError, match="no usable estimate of cycle 2: why; its last"):
            stored_estimate(history, "v", 2)


def test_a_valve_of_a_model_that_is_no_law_or_is_not_installed_is_told(tmp_path):
    with History(tmp_path / "h.sqlite") as history:
        for valve, model in (("/a", "cycle_timing"), ("/b", "of_a_package")):
            history.store(valve, record(), (made(model=model),))
        with pytest.raises(FmuError, match=r"'cycle_timing' has no law of one sample"):
            stored_estimate(history, "a", 0)
        with pytest.raises(FmuError, match=r"'of_a_package' is unknown"):
            stored_estimate(history, "b", 0)


PLAIN = (
    ParameterValue("rate_rising", 2.0, lower_95=1.9, upper_95=2.1),
    ParameterValue("rate_falling", 3.0),
    ParameterValue("slew_rising", float("nan"), ParameterStatus.NOT_EXCITED, "never so fast"),
    ParameterValue("slew_falling", 0.5),
    ParameterValue("dead_band", 0.01),
)


def test_a_positioner_has_what_its_prediction_takes_where_a_cycle_shows_nothing():
    valve = valve_of("db", "/v", made(values=PLAIN, model="positioner", lag=3), record())
    found = {q.name: q for q in valve.parameters}
    assert (found["rate_rising"].lower, found["rate_rising"].start) == (1.9, 2.0)
    assert found["slew_rising"].start == 1.0 / 0.05  # one stroke a sample
    assert "never so fast, as the prediction takes it" in found["slew_rising"].text
    assert (found["lower_stop"].start, found["upper_stop"].start) == (-0.1, 1.1)
    assert "set the valve's own" in found["upper_stop"].text
    assert valve.delay.start == pytest.approx(0.15, rel=1e-12)


def test_a_positioner_of_the_extended_law_is_refused():
    values = (*PLAIN, ParameterValue("damping", 4.0))
    with pytest.raises(FmuError, match="cycle 3: damping belongs to the extended law"):
        valve_of("db", "/v", made(values=values, model="positioner"), record())


def test_a_lag_of_0_becomes_one_sample_and_the_description_says_so():
    none = valve_of("db", "/v", made(values=PLAIN, model="positioner", lag=0), record())
    one = valve_of("db", "/v", made(values=PLAIN, model="positioner", lag=1), record())
    assert none.delay.start == one.delay.start == 0.05
    assert "lag 1 samples (found 0: " in none.text
    assert "found" not in one.text


PRESS = (
    ParameterValue("pole", 0.35, lower_95=0.3, upper_95=0.4),
    ParameterValue("K_in", 0.021, lower_95=0.0208, upper_95=0.0212),
    ParameterValue("v_in_mean", 0.6),
    ParameterValue("K_out", 0.026),
    ParameterValue("leak", float("nan"), ParameterStatus.NOT_EXCITED, "no hold"),
    ParameterValue("delay", 2.25),
)


def test_a_press_valve_has_whole_samples_of_its_delay_in_the_line_and_the_rest_in_its_law():
    estimate = made(values=PRESS, model="press_cartridge", lag=1)
    valve = valve_of("db", "/v", estimate, record())
    found = {q.name: q for q in valve.parameters}
    assert valve.delay.start == pytest.approx(2 * 0.05, rel=1e-12)
    assert found["delay_part"].start == 0.25
    assert (found["K_in"].lower, found["K_in"].upper) == (0.0208, 0.0212)
    assert (found["leak"].start, found["K_in_slope"].start) == (0.0, 0.0)
    assert "no hold, as the prediction takes it" in found["leak"].text
    assert found["upper_seat"].start == 1.0
    assert "set the valve's own" in found["upper_seat"].text
    assert [q.name for q in valve.inputs] == ["v_in", "v_out"]
    short = (*PRESS[:-1], ParameterValue("delay", 0.6))
    early = valve_of("db", "/v", made(values=short, model="press_cartridge"), record())
    assert {q.name: q.start for q in early.parameters}["delay_part"] == 0.0
    assert "lag 1 samples (found 0: " in early.text
