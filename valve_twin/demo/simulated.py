# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A simulated valve that ages with its twin, aging monitor and recorder, and what they found."""

from __future__ import annotations

import os
import webbrowser
from importlib.util import find_spec
from typing import TYPE_CHECKING

import yaml

from valve_twin.demo.cases import injected
from valve_twin.demo.processes import Processes, say, write_parameters
from valve_twin.io.cdr.signals import SERIES_TYPE

if TYPE_CHECKING:
    from pathlib import Path

    from valve_twin.demo.cases import Case

SPARE = 2
"""Cycles beyond those waited for: the start of one ends the last, and the first may be cut."""

PAGE_S = 60.0
"""The page is waited for so long [s]."""

HISTORY = "history.sqlite"


def run_case(case: Case, out: Path) -> bool:
    """Run one valve live and report.

    Parameters
    ----------
    case : Case
        The valve.
    out : Path
        Folder for parameters, logs, bag, history and page.

    Returns
    -------
    bool
        Whether all cycles were estimated and the injected drift lies inside the trend's interval.
    """
    overrides = write_parameters(out / f"{case.label}.yaml", _parameters(case, out))
    files = [case.file, overrides]
    bag = out / f"{case.label}_bag"
    with Processes(out) as processes:
        processes.start("twin", case.namespace, files)
        processes.start("aging_monitor", case.namespace, files)
        recorded = ["-p", f"bag:={bag}", "-p", "all:=true"]
        processes.start("bag_recorder", case.namespace, files, recorded)
        _open_page(processes, case, files, bag)
        processes.start("simulated_valve", case.namespace, files)
        seen = _watch(processes, case)
    if seen < case.cycles:
        say(f"only {seen} of {case.cycles} cycles were estimated; see the logs in {out}")
        return False
    return _conclude(case, out, bag, files)


def _parameters(case: Case, out: Path) -> dict[str, object]:
    """Return what the demo sets on top of the valve's file."""
    given: dict[str, object] = {"cycles": {"rule": "counter"}} if case.counts else {}
    return given | {
        "rate": case.rate,
        "batch": case.batch,
        "stop_after_cycles": case.cycles + SPARE,
        "wait_for_subscribers": 2,  # the twin and the recorder, on every topic
        "signals": _signals(case),
        "history_url": f"sqlite:///{out / HISTORY}",
        "simulation": {"aging": {case.aged: {"law": "linear", "rate": case.aging_rate}}},
    }


def _signals(case: Case) -> dict[str, object]:
    """Map the cycle counter and the reference as well; batches change the type of all."""
    given: dict[str, dict[str, object]] = {}
    if case.maps_more:
        given = {"cycle_counter": {"topic": "cycle"}, "reference": {"topic": "reference"}}
    if case.batch > 1:
        signals = _tree([case.file])["signals"]
        assert isinstance(signals, dict)
        for name in (*signals, *given):
            given.setdefault(name, {})["type"] = SERIES_TYPE
    return dict(given)


def _open_page(processes: Processes, case: Case, files: list[Path], bag: Path) -> None:
    """Show the valve in a browser while it runs; without the packages say so."""
    missing = [name for name in ("starlette", "uvicorn", "prometheus_client")
               if find_spec(name) is None]  # fmt: skip
    if missing:
        say(f"no live page: {missing[0]} is missing: pip install valve_twin[gateway]")
        return
    foxglove = ["-p", "foxglove:=0"] if find_spec("foxglove") else []
    more = ["-p", "port:=0", "-p", f"bags:=['{bag}']", *foxglove]
    processes.start("gateway", case.namespace, files, more, beside=True)
    pages = processes.found("gateway", r"valves at (http://\S+)", PAGE_S)
    if not pages:
        say("no live page: see gateway.log")
        return
    page = f"{pages[0]}valve{case.namespace}"
    say(f"live page while it runs: {page}")
    for address in processes.found("gateway", r"Foxglove at (ws://\S+)", 5.0 * bool(foxglove)):
        say(f"live in Foxglove:        {address} (layouts/foxglove.json)")
    screens = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
    if any(os.environ.get(screen) for screen in screens):  # else it would take the terminal
        webbrowser.open(page)


def _watch(processes: Processes, case: Case) -> int:
    """Show the live table until enough cycles are estimated."""
    from valve_twin.demo.watch import watch  # ROS is needed from here on

    limit_s = max(120.0, 5.0 * case.cycle_s * case.cycles / case.rate)
    return watch(
        case.namespace, case.cycles, limit_s=limit_s, alive=processes.alive, first=case.followed
    )


def _conclude(case: Case, out: Path, bag: Path, files: list[Path]) -> bool:
    """Report from the recorded bag; hold the trend against what was injected."""
    from valve_twin.cli import main as valve_twin

    page = out / f"{case.label}_report.html"
    merged = _merged(case, files, out / f"{case.label}_config.yaml")
    code = valve_twin(["report", str(bag), "--config", str(merged), "--out", str(page)])
    found = _injected_drift_is_found(case, merged)
    say(f"report page: {page}")
    _say_where(out, bag)
    return code == 0 and found


def say_stopped(case: Case, out: Path) -> None:
    """Say where to look after a demo that somebody stopped.

    Parameters
    ----------
    case : Case
        The valve.
    out : Path
        The demo's folder.
    """
    say(f"stopped; the logs are in {out}")
    bag, overrides = out / f"{case.label}_bag", out / f"{case.label}.yaml"
    if not (bag.is_dir() and (out / HISTORY).is_file()):
        say("nothing is recorded yet")
        return
    merged = _merged(case, [case.file, overrides], out / f"{case.label}_config.yaml")
    page = out / f"{case.label}_report.html"
    say(f"report page: tools/run valve-twin report {bag} --config {merged} --out {page}")
    _say_where(out, bag)


def _say_where(out: Path, bag: Path) -> None:
    """Say where bag and history are, and how to look at them."""
    history = out / HISTORY
    say(f"recorded bag: {bag}")
    say(f"history:      {history}")
    browser = f"tools/run valve-twin serve --url sqlite:///{history} --bag {bag}"
    say(f"in a browser: {browser}, then http://127.0.0.1:8107/ and the valve's name there")
    say(f"in Foxglove:  {browser} --foxglove, then ws://127.0.0.1:8765 (layouts/foxglove.json)")


def _tree(files: list[Path]) -> dict[str, object]:
    """Return the parameters of files in one tree."""
    tree: dict[str, object] = {}
    for file in files:
        sections = yaml.safe_load(file.read_text(encoding="utf-8"))
        for section in sections.values():
            _merge(tree, section["ros__parameters"])
    return tree


def _merged(case: Case, files: list[Path], path: Path) -> Path:
    """Write the parameters of the demo into one file for the offline command."""
    tree = _tree(files)
    for key in ("rate", "stop_after_cycles", "wait_for_subscribers"):
        tree.pop(key, None)
    section = {f"{case.namespace}/twin": {"ros__parameters": tree}}
    path.write_text(yaml.safe_dump(section), encoding="utf-8")
    return path


def _merge(tree: dict[str, object], more: dict[str, object]) -> None:
    for key, value in more.items():
        mine = tree.get(key)
        if isinstance(mine, dict) and isinstance(value, dict):
            _merge(mine, value)
        else:
            tree[key] = value


def _injected_drift_is_found(case: Case, config_file: Path) -> bool:
    """Compare the stored history's trend with the truth of the simulated valve."""
    from valve_twin.core.aging.assess import assess
    from valve_twin.core.valves.registry import get_model
    from valve_twin.io.config.valve import load_config
    from valve_twin.io.history.store import History
    from valve_twin.io.offline.simulated_bag import simulation_of

    (config,) = load_config(config_file)
    with History(config.history_url, read_only=True) as history:
        estimates = history.estimates(config.name)
    parameters = get_model(config.model).parameters
    assessment = assess(estimates, (), config.aging, parameters=parameters, valve=config.name)
    trend = next(t for t in assessment.trends if t.parameter == case.followed)
    numbers = sorted({e.cycle for e in estimates if e.used_by_trend})
    truth = injected(case, simulation_of(config), numbers)
    reference = sum(truth[: config.aging.reference_cycles]) / config.aging.reference_cycles
    drift = 100.0 * (truth[-1] / reference - 1.0)
    low, high = trend.drift_reference_lower_95, trend.drift_reference_upper_95
    inside = low <= drift <= high
    say(
        f"{case.followed}: injected drift {drift:.1f} %, found {trend.drift_reference:.1f} % "
        f"(95 %: {low:.1f} .. {high:.1f}): {'inside' if inside else 'OUTSIDE'} the interval"
    )
    say(f"verdict: {assessment.verdict.text}: {assessment.verdict.evidence}")
    return inside
