# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What every test shares: deterministic properties and the marker of the tests that need ROS 2."""

from collections.abc import Generator
from pathlib import Path

import hypothesis
import pytest

ROOT = Path(__file__).resolve().parent.parent
NODES = ROOT / "test" / "nodes"
LIVE = (NODES, *(ROOT / "test" / name for name in ("demo", "bench", "test_packaging.py")))
"""Where tools/check looks for tests marked `ros` or `alone`."""
LENGTHY = tuple(NODES / f"{name}.py" for name in ("test_soak", "test_kill", "gateway/test_node"))
"""Modules of minutes and few tests: begun first, for behind them the last process works alone."""

hypothesis.settings.register_profile(
    "deterministic",
    derandomize=True,  # the same examples on every machine: a failure is repeated by running again
    database=None,
    deadline=None,  # the first call of a kernel may load it from the cache
    max_examples=50,
)
hypothesis.settings.load_profile("deterministic")


def pytest_report_header() -> str:
    return "random numbers: fixed seeds, named in each test; hypothesis profile: deterministic"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if NODES in item.path.parents:
            item.add_marker(pytest.mark.ros)
        marks = {mark.name for mark in item.iter_markers()}
        if marks & {"ros", "alone"} and not {item.path, *item.path.parents} & set(LIVE):
            msg = f"{item.nodeid}: tools/check does not look for tests marked ros or alone here"
            raise pytest.UsageError(msg)
    items.sort(key=lambda item: item.path not in LENGTHY)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None]:
    """Do not trace what is set up for a test that is not traced: pytest-cov stops for its call."""
    tracing = getattr(item.config.pluginmanager.getplugin("_cov"), "cov_controller", None)
    if tracing is None or item.get_closest_marker("no_cover") is None:
        return (yield)
    tracing.pause()
    try:
        return (yield)
    finally:
        tracing.resume()


@pytest.fixture(scope="session")
def root() -> Path:
    """Return the root of the repository."""
    return ROOT


@pytest.fixture(scope="session")
def measured() -> Path:
    """Return the folder of the measured records whose licence lets them stand in here."""
    return ROOT / "samples" / "measured"
