# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The second part of the demo: a really measured boiler valve, replayed through the live nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.demo.cases import ROOT
from valve_twin.demo.processes import Processes, say, write_parameters

if TYPE_CHECKING:
    from pathlib import Path

BOILER_DATA = "damadics_boiler_valve/boiler_valve_first_half.csv"


def run_boiler(out: Path, data: Path) -> bool:
    """Import measured data, replay it through the live nodes, report; return whether all went."""
    from valve_twin.cli import main as valve_twin
    from valve_twin.demo.watch import watch

    config = ROOT / "config" / "boiler_valve.yaml"
    bag = out / "boiler_bag"
    if valve_twin(["import", str(data), "--config", str(config), "--out", str(bag)]) != 0:
        return False
    overrides = write_parameters(
        out / "boiler.yaml",
        {
            "topic_prefix": "/replay",
            "history_url": f"sqlite:///{out / 'boiler_history.sqlite'}",
            "rate": 300.0,
            "wait_for_subscribers": 1,
            "topics": ["/boiler_valve/command", "/boiler_valve/position"],
        },
    )
    say("a real valve: half an hour of a boiler's feed-water valve, replayed 300 times as fast")
    with Processes(out) as processes:
        processes.start("twin", "/", [config, overrides])
        processes.start("bag_player", "/", [config, overrides], ["-p", f"bag:={bag}"])
        seen = watch("/boiler_valve", 5, limit_s=60.0, alive=processes.alive)
    page = out / "boiler_report.html"
    code = valve_twin(["report", str(bag), "--config", str(config), "--out", str(page)])
    say(f"report page: {page}")
    return seen >= 5 and code == 0
