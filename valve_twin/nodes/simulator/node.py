# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The simulated valve node: stands in for the hardware, in real time or faster with /clock."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosgraph_msgs.msg import Clock as ClockMessage

from valve_twin.core.quantity import describe
from valve_twin.core.valves.registry import get_simulation
from valve_twin.io.config.keys import VALVE_KEYS
from valve_twin.io.config.node_parameters import SimulatedValveParameters
from valve_twin.io.errors import ConfigError
from valve_twin.io.fmu.plant import default_simulation, fmu_keys, simulation_for
from valve_twin.io.fmu.unit import KEY
from valve_twin.nodes.player.acknowledgements import Acknowledgements
from valve_twin.nodes.player.outbox import DEPTH, Outbox, SubscriberGate, sending_profile
from valve_twin.nodes.runtime.diagnostics import Diagnostics, Report
from valve_twin.nodes.runtime.node import STEADY, ValveNode
from valve_twin.nodes.runtime.safety import CHECK_S, Guard
from valve_twin.nodes.runtime.stamps import to_time
from valve_twin.nodes.simulator.topics import SimulatedTopics
from valve_twin.nodes.twin.inputs import seconds_now
from valve_twin.nodes.twin.valve_parameters import read_valves
from valve_twin.warmup import compiled, simulate_once

if TYPE_CHECKING:
    from collections.abc import Iterable

    from valve_twin.io.config.valve import ValveConfig

TICK_S = 0.005
"""Period of the pacing timer [s]."""

MOST_SAMPLES = 16
"""Samples published in one tick: a callback has to end soon, and shared memory is not to overflow:
what it drops is sent again, but seconds later."""

LAG_S = 1.0
"""Behind its rate by more than this, the simulation gives up catching up [s]."""


class SimulatedValveNode(ValveNode):
    """Lifecycle node of one or many simulated valves."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("simulated_valve", **kwargs)
        self._valves: list[SimulatedTopics] = []
        self._outbox = Outbox(Acknowledgements(self, seconds_now).is_complete)
        self._timers_made: list[Any] = []
        self._clock_publisher: Any = None
        self._diagnostics: Diagnostics | None = None
        self._begin_s: float | None = None
        self._gate = SubscriberGate(self)
        self._samples = 0
        self._given = SimulatedValveParameters()

    def configure(self) -> None:
        """Read the parameters and build the valves."""
        self._declare_simulation()
        configs = read_valves(self)
        given = self._given = self.parameters.read(SimulatedValveParameters)
        simulations = [self._simulation(config) for config in configs]
        with compiled() as found:  # else the first samples wait for it
            for simulation in simulations:
                simulate_once(simulation)
        if found.kernels:
            self.get_logger().info(f"simulation: {found}")
        for i, (config, simulation) in enumerate(zip(configs, simulations, strict=True)):
            self._valves.append(
                SimulatedTopics(
                    self,
                    config,
                    simulation,
                    seed=given.seed + i,
                    prefix=given.publish_prefix,
                    batch=given.batch,
                    joint=given.joint,
                    stroke=given.joint_stroke,
                )
            )
        self._guard = Guard(self, prefix=given.publish_prefix, allow_live=given.allow_live)
        self._rate = given.rate
        self._diagnostics = Diagnostics(self, self._reports)

    def activate(self) -> None:
        """Check that no real valve is in reach, then run."""
        self._check_safety()
        lossless = self._given.lossless and self._rate != 1.0
        profile = sending_profile()
        if self._publishes_clock():
            self._clock_publisher = self.create_publisher(ClockMessage, "/clock", 10)
        start = self._given.start_time_s or self.get_clock().now().nanoseconds * 1e-9
        for valve in self._valves:
            valve.open(profile, round(start * 1e9))
            for publisher in valve.publishers if lossless else ():
                self._outbox.keep(publisher, DEPTH)
        self._begin_s, self._samples, self._gate = None, 0, SubscriberGate(self)
        self._guard.watch_anew()
        self._timers_made = [
            self.create_timer(TICK_S, self._tick, clock=STEADY),
            self.create_timer(CHECK_S, self._watch, clock=STEADY),
        ]

    def _publishes_clock(self) -> bool:
        """Return what was given; where nothing was, a rate other than 1 needs it."""
        given = self.parameters.given().get("clock")
        return bool(given) if given is not None else self._rate != 1.0

    def deactivate(self) -> None:
        """Stop publishing."""
        for timer in self._timers_made:
            self.destroy_timer(timer)
        self._timers_made = []
        self._outbox.release()
        for valve in self._valves:
            valve.close()
        if self._clock_publisher is not None:
            self.destroy_publisher(self._clock_publisher)
            self._clock_publisher = None

    def cleanup(self) -> None:
        """Forget the valves."""
        for valve in self._valves:
            valve.destroy()
        self._valves = []
        if self._diagnostics is not None:
            self._diagnostics.destroy()
            self._diagnostics = None

    def _declare_simulation(self) -> None:
        self.parameters.declare(VALVE_KEYS)
        model = str(self.parameters["model"])
        try:
            plain = get_simulation(model)
        except ValueError:
            return  # told when the valve is made
        self.parameters.declare(describe(plain, "simulation."))
        given = self.parameters.given()
        own = {k.removeprefix("simulation."): given[k] for k in given if k.startswith(f"{KEY}.")}
        try:
            keys = fmu_keys(own)
        except ValueError:
            return
        if keys.file:
            self.parameters.declare(describe(default_simulation(model, keys), "simulation."))

    def _simulation(self, config: ValveConfig) -> Any:
        where = self.get_fully_qualified_name()
        try:
            simulation = simulation_for(config.model, config.simulation)
        except ValueError as err:
            msg = f"{where}: {err}"
            raise ConfigError(msg) from err
        if simulation.period_s != config.period_s:
            self.get_logger().warning(
                f"{config.name}: simulation.period_s is {simulation.period_s} s and period_s is "
                f"{config.period_s} s: a twin with these parameters expects the latter"
            )
        return simulation

    def _reports(self) -> Iterable[Report]:
        figures: dict[str, object] = {"rate": self._rate, "samples of every valve": self._samples}
        return [Report("simulation", "simulation", figures)]

    def _check_safety(self) -> None:
        self._guard.check([t for v in self._valves for t in v.published_topics])

    def _watch(self) -> None:
        """Look at the graph again; stop where a real valve has come into reach."""
        if not self._timers_made:
            return  # it was due when the node was stopped
        for valve in self._valves:
            valve.look()
        if self._is_safe():
            self.faults.passed("safety.stopped")

    def _is_safe(self) -> bool:
        """Return whether no real valve is in reach; stop where one is."""
        try:
            self._check_safety()
        except ConfigError as err:
            self.faults.report("safety.stopped", f"stopped: {err}")
            self.trigger_deactivate()
            return False
        return True

    def _tick(self) -> None:
        """Publish the samples that are due."""
        if not self._timers_made:
            return  # as in `_watch`
        if not self._outbox.send() or not self._is_released():
            return
        for _ in range(self._due_samples()):
            self._sample()
            if not self._outbox.send():
                return

    def _is_released(self) -> bool:
        """Begin when the graph is settled and enough subscribers are there."""
        if self._begin_s is not None:
            return True
        now = seconds_now()
        wanted = self._given.wait_for_subscribers
        awaited = [p for v in self._valves for p in v.awaited]
        if not self._guard.is_settled(now):
            return False
        if wanted and not self._gate.is_open(awaited, wanted, now):
            return False
        if not self._is_safe():
            return False
        self._begin_s = now
        return True

    def _due_samples(self) -> int:
        """Return how many samples have become due, at most what one tick may take."""
        if self._rate == 0.0 or self._begin_s is None:
            return MOST_SAMPLES
        period_s = self._valves[0].period_s
        due = int((seconds_now() - self._begin_s) * self._rate / period_s) + 1 - self._samples
        behind_s = (due - MOST_SAMPLES) * period_s / self._rate
        if behind_s > LAG_S:
            self._begin_s += behind_s
            self.faults.report(
                "simulation.slow",
                f"rate {self._rate:g} is not reached: the subscribers or this machine are "
                "slower; no sample is lost",
            )
        return min(due, MOST_SAMPLES)

    def _sample(self) -> None:
        """Advance every valve by one message and queue what it gives."""
        self._samples += 1
        for i, valve in enumerate(self._valves):
            stamp_ns = valve.advance(self._outbox, self._given.stop_after_cycles)
            if i == 0 and stamp_ns and self._clock_publisher is not None:
                self._clock_publisher.publish(ClockMessage(clock=to_time(stamp_ns)))
