# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a plant network does to the inputs of a twin: counted, named, healed, never estimated."""

import math
import signal
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.duration import Duration
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from valve_twin_msgs.msg import Estimate, Fault, Float64Stamped
from valve_twin_msgs.srv import ClearFaults

from test.nodes.conftest import NS
from test.nodes.feeding import START_NS, Feeder
from test.nodes.rough import Watched
from valve_twin.io.cdr.codec import encode_stamped
from valve_twin.nodes.runtime.stamps import to_time

POSITION = f"{NS}/spool_position"
BEST_EFFORT = ReliabilityPolicy.BEST_EFFORT


def test_silence_is_stale_and_recovers(graph, tmp_path):
    twin = Watched(graph, tmp_path, silence_s=3.0)
    feeder = Feeder(graph, NS)
    feeder.feed(20)
    fault = twin.wait_for("input.silent", POSITION)
    assert "is silent for" in fault.evidence
    assert "look at its publisher /test/test" in fault.evidence
    assert (fault.severity, fault.count) == (Fault.STALE, 1)
    twin.fresh()
    assert twin.status.level == DiagnosticStatus.STALE
    assert twin.figure(f"fault.input.silent.{POSITION}.status") == "confirmed"

    def is_healed() -> bool:
        feeder.feed(10)
        return bool(twin.status.level == DiagnosticStatus.OK)

    graph.spin_until(is_healed, 120.0, "diagnostics OK again")
    healed = twin.wait_for("input.silent", POSITION, Fault.HEALED)
    assert healed.count == 1
    assert (healed.last.sec, healed.last.nanosec) >= (healed.first.sec, healed.first.nanosec)


def test_a_publisher_that_starts_again_is_no_loss(graph, tmp_path):
    twin = Watched(graph, tmp_path)
    feeder = Feeder(graph, NS)
    feeder.feed(500)
    graph.spin_until(lambda: len(twin.predictions) == 500, what="500 predictions")
    feeder.restart()
    feeder.feed(500)
    graph.spin_until(lambda: len(twin.predictions) == 1000, what="1000 predictions")
    twin.fresh()
    assert twin.counts(POSITION) == (1000, 0, 0)
    assert twin.stamps() == [START_NS + i * feeder.period_ns for i in range(1000)]
    assert not {"input.loss", "input.overrun", "input.gaps"} & {c for c, _ in twin.faults()}


def test_a_publisher_that_comes_back_with_another_quality_is_taken(graph, tmp_path):
    twin = Watched(graph, tmp_path)
    feeder = Feeder(graph, NS)
    feeder.feed(50)
    graph.spin_until(lambda: len(twin.predictions) == 50, what="50 predictions")
    feeder.restart(QoSProfile(depth=1000, reliability=BEST_EFFORT))

    def is_back() -> bool:
        feeder.feed(1)
        return len(twin.predictions) > 60

    graph.spin_until(is_back, what="predictions from best effort")


def test_an_incompatible_quality_is_named_with_policy_and_remedy_and_heals(graph, tmp_path):
    given = {f"qos_overrides.{POSITION}.subscription.reliability": "reliable"}
    twin = Watched(graph, tmp_path, deadline_s=0.5, **given)
    plant = graph.stranger("plc")
    bad = plant.create_publisher(Float64Stamped, POSITION, QoSProfile(depth=10))
    twin.wait_for("input.qos", POSITION)
    fault = graph.spin_until(  # the network tells of a publisher first, then of its node
        lambda: (f := twin.faults()[("input.qos", POSITION)]) and "/plant/plc" in f.evidence and f,
        what="the publisher's name",
    )
    assert "its publisher /plant/plc offers an incompatible DEADLINE" in fault.evidence
    assert "set deadline_s here" in fault.evidence
    assert fault.severity == Fault.ERROR
    graph.wait_log(twin.process, "[input.qos]", "incompatible DEADLINE")
    plant.destroy_publisher(bad)
    good = QoSProfile(depth=10, deadline=Duration(nanoseconds=200_000_000))
    publisher = graph.node.create_publisher(Float64Stamped, POSITION, good)
    graph.spin_until(publisher.get_subscription_count, what="the match")
    publisher.publish(encode_stamped(START_NS, 0.1))
    twin.wait_for("input.qos", POSITION, Fault.HEALED)
    late = twin.wait_for("input.deadline", POSITION)  # nothing follows within the deadline
    assert "missed its deadline" in late.evidence


def test_wrong_stamps_are_counted_named_and_not_used(graph, tmp_path):
    twin = Watched(graph, tmp_path)
    feeder = Feeder(graph, NS)
    feeder.feed(200)
    publisher = feeder.publishers[2]
    newest = START_NS + 199 * feeder.period_ns
    for _ in range(4):
        publisher.publish(encode_stamped(newest, 9.0))  # a duplicate with another value
    for i in (40, 30, 20, 10, 5):
        publisher.publish(encode_stamped(newest - i * feeder.period_ns // 10, 9.0))  # older
    feeder.feed(200)
    graph.spin_until(lambda: len(twin.predictions) == 400, what="400 predictions")
    assert twin.stamps() == [START_NS + i * feeder.period_ns for i in range(400)]
    assert max(p.measured for p in twin.predictions) < 2.0
    duplicate = twin.wait_for_events("stamps.duplicate", "spool_position", 4)
    late = twin.wait_for_events("stamps.late", "spool_position", 5)
    assert (duplicate.events, duplicate.count) == (4, 1)
    assert (late.events, late.count) == (5, 1)
    assert f"topic '{POSITION}'" in duplicate.evidence
    twin.fresh()
    assert twin.figure("spool_position late/duplicate/bad") == "5/4/0"


def test_values_that_are_none_are_counted_and_named(graph, tmp_path):
    twin = Watched(graph, tmp_path)
    feeder = Feeder(graph, NS)
    feeder.feed(20)
    feeder.feed(7, position=math.nan)
    feeder.feed(20)
    fault = twin.wait_for_events("input.values", "spool_position", 7)
    assert fault.events == 7
    assert "7 values are not finite or out of range" in fault.evidence


def test_a_clock_that_goes_back_drops_the_cycle_and_one_that_leaps_is_a_gap(graph, tmp_path):
    twin = Watched(graph, tmp_path)
    feeder = Feeder(graph, NS)
    feed = feeder.cycle_samples * 3
    feeder.feed(feed + 30)
    graph.spin_until(lambda: len(twin.estimated()) == 2, 120.0, "two estimates")
    # every topic is empty before the jump: what comes late from before it would be a leap ahead
    graph.spin_until(lambda: len(twin.predictions) >= feed + 30 - 2, 120.0, "all predictions")
    back = 500_000_000_000
    feeder.feed(feed, offset_ns=START_NS - back)
    fault = twin.wait_for("clock.set_back")
    assert fault.count == 1
    graph.wait_log(twin.process, "clock of the data was set back")
    graph.spin_until(lambda: len(twin.estimated()) >= 4, 120.0, "estimates after the jump")
    learnt = len(twin.predictions)
    ahead = 3600_000_000_000
    feeder.feed(feed, offset_ns=START_NS - back + ahead)
    gap = twin.wait_for("input.gaps", "spool_position")
    assert "the longest gap is 3.6e+03 s" in gap.evidence
    graph.spin_until(lambda: len(twin.predictions) >= learnt + feed - 50, what="predictions")
    numbers = [c.cycle for c in twin.cycles]
    assert numbers == sorted(set(numbers))
    assert not any(e.end.sec - e.start.sec > 60 for e in twin.estimates)  # none across the leap


def test_a_simulated_clock_that_goes_back_drops_the_cycle_and_keeps_what_was_learnt(
    graph, tmp_path
):
    twin = Watched(graph, tmp_path, use_sim_time=True)
    waiting = twin.wait_for("clock.waiting")
    assert "no /clock has come yet" in waiting.evidence
    clock = graph.node.create_publisher(Clock, "/clock", 10)
    graph.spin_until(clock.get_subscription_count)

    def is_running() -> bool:
        clock.publish(Clock(clock=to_time(START_NS)))  # best effort
        return bool(twin.faults()["clock.waiting", ""].status == Fault.HEALED)

    graph.spin_until(is_running, 120.0, "the clock to be taken")
    feeder = Feeder(graph, NS)
    feeder.feed(3 * feeder.cycle_samples + 30)
    graph.spin_until(lambda: len(twin.estimated()) == 2, 120.0, "two estimates")
    # a sample from before that is taken after the jump would be a leap ahead and a second jump
    graph.spin_until(lambda: len(twin.predictions) >= feeder.sent - 2, 120.0, "all predictions")

    def is_back() -> bool:
        clock.publish(Clock(clock=to_time(START_NS - 5 * 10**11)))
        return ("clock.set_back", "") in twin.faults()

    graph.spin_until(is_back, 120.0, "the jump to be told")
    feeder.feed(3 * feeder.cycle_samples, offset_ns=START_NS - 5 * 10**11)
    graph.spin_until(lambda: len(twin.estimated()) >= 4, 120.0, "estimates after the jump")
    numbers = [c.cycle for c in twin.cycles]
    assert numbers == sorted(set(numbers))


def test_a_twin_that_is_held_up_loses_nothing_from_a_deep_queue(graph, tmp_path):
    twin = Watched(graph, tmp_path)
    feeder = Feeder(graph, NS)
    feeder.feed(50)
    graph.spin_until(lambda: len(twin.predictions) == 50, what="50 predictions")
    twin.process.process.send_signal(signal.SIGSTOP)
    feeder.feed(3000, paced=False)
    twin.process.process.send_signal(signal.SIGCONT)
    graph.spin_until(lambda: len(twin.predictions) == 3050, 120.0, "3050 predictions")
    twin.fresh()
    assert twin.counts(POSITION) == (3050, 0, 0)


def test_an_overrun_of_the_queue_is_counted_to_the_message(graph, tmp_path):
    twin = Watched(graph, tmp_path, input_queue=100)
    feeder = Feeder(graph, NS)
    feeder.feed(50)
    graph.spin_until(lambda: len(twin.predictions) == 50, what="50 predictions")
    twin.process.process.send_signal(signal.SIGSTOP)
    feeder.feed(1000, paced=False)
    graph.spin(1.0)
    twin.process.process.send_signal(signal.SIGCONT)
    graph.spin_until(lambda: len(twin.predictions) > 50, what="predictions again")
    for _ in range(10):  # the numbering tells of a loss when something follows it
        feeder.feed(1)
        twin.fresh()
        if sum(twin.counts(POSITION)[:2]) == feeder.sent:
            break
    assert sum(twin.counts(POSITION)[:2]) == feeder.sent
    lost = twin.counts(POSITION)[1]
    codes = ("input.overrun", "input.loss")
    told = [int(twin.figure(f"fault.{c}.{POSITION}.events") or 0) for c in codes]
    assert lost > 0
    assert sum(told) == lost


def test_a_subscriber_that_takes_nothing_does_not_slow_the_twin(graph, tmp_path):
    twin = Watched(graph, tmp_path)
    viewer = graph.start("aging_monitor")
    graph.wait_log(viewer, "is active")
    lazy = graph.stranger("viewer")
    from valve_twin_msgs.msg import Prediction

    lazy.create_subscription(Prediction, f"{NS}/twin/prediction", print, 10)  # never spun
    feeder = Feeder(graph, NS)
    viewer.process.send_signal(signal.SIGSTOP)
    for _ in range(60):
        feeder.feed(100)
        graph.spin(0.01)
    graph.spin_until(lambda: len(twin.predictions) == 6000, 120.0, "6000 predictions")
    twin.fresh()
    assert twin.counts(POSITION) == (6000, 0, 0)
    viewer.process.send_signal(signal.SIGCONT)


def test_who_comes_late_gets_the_newest_estimate_verdict_trend_and_faults(graph, tmp_path):
    from valve_twin_msgs.msg import Estimate, Faults, Trend, Verdict

    from test.nodes.rough import LATCHED

    twin = Watched(graph, tmp_path, silence_s=0.5)
    monitor = graph.start("aging_monitor", retry_s=0.1)
    trends = graph.record(f"{NS}/aging_monitor/trend/K_in", Trend, LATCHED)
    feeder = Feeder(graph, NS)
    for _ in range(5):
        feeder.feed(feeder.cycle_samples)
        graph.spin(0.01)
    graph.spin_until(lambda: len(twin.estimated()) >= 4, 120.0, "four estimates")
    graph.spin_until(lambda: trends and trends[-1].samples >= 4, 120.0, monitor.log)
    twin.wait_for("input.silent", POSITION)
    here = graph.stranger("late")
    late: dict[str, Any] = {}
    topics = {
        "twin/estimate": Estimate,
        "twin/faults": Faults,
        "aging_monitor/verdict": Verdict,
        "aging_monitor/trend/K_in": Trend,
    }
    graph.executor_of(here)
    for topic, kind in topics.items():
        here.create_subscription(
            kind, f"{NS}/{topic}", lambda m, t=topic: late.__setitem__(t, m), LATCHED
        )
    graph.spin_until(lambda: len(late) == len(topics), 120.0, f"late: {list(late)}")
    trend = "aging_monitor/trend/K_in"
    graph.spin_until(lambda: late[trend].samples == trends[-1].samples, what="the same trend")
    newest = max(twin.estimated())
    graph.spin_until(lambda: late["twin/estimate"].cycle == newest, what="the newest estimate")
    assert late["twin/faults"].faults


def test_a_refused_parameter_is_a_fault_that_can_be_cleared(graph, tmp_path):
    from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
    from rcl_interfaces.srv import SetParameters

    twin = Watched(graph, tmp_path)
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=0.05)
    for name, words in (
        ("period_s", "clean up the node"),
        ("perod_s", "did you mean 'period_s'?"),
    ):
        answer = graph.call(
            SetParameters,
            f"{NS}/twin/set_parameters",
            parameters=[Parameter(name=name, value=value)],
        )
        assert not answer.results[0].successful
        assert words in answer.results[0].reason
        graph.spin_until(  # that of a later one comes with the next look
            lambda w=words: w in twin.wait_for("parameter.refused").evidence, what=words
        )
    cleared = graph.call(ClearFaults, f"{NS}/twin/clear_faults", code="parameter.refused")
    assert (cleared.success, cleared.cleared) == (True, 1)
    graph.spin_until(lambda: ("parameter.refused", "") not in twin.faults(), what="cleared")
    wrong = graph.call(ClearFaults, f"{NS}/twin/clear_faults", code="parameter.refsed")
    assert not wrong.success
    assert "write what ~/faults says" in wrong.message


def test_an_aging_rule_that_is_set_while_it_runs_is_refused_with_the_service(graph):
    from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
    from rcl_interfaces.srv import SetParameters

    graph.start("simulated_valve")
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=-0.01)
    answer = graph.call(
        SetParameters,
        f"{NS}/simulated_valve/set_parameters",
        parameters=[Parameter(name="simulation.aging.area_in.rate", value=value)],
    )
    assert not answer.results[0].successful
    assert "read at start only" in answer.results[0].reason
    assert "set_aging" in answer.results[0].reason


def test_exchanged_commands_are_a_fault_with_the_remedy_and_are_not_fitted(graph, tmp_path):
    given = {"signals.v_in.topic": "command/v_out", "signals.v_out.topic": "command/v_in"}
    twin = Watched(graph, tmp_path, **given)
    feeder = Feeder(graph, NS)
    feeder.feed(5 * feeder.cycle_samples)
    fault = twin.wait_for("estimation.refused")
    assert "falls while v_in is on and rises while v_out is on: exchange" in fault.evidence
    twin.fresh()
    assert twin.figure("fault.estimation.refused.status") == "confirmed"
    assert twin.figure("fault.estimation.refused.severity") == "WARN"
    graph.spin_until(lambda: len(twin.estimated()) >= 3, 120.0, "what is told of three cycles")
    told = twin.estimated().values()
    assert all(m.status == Estimate.REFUSED for m in told)
    assert all(math.isnan(v) for m in told for v in m.values)
