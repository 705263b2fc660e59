# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The publishers: step metrics of a cycle that closed are told as the core finds them."""

import numpy as np
import pytest
from valve_twin_msgs.msg import Estimate, Float64Stamped, StepMetrics

from test.core.operation.stepping import make_cycle
from test.nodes.conftest import NS
from valve_twin.core.operation.step_metrics import METRICS, measure_steps
from valve_twin.io.cdr.codec import encode_stamped
from valve_twin.nodes.twin.node import TwinNode
from valve_twin.nodes.twin.publishers import STEPS

PERIOD_S, WINDOW_S, LAG_S = 0.02, 20.0, 0.5
SAMPLES = round(WINDOW_S / PERIOD_S)


def motion():
    """Return command and position of a lag that is stepped, a little more than two windows."""
    time_s = PERIOD_S * np.arange(2 * SAMPLES + 5)
    u = np.where(time_s % 10.0 < 5.0, 0.2, 0.7)
    x = np.empty(len(u))
    x[0] = u[0]
    for n in range(1, len(u)):
        x[n] = u[n - 1] + (x[n - 1] - u[n - 1]) * np.exp(-PERIOD_S / LAG_S)
    return time_s, u, x + 1e-3 * np.random.default_rng(4).standard_normal(len(x))


def test_the_steps_of_a_closed_cycle_are_published_as_the_core_finds_them(graph, tmp_path):
    parameters = {
        "history_url": f"sqlite:///{tmp_path}/history.sqlite",
        "model": "first_order",
        "period_s": PERIOD_S,
        "estimate_wait_s": 0.0,
        "signals.command.topic": "command/command",
        "signals.position.topic": "spool_position",
        "cycles.rule": "window",
        "cycles.window_s": WINDOW_S,
    }
    estimates = graph.record(f"{NS}/twin/estimate", Estimate)
    heard = graph.record(f"{NS}/twin/step_metrics", StepMetrics, STEPS)
    graph.host(TwinNode, **parameters)
    topics = ("command/command", "spool_position")
    says = [graph.node.create_publisher(Float64Stamped, f"{NS}/{t}", 20_000) for t in topics]
    graph.spin_until(lambda: all(p.get_subscription_count() for p in says), what="subscribers")
    time_s, u, x = motion()
    stamps = 10**12 + np.round(1e9 * time_s).astype(np.int64)
    for stamp, *values in zip(stamps.tolist(), u.tolist(), x.tolist(), strict=True):
        for publisher, value in zip(says, values, strict=True):
            publisher.publish(encode_stamped(stamp, value))
    graph.spin_until(lambda: bool(estimates), what="the estimate of a cycle")
    number = estimates[0].cycle
    wanted = measure_steps(
        make_cycle(time_s[:SAMPLES], x[:SAMPLES], u[:SAMPLES], number), ("command",)
    )
    graph.spin_until(lambda: len(heard) >= len(wanted), what="the steps of the cycle")
    assert len(wanted) == 3
    for told, found in zip(heard, wanted, strict=False):
        assert (told.valve, told.cycle, told.step) == (NS, number, found.step)
        assert (told.command, told.size) == ("command", pytest.approx(found.size))
        assert dict(zip(told.names, told.units, strict=True)) == METRICS
        assert list(told.reasons) == [m.reason for m in found.metrics]
        for name in ("values", "lower_95", "upper_95"):
            one = name.removesuffix("s")
            expected = [getattr(m, one) for m in found.metrics]
            np.testing.assert_allclose(getattr(told, name), expected, rtol=1e-6)
        t63 = told.values[told.names.index("t63")]
        assert t63 == pytest.approx(LAG_S, rel=0.05)
    late = graph.record(f"{NS}/twin/step_metrics", StepMetrics, STEPS)
    graph.spin_until(lambda: len(late) >= len(wanted), what="the steps for who comes late")
