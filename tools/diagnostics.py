#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Draw what the nodes of the demo say on /diagnostics: tools/run python tools/diagnostics.py.

Twin, aging monitor, recorder and a simulated valve that wears run until the valve's trend is
told; what they said last is grouped by the analyzers of `config/diagnostics.yaml`.
"""

from __future__ import annotations

import re
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from faces import ROOT, Row, draw

from valve_twin.demo.cases import find_case
from valve_twin.demo.processes import Processes, isolate, write_parameters

RATE, PATIENCE_S, TOLD = 20.0, 150.0, "cycles left"
LEVELS = {
    DiagnosticStatus.OK: "OK",
    DiagnosticStatus.WARN: "WARN",
    DiagnosticStatus.ERROR: "ERROR",
    DiagnosticStatus.STALE: "STALE",
}


def said(namespace: str) -> dict[str, DiagnosticStatus]:
    """Return the last status of each name of a valve's nodes, as soon as its wear is told."""
    found: dict[str, DiagnosticStatus] = {}
    rclpy.init()
    node = rclpy.create_node("reader")

    def take(message: DiagnosticArray) -> None:
        found.update({s.name: s for s in message.status if s.name.startswith(f"{namespace}/")})

    node.create_subscription(DiagnosticArray, "/diagnostics", take, 50)
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s and not any(TOLD in s.message for s in found.values()):
        rclpy.spin_once(node, timeout_sec=0.5)
    node.destroy_node()
    rclpy.shutdown()
    return found


def run() -> dict[str, DiagnosticStatus]:
    """Run the nodes of the demo and return what they say."""
    case = find_case(rate=RATE)
    with TemporaryDirectory() as name:
        out = Path(name)
        given = {
            "rate": case.rate,
            "batch": case.batch,
            "history_url": f"sqlite:///{out / 'history.sqlite'}",
            "wait_for_subscribers": 2,
            "simulation": {"aging": {case.aged: {"law": "linear", "rate": case.aging_rate}}},
        }
        files = [case.file, write_parameters(out / "given.yaml", given)]
        with Processes(out) as processes:
            for node in ("twin", "aging_monitor", "bag_recorder", "simulated_valve"):
                more = ["-p", f"bag:={out / 'bag'}"] if node == "bag_recorder" else []
                processes.start(node, case.namespace, files, more)
            return said(case.namespace)


def grouped(found: dict[str, DiagnosticStatus]) -> list[Row]:
    """Return the statuses below the analyzers that take them, worst level of a group beside it."""
    path = ROOT / "config" / "diagnostics.yaml"
    given = yaml.safe_load(path.read_text(encoding="utf-8"))["analyzers"]["ros__parameters"]
    rows: list[Row] = [(0, f"/{given['path']}", "")]
    for analyzer in (a for a in given.values() if isinstance(a, dict)):
        rules = analyzer["regex"]
        taken = {n: s for n, s in found.items() if any(re.fullmatch(r, n) for r in rules)}
        worst = max((s.level for s in taken.values()), default=None)
        rows.append((1, analyzer["path"], LEVELS[worst] if taken else "nothing heard"))
        rows += [(2, n, f"{LEVELS[s.level]}: {s.message}") for n, s in sorted(taken.items())]
    return rows


def main() -> None:
    """Draw it."""
    isolate()
    title = "/diagnostics of the demo's nodes, grouped by the rules of config/diagnostics.yaml"
    draw("aggregator", title, grouped(run()))


if __name__ == "__main__":
    main()
