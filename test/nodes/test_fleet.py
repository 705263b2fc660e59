# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Fifty valves in one process from one file; a bad valve does not disturb its neighbours."""

from __future__ import annotations

import math
import os

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from valve_twin_msgs.msg import Prediction

from test.nodes.feeding import REARM, START_NS, Feeder
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.simulation.valve import SimulatedValve
from valve_twin.core.twin import Estimated
from valve_twin.core.valves.registry import get_model, get_simulation
from valve_twin.io.config.valve import parse_config
from valve_twin.io.history.store import History
from valve_twin.io.offline.make_twin import make_twin

CYCLES = 3
LAST = 400
"""Samples of the cycle in which the record ends."""

PORTION = 50
"""Samples published at once: less data time than a twin waits for a signal that lags."""

RAISER = """\
import dataclasses
import numpy as np
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.core.valves.press_cartridge.model import PressCartridgeModel

@dataclasses.dataclass(frozen=True)
class Raiser(PressCartridgeModel):
    name: str = "raiser"

    def predict(self, state, coefficients, position, *rest):
        if np.any(position > 5.0):
            raise RuntimeError("the model does not bear this")
        super().predict(state, coefficients, position, *rest)

MODEL = Raiser()
"""
COMMON = {"cycles.start_signal": "v_in", **REARM}


def install_raiser(folder, monkeypatch):
    """Put a package with a model that raises where the node's process finds it."""
    meta = folder / "raiser-1.0.dist-info"
    meta.mkdir(parents=True)
    (meta / "METADATA").write_text("Metadata-Version: 2.1\nName: raiser\nVersion: 1.0\n")
    (meta / "entry_points.txt").write_text("[valve_twin.valves]\nraiser = raiser:MODEL\n")
    (folder / "raiser.py").write_text(RAISER)
    path = os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.setenv("PYTHONPATH", path)


def undisturbed(seed: int) -> list[str]:
    """Return the estimates of a valve whose twin is alone, to the last bit."""
    (config,) = parse_config(COMMON, "test")
    twin, model = make_twin(config), get_model(config.model)
    options = config.options
    simulation = get_simulation("press_cartridge")
    block = SimulatedValve(simulation, seed).advance(CYCLES * simulation.cycle_samples + LAST)
    columns = zip((*model.inputs, model.output), (*block.inputs.T, block.position), strict=True)
    stamps = block.stamp_ns + START_NS
    events = twin.push_round([(n, stamps, np.ascontiguousarray(c)) for n, c in columns])
    found = []
    while (job := twin.next_job()) is not None:
        events = twin.deliver(*estimate_cycle(model, options, job.cycle, job.memory))
        found += [
            repr(e) for event in events if isinstance(event, Estimated) for e in event.estimates
        ]
    return found


def test_fifty_valves_of_one_file_bear_the_bad_ones_among_them(graph, tmp_path, monkeypatch):
    install_raiser(tmp_path / "package", monkeypatch)
    database = tmp_path / "history.sqlite"
    process = graph.start(
        "twin",
        "/press",
        valves=["v_{01..50}"],
        history_url=f"sqlite:///{database}",
        silence_s=1.0,
        v_04={"model": "raiser"},
        v_05={"period_s": -1.0},
        v_06={"model": "gone"},
        **COMMON,
    )
    graph.wait_log(process, "/press/v_50: ")
    found = graph.record("/diagnostics", DiagnosticArray)
    feeders = {n: Feeder(graph, f"/press/v_{n:02d}", seed=n) for n in (1, 2, 4, 50)}
    topics = [f"/press/v_{n:02d}/twin/prediction" for n in (1, 50)]
    predictions = {topic: graph.record(topic, Prediction) for topic in topics}
    graph.spin_until(lambda: graph.connected(*topics), what="predictions")
    graph.be_heard("/press/twin")
    cycle = feeders[1].cycle_samples
    for part, raising in ((cycle * CYCLES, False), (LAST, True)):
        for samples in (PORTION,) * (part // PORTION) + (part % PORTION,):
            for number, feeder in feeders.items():
                wrong = math.nan if number == 2 else 7.0 if number == 4 and raising else None
                feeder.feed(samples, position=wrong)
            sent = feeders[1].sent - 2  # the newest wait for a command that may still come
            graph.spin_until(lambda n=sent: all(len(p) >= n for p in predictions.values()), 120.0)

    def stored(valve: str) -> list[str]:
        if not database.exists():
            return []
        with History(database, read_only=True) as history:
            return [repr(e) for e in history.estimates(valve)]

    for number in (1, 50):
        expected = undisturbed(number)
        assert len(expected) == 3 * CYCLES  # estimators
        name = f"/press/v_{number:02d}"
        graph.spin_until(
            lambda name=name: len(stored(name)) >= 3 * CYCLES, what=f"cycles of {name}"
        )
        assert sorted(stored(name)) == sorted(expected)

    def condition(valve: str) -> DiagnosticStatus | None:
        statuses = (s for message in reversed(found) for s in message.status)
        return next((s for s in statuses if s.name.endswith(f"valve {valve}")), None)

    def says(valve: str, words: str) -> bool:
        status = condition(valve)
        return status is not None and words in status.message

    graph.spin_until(lambda: says("/press/v_04", "does not bear this"), what="the raising model")
    graph.spin_until(lambda: says("/press/v_05", "period_s"), what="the wrong section")
    graph.spin_until(lambda: says("/press/v_06", "'gone' is unknown"), what="the unknown model")

    def is_told_silent() -> bool:
        status = condition("/press/v_03")
        return status is not None and status.level != DiagnosticStatus.OK

    graph.spin_until(is_told_silent, 120.0, "the silent valve")
    with History(database, read_only=True) as history:
        assert {c.cycle for c in history.cycles("/press/v_50")} == set(range(1, CYCLES + 1))
        assert not any(
            e.used_by_trend and e.parameters[0].usable for e in history.estimates("/press/v_02")
        )
    assert process.end() == 0
