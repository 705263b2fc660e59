# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Look at one valve of the twin once a second and file what is wrong with it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.nodes.twin.inputs import INPUT_CODES

if TYPE_CHECKING:
    from valve_twin.core.signal_clocks import ClockOffset
    from valve_twin.nodes.runtime.fault_reporter import FaultReporter
    from valve_twin.nodes.twin.inputs import TopicInput
    from valve_twin.nodes.twin.live_valve import LiveValve

OVERDUE_CYCLES = 2
"""So many estimations behind, predictions begin to wait for the model they need."""

NONE = (0, 0, 0, 0, 0)
"""Counters of a topic at which nothing happened."""


class TwinFaults:
    """What is wrong with one valve.

    Parameters
    ----------
    reporter : FaultReporter
        Where faults are filed.
    valve : LiveValve
        The valve.

    Attributes
    ----------
    offsets : list of ClockOffset
        How far the clocks of its signals run apart.
    """

    def __init__(self, reporter: FaultReporter, valve: LiveValve) -> None:
        self._reporter, self._valve = reporter, valve
        self._seen: dict[tuple[str, str], int] = {}
        self._totals: dict[str, tuple[int, ...]] = {}
        self.offsets: list[ClockOffset] = []

    def look(self) -> None:
        """File what has happened since the last look."""
        for topic in self._valve.inputs.topics:
            self._look_at_topic(topic)
        self._look_at_clocks()
        self._look_at_samples()
        self._look_at_estimation()

    def _look_at_topic(self, topic: TopicInput) -> None:
        code, text = topic.problem()
        for other in INPUT_CODES:
            self._condition(other, text if other == code else "", topic.topic)
        totals = (topic.lost, topic.overrun, topic.broken, topic.deaf, topic.deadlines_missed)
        if totals == self._totals.get(topic.topic, NONE):
            return
        self._totals[topic.topic] = totals
        where, unreadable = f"topic '{topic.topic}'", f"are no {topic.type}"
        for code, total, text in (
            ("input.loss", topic.lost - topic.overrun, ": %d messages were lost on the way"),
            (
                "input.overrun",
                topic.overrun,
                ": %d messages were overwritten before the twin took them",
            ),
            (
                "input.unreadable",
                topic.broken,
                f": %d messages {unreadable}, hold a batch without a period or "
                "more than a million samples",
            ),
            (
                "input.deaf",
                topic.deaf,
                f": {topic.deaf_why}; listened anew %d times",
            ),
            ("input.deadline", topic.deadlines_missed, " missed its deadline %d times"),
        ):
            self._events(code, topic.topic, total, f"{where}{text}")

    def _look_at_clocks(self) -> None:
        found = {offset.signal: offset for offset in self._valve.inputs.look_at_clocks()}
        self.offsets = list(found.values())
        for signal in self._valve.config.signals:
            self._condition("clock.offset", str(found.get(signal, "")), signal)

    def _look_at_samples(self) -> None:
        valve = self._valve
        for name, counts in valve.twin.counts().items():
            signal = valve.config.signals.get(name)
            where = f"signal {name} of topic '{signal.topic}'" if signal else f"signal {name}"
            for code, total, what in (
                ("stamps.duplicate", counts.duplicate, "samples repeat a stamp"),
                (
                    "stamps.late",
                    counts.late,
                    "samples are older than one before or than hold_back_s allows",
                ),
                ("input.values", counts.bad, "values are not finite or out of range"),
            ):
                self._events(code, name, total, f"{where}: %d {what}")
        output, gaps = valve.model.output, valve.publishers.gaps
        longest = f"the longest gap is {gaps.longest_s:.3g} s"
        text = f"signal {output}: %d samples are missing, {longest}"
        self._events("input.gaps", output, gaps.missing, text)
        self._events("clock.set_back", "", valve.jumps, "%d jumps back of the clock")

    def _look_at_estimation(self) -> None:
        valve, jobs, queue = self._valve, self._valve.jobs, self._valve.cycle_queue
        pending = valve.twin.pending_jobs
        overdue = f"{pending} cycles wait for their estimation, the last took {jobs.wall_s:.2f} s"
        self._condition("estimation.overdue", overdue if pending > OVERDUE_CYCLES else "")
        error = queue.writer.error
        kept = f", {queue.flushed} of them flushed to disk" if queue.writer.unsaved else ""
        waiting = f"{queue.waiting} cycles wait for the database{kept}: {error}"
        self._condition("history.not_stored", waiting if error else "")
        cut = f"%d waits for an estimate were cut off after {jobs.wait.limit_s:g} s"
        for code, total, text in (
            ("estimation.failed", jobs.failed, f"%d estimations failed: {jobs.failure}"),
            (
                "estimation.dropped",
                valve.spool.dropped,
                "%d cycles found neither memory nor disk while they waited for their estimation: "
                f"{valve.spool.trouble}",
            ),
            ("estimation.late", jobs.wait.cut, cut),
            ("history.dropped", queue.dropped, "%d cycles were given up unsaved"),
            ("history.refused", queue.refused, "%d cycles were refused by the history"),
        ):
            self._events(code, "", total, text)

    def _condition(self, code: str, evidence: str, subject: str = "") -> None:
        self._reporter.look(code, evidence, valve=self._valve.name, subject=subject)

    def _events(self, code: str, subject: str, total: int, text: str) -> None:
        """Report what was added to a counter since the last look; `text` takes the total."""
        seen = self._seen.get((code, subject), 0)
        self._seen[code, subject] = total
        new = total - seen if total >= seen else total  # counters begin anew with the inputs
        if new:
            self._reporter.report(
                code,
                f"{text.replace('%d', str(total), 1)} ({new} since the last look)",
                valve=self._valve.name,
                subject=subject,
                events=new,
            )
