# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Bags and configurations for the tests of files."""

from collections.abc import Callable
from pathlib import Path

import pytest

from test.bag_samples import write_sample
from valve_twin.io.bags.read import BagWriter

START_NS = 1_577_836_800_000_000_000


@pytest.fixture(scope="session")
def shared(root):
    """Return the folder of measured data beside the repository."""
    folder = root.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"measured data is not there: {folder}")
    return folder


@pytest.fixture
def no_black_box(monkeypatch: pytest.MonkeyPatch) -> None:
    """Try the models of valves, and no black box beside them: half of the CPU of a choice."""
    from valve_twin.core.survey import sides
    from valve_twin.io.configure import survey

    for module in (survey, sides):
        monkeypatch.setattr(module, "try_baseline", lambda *_, **__: None)


@pytest.fixture
def small_bag(tmp_path: Path) -> Path:
    """Return a bag of 1000 commands and positions, 10 ms apart, the position 1 ms later."""
    path = tmp_path / "small"
    with BagWriter(path) as bag:
        bag.note({"valve": "/press/valve_1", "serial": 4711})
        for i in range(1000):
            stamp = START_NS + i * 10_000_000
            write_sample(bag, "/press/command", stamp, 0.5 * i)
            write_sample(bag, "/press/position", stamp + 1_000_000, -0.25 * i)
    return path


@pytest.fixture
def yaml_file(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes a parameter file from the lines below ros__parameters."""

    def write(text: str, name: str = "valve.yaml") -> Path:
        path = tmp_path / name
        body = "".join(f"    {line}\n" for line in text.splitlines())
        path.write_text(f"/**:\n  ros__parameters:\n{body}", encoding="utf-8")
        return path

    return write
