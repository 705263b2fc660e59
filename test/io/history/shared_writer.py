# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A process of its own that claims a valve and stores its cycles, one line on stdout for each."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.core.state import Announced
from valve_twin.io.errors import StoreError
from valve_twin.io.history.store import History

if TYPE_CHECKING:
    from types import ModuleType


def neighbour(name: str) -> ModuleType:
    """Load a module of this folder by its file: a process of its own knows no test package."""
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main(path: str, valve: str, first: int, count: int) -> None:
    history_test = neighbour("test_store")
    try:
        with History(path) as history:
            claim = history.claim(valve)
            sys.stdout.write("claimed\n")
            sys.stdout.flush()
            sys.stdin.readline()
            for number in range(first, first + count):
                cycle = history_test.record(number)
                claim.announce(Announced(number, cycle.start_ns))
                history.store(valve, cycle, history_test.both(number))
                sys.stdout.write(f"{number}\n")
                sys.stdout.flush()
            sys.stdin.readline()
    except StoreError as err:
        sys.stdout.write(f"refused: {err}\n")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
