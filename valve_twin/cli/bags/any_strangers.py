# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin campaign --strangers any`: valves of another hand, configured and then watched."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.cli.output import plain
from valve_twin.core.survey.trial import Mapping01
from valve_twin.core.valves.registry import get_model
from valve_twin.io.config.valve import load_config
from valve_twin.io.configure.channels import look
from valve_twin.io.configure.proposal import yaml_text
from valve_twin.io.configure.survey import choose
from valve_twin.io.instruments.clock import ClockChoice
from valve_twin.io.offline.make_twin import twin_config
from valve_twin.io.whole import write_whole
from valve_twin.validation.any_strangers.record import record
from valve_twin.validation.any_strangers.watch import Setup

if TYPE_CHECKING:
    from valve_twin.validation.any_strangers.campaign import Met
    from valve_twin.validation.any_strangers.draw import Stranger
    from valve_twin.validation.any_strangers.watch import Told

_SHOWN = 4
"""Production cycles of the record that `configure` looks at, before those that are watched."""


def configured(stranger: Stranger) -> Setup:
    """Return what `configure` proposes for an earlier record of a stranger.

    Parameters
    ----------
    stranger : Stranger
        Which.

    Raises
    ------
    BagError
        If it proposes nothing.
    """
    parts = record(stranger, _SHOWN, number=1)
    stamps = np.concatenate([p.stamp_ns for p in parts])
    seconds = (stamps - parts[0].start_ns) * 1e-9
    command = np.concatenate([p.command for p in parts])
    position = np.concatenate([p.position for p in parts])
    with TemporaryDirectory(prefix="valve_twin_") as folder:
        path = Path(folder, "record.csv")
        rows = np.column_stack((seconds, command, position))
        header = "time [s],command,position"
        np.savetxt(path, rows, "%.9g", delimiter=",", header=header, comments="")
        survey, choice = choose(look([path], ClockChoice()))
        written = Path(folder, "valve.yaml")
        write_whole(written, yaml_text(survey, choice, [str(path)]))
        config = load_config(written)[0]
    model = get_model(config.model)
    maps = {k: Mapping01(s.scale, s.offset) for k, s in config.signals.items()}
    answer = maps.pop(model.output)
    return Setup(model, twin_config(config, model), maps, answer)


def described(met: Met) -> dict[str, object]:
    """Return what was told of a stranger as plain data."""
    return {
        "seed": met.stranger.seed,
        "kind": met.stranger.kind,
        "model": met.model,
        "records": [_told(t) for t in met.told],
    }


def _told(told: Told) -> dict[str, object]:
    """Return what was told of a record."""
    trouble = None if told.trouble is None else plain(asdict(told.trouble))
    findings = [
        {"alarm": f.alarm, "fault": f.fault, "at_once": once.fault if once else ""}
        for f, once in zip(told.findings, told.at_once, strict=True)
    ]
    return {"trouble": trouble, "cycles": len(told.cycles), "findings": findings}
