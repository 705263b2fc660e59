# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Look at one valve of the twin once a second and file what is wrong with it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.nodes.twin.inputs import INPUT_CODES

if TYPE_CHECKING:
    from valve_twin.nodes.runtime.fault_reporter import FaultReporter
    from valve_twin.nodes.twin.inputs import TopicInput
    from valve_twin.nodes.twin.live_valve import LiveValve

OVERDUE_CYCLES = 2
"""So many estimations behind, predictions begin to wait for the model they need."""


class TwinFaults:
    """What is wrong with one valve.

    Parameters
    ----------
    desk : FaultReporter
        Where faults are filed.
    valve : LiveValve
        The valve.
    """

    def __init__(self, desk: FaultReporter, valve: LiveValve) -> None:
        self._desk, self._valve = desk, valve
        self._seen: dict[tuple[str, str], int] = {}

    def look(self) -> None:
        """File what has happened since the last look."""
        for topic in self._valve.inputs.topics:
            self._look_at_topic(topic)
        self._look_at_samples()
        self._look_at_estimation()

    def _look_at_topic(self, topic: TopicInput) -> None:
        code, text = topic.problem()
        for other in INPUT_CODES:
            self._condition(other, text if other == code else "", topic.topic)
        where = f"topic '{topic.topic}'"
        self._events(
            "input.loss",
            topic.topic,
            topic.lost - topic.overrun,
            f"{where}: %d messages were lost on the way",
        )
        self._events(
            "input.overrun",
            topic.topic,
            topic.overrun,
            f"{where}: %d messages were overwritten before the twin took them",
        )
        self._events(
            "input.unreadable",
            topic.topic,
            topic.broken,
            f"{where}: %d messages are no {topic.type} or hold a batch without a period",
        )
        self._events(
            "input.deadline",
            topic.topic,
            topic.deadlines_missed,
            f"{where} missed its deadline %d times",
        )

    def _look_at_samples(self) -> None:
        valve = self._valve
        for name, counts in valve.twin.counts().items():
            signal = valve.config.signals.get(name)
            where = f"signal {name} of topic '{signal.topic}'" if signal else f"signal {name}"
            self._events(
                "stamps.duplicate", name, counts.duplicate, f"{where}: %d samples repeat a stamp"
            )
            self._events(
                "stamps.late",
                name,
                counts.late,
                f"{where}: %d samples are older than one before or than hold_back_s allows",
            )
            self._events(
                "input.values",
                name,
                counts.bad,
                f"{where}: %d values are not finite or out of range",
            )
        self._events(
            "input.gaps",
            valve.model.output,
            valve.publishers.gaps.missing,
            f"signal {valve.model.output}: %d samples are missing, the longest gap is "
            f"{valve.publishers.gaps.longest_s:.3g} s",
        )
        self._events("clock.set_back", "", valve.jumps, "%d jumps back of the clock")

    def _look_at_estimation(self) -> None:
        valve, jobs, queue = self._valve, self._valve.jobs, self._valve.cycle_queue
        pending = valve.twin.pending_jobs
        self._condition(
            "estimation.overdue",
            f"{pending} cycles wait for their estimation, the last took {jobs.wall_s:.2f} s"
            if pending > OVERDUE_CYCLES
            else "",
        )
        self._events(
            "estimation.failed", "", jobs.failed, f"%d estimations failed: {jobs.failure}"
        )
        self._events(
            "estimation.late",
            "",
            jobs.wait.cut,
            f"%d waits for an estimate were cut off after {jobs.wait.limit_s:g} s",
        )
        self._condition(
            "history.not_stored",
            f"{queue.waiting} cycles wait for the database: {queue.writer.error}"
            if queue.writer.error
            else "",
        )
        self._events("history.dropped", "", queue.dropped, "%d cycles were given up unsaved")
        self._events("history.refused", "", queue.refused, "%d cycles were refused by the history")

    def _condition(self, code: str, evidence: str, subject: str = "") -> None:
        self._desk.look(code, evidence, valve=self._valve.name, subject=subject)

    def _events(self, code: str, subject: str, total: int, text: str) -> None:
        """Report what was added to a counter since the last look; `text` takes the total."""
        seen = self._seen.get((code, subject), 0)
        self._seen[code, subject] = total
        new = total - seen if total >= seen else total  # counters begin anew with the inputs
        if new:
            self._desk.report(
                code,
                f"{text % total} ({new} since the last look)",
                valve=self._valve.name,
                subject=subject,
                events=new,
            )
