# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The main job in minutes: a press valve ages, its twin follows; then a really measured valve.

Starts the installed nodes on a ROS domain of their own that does not leave this machine, shows a
live table, and ends with trend, report page and recorded bag.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

if TYPE_CHECKING:
    from collections.abc import Sequence

ROOT = Path(__file__).resolve().parents[1]
NAMESPACE = "/press/valve_1"
BOILER_DATA = "damadics_boiler_valve/boiler_valve_first_half.csv"
AGING_RATE = -0.002
"""Relative change of the filling pilot area a cycle: -14 % over the 70 cycles of the demo."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the demo.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments, default `sys.argv[1:]`.

    Returns
    -------
    int
        0, or 1 where the demo did not reach its cycles or its trend missed the injected drift.
    """
    arguments = _arguments(argv)
    _isolate()
    out = _fresh_folder(Path(arguments.out))
    _say(f"writing to {out}")
    ok = _press(out, arguments.cycles, arguments.rate)
    data = Path(arguments.data) / BOILER_DATA
    if data.is_file():
        ok = _boiler(out, data) and ok
    else:
        _say(f"no measured data at {data}: the second part, a real boiler valve, is left out")
    return 0 if ok else 1


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make demo", description=__doc__)
    parser.add_argument("--cycles", type=int, default=70, help="production cycles to wait for")
    parser.add_argument("--rate", type=float, default=20.0, help="simulated seconds a second")
    parser.add_argument("--out", default="demo_output", help="folder for reports and bags")
    data = ROOT.parent / "shared" / "data"
    parser.add_argument("--data", default=str(data), help="folder of measured data")
    return parser.parse_args(argv)


def _isolate() -> None:
    """Take a ROS domain of our own that does not leave this machine."""
    os.environ["ROS_DOMAIN_ID"] = str(random.SystemRandom().randrange(1, 102))
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"


def _fresh_folder(base: Path) -> Path:
    number = 1
    while (base / str(number)).exists():
        number += 1
    out = base / str(number)
    out.mkdir(parents=True)
    return out.resolve()


# -- the press valve


def _press(out: Path, cycles: int, rate: float) -> bool:
    parameters = {
        "rate": rate,
        "stop_after_cycles": cycles + 1,
        "wait_for_subscribers": 2,  # the twin and the recorder, on every topic
        "signals": {"cycle_counter": {"topic": "cycle"}, "reference": {"topic": "reference"}},
        "history_url": f"sqlite:///{out / 'history.sqlite'}",
        "simulation": {"aging": {"area_in": {"law": "linear", "rate": AGING_RATE}}},
    }
    overrides = _write_parameters(out / "press.yaml", parameters)
    files = [ROOT / "config" / "simulated_press.yaml", overrides]
    bag = out / "press_bag"
    with Processes(out) as processes:
        processes.start("twin", NAMESPACE, files)
        processes.start("aging_monitor", NAMESPACE, files)
        recorded = ["-p", f"bag:={bag}", "-p", "all:=true"]
        processes.start("bag_recorder", NAMESPACE, files, recorded)
        processes.start("simulated_valve", NAMESPACE, files)
        seen = _watch(processes, cycles, limit_s=max(60.0, 2.5 * 25.5 * cycles / rate))
    if seen < cycles:
        _say(f"only {seen} of {cycles} cycles were estimated; see the logs in {out}")
        return False
    return _conclude(out, bag, files)


def _write_parameters(path: Path, parameters: dict[str, object]) -> Path:
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": parameters}}), encoding="utf-8")
    return path


def _watch(processes: Processes, cycles: int, *, limit_s: float) -> int:
    """Show the live table until enough cycles are estimated."""
    from valve_twin.nodes.watch import watch  # ROS is needed from here on

    return watch(NAMESPACE, cycles, limit_s=limit_s, alive=processes.alive)


def _conclude(out: Path, bag: Path, files: list[Path]) -> bool:
    """Report from the recorded bag; hold the trend against what was injected."""
    from valve_twin.cli import main as valve_twin

    page = out / "press_report.html"
    merged = _merged(files, out / "press_config.yaml")
    code = valve_twin(["report", str(bag), "--config", str(merged), "--out", str(page)])
    found = _injected_drift_is_found(out, merged)
    _say(f"report page: {page}")
    _say(f"recorded bag: {bag}")
    _say(f"history:      {out / 'history.sqlite'}")
    return code == 0 and found


def _merged(files: list[Path], path: Path) -> Path:
    """Write the parameters of the demo into one file for the offline command."""
    tree: dict[str, object] = {}
    for file in files:
        sections = yaml.safe_load(file.read_text(encoding="utf-8"))
        for section in sections.values():
            _merge(tree, section["ros__parameters"])
    for key in ("rate", "stop_after_cycles", "wait_for_subscribers"):
        tree.pop(key, None)
    path.write_text(
        yaml.safe_dump({f"{NAMESPACE}/twin": {"ros__parameters": tree}}), encoding="utf-8"
    )
    return path


def _merge(tree: dict[str, object], more: dict[str, object]) -> None:
    for key, value in more.items():
        mine = tree.get(key)
        if isinstance(mine, dict) and isinstance(value, dict):
            _merge(mine, value)
        else:
            tree[key] = value


def _injected_drift_is_found(out: Path, config_file: Path) -> bool:
    """Compare the stored history's trend of K_in with the truth of the simulated valve."""
    from valve_twin.core.aging import assess
    from valve_twin.core.simulation import cycle_truth
    from valve_twin.core.valves.registry import get_model
    from valve_twin.io.config import load_config
    from valve_twin.io.history import History
    from valve_twin.io.simulated_bag import simulation_of

    (config,) = load_config(config_file)
    with History(config.history_url, read_only=True) as history:
        estimates = history.estimates(config.name)
    parameters = get_model(config.model).parameters
    assessment = assess(estimates, (), config.aging, parameters=parameters, valve=config.name)
    trend = next(t for t in assessment.trends if t.parameter == "K_in")
    numbers = sorted({e.cycle for e in estimates if e.used_by_trend})
    simulation = simulation_of(config)
    truth = [float(cycle_truth(simulation, n).gains[0]) for n in numbers]
    reference = sum(truth[: config.aging.reference_cycles]) / config.aging.reference_cycles
    injected = 100.0 * (truth[-1] / reference - 1.0)
    low, high = trend.drift_reference_lower_95, trend.drift_reference_upper_95
    inside = low <= injected <= high
    _say(
        f"K_in: injected drift {injected:.1f} %, found {trend.drift_reference:.1f} % "
        f"(95 %: {low:.1f} .. {high:.1f}): {'inside' if inside else 'OUTSIDE'} the interval"
    )
    _say(f"verdict: {assessment.verdict.text}: {assessment.verdict.evidence}")
    return inside


# -- the boiler valve


def _boiler(out: Path, data: Path) -> bool:
    """Import measured data, replay it through the live nodes, report."""
    from valve_twin.cli import main as valve_twin
    from valve_twin.nodes.watch import watch

    config = ROOT / "config" / "boiler_valve.yaml"
    bag = out / "boiler_bag"
    if valve_twin(["import", str(data), "--config", str(config), "--out", str(bag)]) != 0:
        return False
    overrides = _write_parameters(
        out / "boiler.yaml",
        {
            "topic_prefix": "/replay",
            "history_url": f"sqlite:///{out / 'boiler_history.sqlite'}",
            "rate": 300.0,
            "wait_for_subscribers": 1,
            "topics": ["/boiler_valve/command", "/boiler_valve/position"],
        },
    )
    _say("a real valve: half an hour of a boiler's feed-water valve, replayed 300 times as fast")
    with Processes(out) as processes:
        processes.start("twin", "/", [config, overrides])
        processes.start("bag_player", "/", [config, overrides], ["-p", f"bag:={bag}"])
        seen = watch("/boiler_valve", 5, limit_s=60.0, alive=processes.alive)
    page = out / "boiler_report.html"
    code = valve_twin(["report", str(bag), "--config", str(config), "--out", str(page)])
    _say(f"report page: {page}")
    return seen >= 5 and code == 0


# -- processes


class Processes:
    """Nodes as the installed executables, ended by their id whatever happens.

    Parameters
    ----------
    logs : Path
        Folder for their output.
    """

    def __init__(self, logs: Path) -> None:
        self._logs = logs
        self._running: list[tuple[str, subprocess.Popen[bytes]]] = []

    def __enter__(self) -> Processes:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End all, newest first: SIGINT, and SIGKILL where that is not enough."""
        for _name, process in reversed(self._running):
            process.send_signal(signal.SIGINT)
        for name, process in reversed(self._running):
            try:
                process.wait(timeout=10.0)
            except subprocess.TimeoutExpired:
                _say(f"{name} did not end by itself")
                process.kill()
                process.wait()

    def start(
        self, name: str, namespace: str, files: Sequence[Path], more: Sequence[str] = ()
    ) -> None:
        """Start one node with parameter files, later ones first in rank."""
        command = [str(_executable(name)), "--ros-args", "-r", f"__ns:={namespace}"]
        for file in files:
            command += ["--params-file", str(file)]
        log = (self._logs / f"{name}.log").open("ab")
        process = subprocess.Popen([*command, *more], stdout=log, stderr=subprocess.STDOUT)
        log.close()
        self._running.append((name, process))

    def alive(self) -> bool:
        """Return whether all nodes still run."""
        return all(process.poll() is None for _, process in self._running)


def _executable(name: str) -> Path:
    """Return the executable that `ros2 run valve_twin NAME` starts."""
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        path = Path(prefix) / "lib" / "valve_twin" / name
        if path.is_file():
            return path
    msg = f"the executable {name} is not installed: run make setup, and this through tools/run"
    raise SystemExit(msg)


def _say(text: str) -> None:
    sys.stdout.write(f"{time.strftime('%H:%M:%S')}  {text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
