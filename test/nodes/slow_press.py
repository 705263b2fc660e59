# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A press valve whose estimation takes long, found by an entry point of its own.

It computes for two seconds; where the environment names a file, it waits for the seconds that
stand there, and not at all once the file is gone.
"""

from __future__ import annotations

import os
import shutil
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from valve_twin.core.valves.press_cartridge import MODEL as PRESS

NAME = "slow_press"
ESTIMATION_S = 2.0
PAUSE = "SLOW_PRESS_PAUSE"
"""Variable of the environment with the file."""
START_S = 1000.0
"""No stamp of a test lies before it, those of the worker's warm-up do [s]."""


class SlowPress:
    """The press valve, but slow."""

    name = NAME

    def __getattr__(self, name: str) -> Any:
        return getattr(PRESS, name)

    def estimate(self, cycle, options, earlier):
        """Estimate, then keep a core busy until two seconds are over, or wait."""
        begin = time.monotonic()
        estimates = PRESS.estimate(cycle, options, earlier)
        if path := os.environ.get(PAUSE):
            with suppress(FileNotFoundError):
                time.sleep(max(begin + float(Path(path).read_text()) - time.monotonic(), 0.0))
            return estimates
        while cycle.start_ns > START_S * 1e9 - 1 and time.monotonic() - begin < ESTIMATION_S:
            pass
        return estimates


MODEL = SlowPress()


def register(folder, monkeypatch) -> None:
    """Make the model known to the processes of a test, as an installed package would."""
    shutil.copy(__file__, folder)
    info = folder / "slow_press-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: slow_press\nVersion: 1\n")
    (info / "entry_points.txt").write_text(
        f"[valve_twin.valves]\n{NAME} = {Path(__file__).stem}:MODEL\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(folder), prepend=":")
