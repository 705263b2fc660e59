# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Live nodes against bare rclpy nodes: real processes on a ROS domain of their own.

A sample is one input message: a frame of the press valve is three of them (two commands and the
position) and one prediction. Twin and peer take the same messages at the same time; where any is
lost there is no ratio but the number that came, and where more came it is an error.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.bench.measure import Better, Ratio, Scale, median
from valve_twin.bench.nodes.processes import NodeProcess, some_domain, start_node, start_peer
from valve_twin.core.alignment import SignalRange
from valve_twin.core.cycle_config import CycleConfig
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.simulation import simulate_cycles
from valve_twin.core.twin import Twin, TwinConfig
from valve_twin.core.types import Prediction
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation
from valve_twin.io.cdr.codec import decode_series, encode_series
from valve_twin.io.cdr.signals import batch_stamps

if TYPE_CHECKING:
    from collections.abc import Iterator

    from valve_twin.bench.nodes.plant import Plant, Taken
    from valve_twin.core.simulation.block import SimulationBlock

VALVES = 50
"""Valves of one process."""

CYCLE = 850
"""Samples of a production cycle of the plant."""

PLANT_HZ = 33.0
"""Pace of a press valve [Hz]."""

_FLEET = f"{VALVES} valves at {PLANT_HZ:.0f} Hz,"

FLEET_SINGLE, FLEET_BATCHED = 1.2, 0.6
"""Goals against a bare subscriber of the same inputs: with a message a sample, and with one of
predictions a valve a second."""

FLEET_RELAYED = 1.5
"""Goal against the smallest program that takes the same messages and sends as many as the twin:
that against a bare subscriber, which takes three times as long, in other words."""

LEAD = 5
"""Messages a topic before its cost is measured: by then a twin knows how often it speaks."""

LOOP_NUMBERS = 45
"""A sample of a batch may cost what Python takes to sum so many: 0.5 us where 1e6 take 11 ms."""

SERIES = "valve_twin_msgs/msg/Float64Series"


def compare(scale: Scale) -> Iterator[Ratio]:
    """Yield the comparisons of this area."""
    seconds = 2.0 if scale.quick else 20.0
    yield from _start(1 if scale.quick else 5)
    for name, rows in (
        ("twin at 1 kHz", _one_valve(3 if scale.quick else 20)),
        ("batches of 100", _batches(0.75 * seconds)),
        (f"{_FLEET} single samples", _fleet(FLEET_SINGLE, seconds)),
        (
            f"{_FLEET} predictions a message a second",
            _fleet(FLEET_BATCHED, seconds, gathered_s=1.0),
        ),
        (f"{_FLEET} a message a second", _fleet(FLEET_BATCHED, 1.5 * seconds, batch=33)),
        (
            f"{_FLEET} a message a second, against the middleware",
            _fleet(FLEET_RELAYED, 1.5 * seconds, batch=33, peer="relay"),
        ),
    ):
        try:
            for row in rows:
                yield replace(row, name=row.name or name, better=Better.LOWER)
        except TimeoutError as err:
            yield Ratio(name, "", nan, nan, nan, unmeasured=str(err), better=Better.LOWER)


@dataclass(frozen=True, slots=True)
class Live:
    """Twin, peer and the plant that feeds them; predictions, and what a relay sends, by valve."""

    plant: Plant
    twin: NodeProcess
    peer: NodeProcess | None
    predictions: tuple[Taken, ...]
    returned: Taken | None
    relayed: tuple[Taken, ...] = ()

    def settle(self, predicted: int, returned: int) -> None:
        """Wait until every valve has predicted so many samples, the peer taken so many messages.

        Raises
        ------
        TimeoutError
            If fewer came: the machine was too busy, or they are lost.
        AssertionError
            If more came.
        """
        try:
            self.plant.wait(lambda: self._least() >= predicted, "")
        except TimeoutError as err:
            message = f"of {predicted} predictions of a valve {self._least()} came"
            raise TimeoutError(message) from err
        if self.returned is not None:
            self.plant.wait(lambda: self._peer() >= returned, "the peer's messages")
            assert self._peer() == returned, f"the peer took {self._peer()}, not {returned}"
        most = max(t.samples or t.messages for t in self.predictions)
        assert most == predicted, f"{most} predictions of {predicted} samples"

    def _least(self) -> int:
        return min(t.samples or t.messages for t in self.predictions)

    def _peer(self) -> int:
        taken = self.returned
        assert taken is not None
        counts = len(taken.last) == _COUNT_BYTES
        return int.from_bytes(taken.last[4:12], "little") if counts else taken.messages


_COUNT_BYTES = 12

GREETINGS = 10
"""Messages after which a publisher is known to be deaf."""


@contextmanager
def live(
    valves: int,
    period_s: float,
    *,
    peer: str = "",
    batch: int = 1,
    slow: int = 1,
    gathered_s: float = 0.0,
) -> Iterator[Live]:
    """Run a twin of so many press valves, a peer and a plant.

    Parameters
    ----------
    valves : int
        Valves, all in one process.
    period_s : float
        Sampling time [s].
    peer : str
        'echo' of the positions, 'count' or 'relay' of all topics, or none.
    batch : int
        Samples a message.
    slow : int
        Stretches the production cycle.
    gathered_s : float
        Data time of a message of predictions [s]; 0 = as the inputs come.
    """
    from std_msgs.msg import Int64
    from valve_twin_msgs import msg

    from valve_twin.bench.nodes.plant import TOPICS, Plant

    names = [f"v{n}" for n in range(valves)]
    spaces = [f"/press/{n}" for n in names]
    domain = some_domain()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        plant = stack.enter_context(Plant(spaces, domain, batch=batch, slow=slow))
        kind = msg.PredictionSeries if batch > 1 or gathered_s > 0.0 else msg.Prediction
        predictions = [plant.listen(f"{s}/twin/prediction", kind) for s in spaces]
        stamped = msg.Float64Stamped if batch == 1 else msg.Float64Series
        returned = None
        if peer == "echo":
            returned = plant.listen(f"{spaces[0]}/spool_position/echo", stamped)
        elif peer:
            returned = plant.listen("/taken", Int64)
        relayed = [plant.listen(f"{s}/{TOPICS[-1]}/echo", kind) for s in spaces if peer == "relay"]
        parameters = {**_press(period_s, batch), "valves": names}
        parameters["prediction_batch_s"] = gathered_s
        parameters["history_url"] = f"sqlite:///{folder}/history.sqlite"
        twin = start_node("twin", domain, folder, "/press", parameters)
        stack.callback(twin.end)
        other = None
        if peer:
            own = [TOPICS[-1]] if peer == "echo" else list(TOPICS)
            topics = [f"{s}/{t}" for s in spaces for t in own]
            other = start_peer(peer, domain, folder, topics, stamped.__name__)
            stack.callback(other.end)
            stack.callback(twin.terminate)  # both end at the same time
        wanted = 2 if peer in ("count", "relay") else 1
        plant.wait(lambda: plant.subscribers() >= wanted and plant.heard(), "nodes", 60.0)
        echoes = [returned] if returned is not None and peer == "echo" else []
        _greet(plant, (*predictions, *echoes, *relayed), period_s, batch)
        yield Live(plant, twin, other, tuple(predictions), returned, tuple(relayed))


def _greet(plant: Plant, answers: tuple[Taken, ...], period_s: float, batch: int) -> None:
    """Send a message at a time until every publisher answers, then count from here.

    A publisher that does not know of its subscriber yet loses its message.
    """
    for _ in range(GREETINGS):
        before = [t.messages for t in answers]
        plant.run(1.0 / PLANT_HZ, PLANT_HZ, period_s)
        with suppress(TimeoutError):
            plant.wait(partial(_answered, answers, before), "an answer to each message", 3.0)
            break
    for taken in answers:
        taken.messages, taken.samples = plant.sent, batch * plant.sent if taken.series else 0


def _answered(answers: tuple[Taken, ...], before: list[int]) -> bool:
    return all(t.messages > n for t, n in zip(answers, before, strict=True))


def _press(period_s: float, batch: int) -> dict[str, object]:
    return {
        "model": "press_cartridge",
        "period_s": period_s,
        "cycles.start_signal": "v_in",
        "cycles.rearm_signal": "v_out",
        "cycles.min_cycle_s": 100.0 * period_s,
    } | (
        {f"signals.{s}.type": SERIES for s in ("v_in", "v_out", "spool_position")}
        if batch > 1
        else {}
    )


def _one_valve(cycles: int) -> Iterator[Ratio]:
    """Twin of one valve at 1 kHz against a bare echo of its position, CPU time and delay.

    A quantile of the delay is taken a production cycle, each with one estimation; of the cycles
    the median counts, so that what the machine does once to one of both does not.
    """
    with live(1, 1e-3, peer="echo") as run:
        plant, (taken,), echoed = run.plant, run.predictions, run.returned
        assert run.peer is not None
        assert echoed is not None
        plant.run(2.0, 1000.0)  # two cycles: a model is in force
        run.settle(plant.sent, plant.sent)
        taken.delay_ns.clear()
        echoed.delay_ns.clear()
        before, sent = (run.twin.cpu_s(), run.peer.cpu_s()), plant.sent
        plant.run(1e-3 * CYCLE * cycles, 1000.0)
        run.settle(plant.sent, plant.sent)
        frames = plant.sent - sent
        ours, theirs = run.twin.cpu_s() - before[0], run.peer.cpu_s() - before[1]
        run.peer.end()
        late = [1e-9 * _quantile(t.delay_ns, 0.99) for t in (taken, echoed)]
        typical = [1e-9 * _quantile(t.delay_ns, 0.5) for t in (taken, echoed)]
        flood = _flood(replace(run, peer=None, returned=None), 1.0 if cycles < 10 else 10.0)
    echo = "a bare echo"
    yield Ratio(
        "twin at 1 kHz, CPU an input message", echo, ours / frames / 3, theirs / frames, 0.5
    )
    yield Ratio(
        "twin at 1 kHz, CPU a prediction of three", echo, ours / frames, theirs / frames, 1.5
    )
    yield Ratio("one-way delay at 1 kHz, 99 %", echo, late[0], late[1], 1.0)
    yield Ratio("one-way delay at 1 kHz, median", echo, typical[0], typical[1], 1.0)
    yield flood


def _quantile(values: list[int], share: float) -> float:
    """Return the median, over whole production cycles, of a quantile in each."""
    cycles = (sorted(values[k : k + CYCLE]) for k in range(0, len(values) - CYCLE + 1, CYCLE))
    return statistics.median(float(c[int(share * (CYCLE - 1))]) for c in cycles)


def _flood(run: Live, seconds: float) -> Ratio:
    """5000 input messages a second through one node, none lost; elapsed time."""
    rate, sent, begin = 5000.0 / 3.0, run.plant.sent, time.perf_counter()
    run.plant.run(seconds, rate)
    run.settle(run.plant.sent, 0)
    ours = time.perf_counter() - begin
    pace = (run.plant.sent - sent) / rate
    return Ratio("5000 samples/s through one node, none lost", "their own pace", ours, pace, 1.05)


def _batches(seconds: float) -> Iterator[Ratio]:
    """Batches of 100 samples over DDS and in the process alone, against a loop in Python."""
    peer = f"a sum of {LOOP_NUMBERS} numbers in Python"
    loop = LOOP_NUMBERS * 1e-6 * median(lambda: sum(range(1_000_000)), 9)
    yield Ratio("batches of 100 in the process, CPU a sample", peer, _path(), loop, 1.0)
    with live(1, 1e-4, batch=100, slow=20) as run:
        run.plant.run(1.0, 100.0, 1e-4)
        run.settle(100 * run.plant.sent, 0)
        loop = _paced_loop()
        before, sent = run.twin.cpu_s(), run.plant.sent
        run.plant.run(seconds, 100.0, 1e-4)
        run.settle(100 * run.plant.sent, 0)
        ours = (run.twin.cpu_s() - before) / (300.0 * (run.plant.sent - sent))
        loop = 0.5 * (loop + _paced_loop())
    yield Ratio("batches of 100 with the middleware, CPU a sample", peer, ours, loop, 4.0)


def _paced_loop() -> float:
    """Return the time of the loop in Python for one sample, begun a hundred times a second [s].

    A processor that wakes for every batch is slower than one that never sleeps, up to twice.
    """
    numbers, times = 50_000, []
    for _ in range(100):
        time.sleep(0.01)
        begin = time.thread_time()
        sum(range(numbers))
        times.append((time.thread_time() - begin) / numbers)
    return LOOP_NUMBERS * statistics.median(times)


def _path() -> float:
    """Return the time to decode, align, predict and encode one input sample of batches [s]."""
    from valve_twin.nodes.runtime.messages import series_bytes

    config = get_simulation("press_cartridge")
    model = get_model("press_cartridge")
    names = (*model.inputs, model.output)
    ranges = tuple(SignalRange(s) for s in (model.output, *model.inputs))
    options = complete_options(model, {})
    cut = CycleConfig(start_signal="v_in", rearm_signal="v_out", min_cycle_s=5.0)
    twin = Twin(TwinConfig(config.period_s, ranges, cycles=cut, options=options), model)
    rounds = [_serialized(block, config.period_s) for block in simulate_cycles(config, 8, seed=1)]
    times, predicted = [], 0
    for batches in rounds:
        begin = time.process_time()
        for batch in batches:
            parts = []
            for signal, data in zip(names, batch, strict=True):
                stamp, period, values = decode_series(data)
                parts.append((signal, batch_stamps(stamp, period, len(values)), values))
            for event in twin.push_round(parts):
                if isinstance(event, Prediction):
                    predicted += len(event.stamp_ns)
                    for _ in series_bytes(event, config.period_s):
                        pass
        times.append((time.process_time() - begin) / (300.0 * len(batches)))
        while (job := twin.next_job()) is not None:
            twin.deliver(*estimate_cycle(model, options, job.cycle, job.memory))
    assert predicted == 100 * sum(len(r) for r in rounds), "samples were lost"
    return statistics.median(times)


def _serialized(block: SimulationBlock, period_s: float) -> list[list[bytes]]:
    """Return whole batches of 100 of both commands and the position."""
    columns = (*block.inputs.T, block.position)
    return [
        [encode_series(int(block.stamp_ns[k]), period_s, c[k : k + 100]) for c in columns]
        for k in range(0, len(block.position) - 99, 100)
    ]


def _fleet(
    goal: float, seconds: float, *, batch: int = 1, gathered_s: float = 0.0, peer: str = "count"
) -> Iterator[Ratio]:
    """50 valves at 33 Hz in one process against a peer of the same topics."""
    with live(VALVES, 1.0 / PLANT_HZ, peer=peer, batch=batch, gathered_s=gathered_s) as run:
        plant, rate = run.plant, PLANT_HZ / batch
        assert run.peer is not None
        plant.run(max(1.0, LEAD / rate), rate, 1.0 / PLANT_HZ)
        run.settle(batch * plant.sent, 3 * VALVES * plant.sent)
        before = run.twin.cpu_s(), run.peer.cpu_s()
        plant.run(seconds, rate, 1.0 / PLANT_HZ)
        run.settle(batch * plant.sent, 3 * VALVES * plant.sent)
        ours, theirs = run.twin.cpu_s() - before[0], run.peer.cpu_s() - before[1]
    what = "a bare subscriber" if peer == "count" else "taking and sending the same alone"
    yield Ratio("", what, ours, theirs, goal)


def _start(repeats: int) -> Iterator[Ratio]:
    """From the start of the process to the active node, against `import cvxpy` alone."""
    ours, peer = zip(*((_start_twin(), _import_cvxpy()) for _ in range(repeats)), strict=True)
    for k, what in enumerate(("CPU", "elapsed")):
        yield Ratio(
            f"twin from start to active, {what}",
            "import cvxpy",
            statistics.median(o[k] for o in ours),
            statistics.median(p[k] for p in peer),
            1.0,
            better=Better.LOWER,
        )


def _start_twin() -> tuple[float, float]:
    """Return CPU and elapsed time until the twin says that it listens [s]."""
    with tempfile.TemporaryDirectory() as name:
        parameters = _press(0.03, 1) | {"history_url": f"sqlite:///{name}/history.sqlite"}
        begin = time.perf_counter()
        node = start_node("twin", some_domain(), Path(name), "/press/v1", parameters)
        try:
            while ACTIVE not in node.log:
                assert node.alive, node.log
                assert time.perf_counter() - begin < 60.0, node.log
                time.sleep(0.002)
            return node.cpu_s(), time.perf_counter() - begin
        finally:
            node.end()


ACTIVE = "is active"
"""What the twin logs when it listens."""


def _import_cvxpy() -> tuple[float, float]:
    program = "import time, cvxpy; print(time.process_time())"
    begin = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True
    )
    return float(done.stdout), time.perf_counter() - begin
