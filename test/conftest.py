# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What every test shares: deterministic properties and the marker of the tests that need ROS 2."""

import fcntl
import gc
import hashlib
import os
import pickle
from collections.abc import Callable, Generator
from importlib import import_module
from pathlib import Path
from typing import Any

import hypothesis
import pytest

gc.disable()  # until all tests are collected: imports make hardly any garbage
ROOT = Path(__file__).resolve().parent.parent
NODES = ROOT / "test" / "nodes"
LIVE = (NODES, *(ROOT / "test" / name for name in ("demo", "bench", "test_packaging.py")))
"""Where tools/check looks for tests marked `ros` or `alone`."""
LENGTHY = {
    ROOT / "test" / f"{name}.py": place
    for place, name in enumerate(
        (
            *("core/diagnosis/generic/test_campaign", "io/configure/test_survey"),
            *("core/valves/test_check", "core/aging/test_coverage"),
            *("core/diagnosis/watch/test_memory", "core/diagnosis/generic/test_signatures"),
            *("core/valves/double_solenoid/dimensions/test_estimate", "core/aging/test_campaign"),
            *("core/valves/stepper_servo/test_model", "io/configure/test_made"),
            *("io/configure/test_proposal", "core/valves/servo_system/test_model"),
            # those that wait for others stand between those that compute
            *("gateway/opcua/test_server", "test_design_page", "cli/design/test_export"),
            *("gateway/mqtt/test_face", "validation/test_solenoid", "design/test_chain"),
            *("gateway/test_browser", "validation/strangers/test_campaign", "cli/test_main"),
            *("io/batch/test_archive", "test_real_valves_pilot", "cli/test_strangers"),
            *("gateway/fmu/test_export", "test_readme", "io/history/tiers/test_condense"),
            *("gateway/foxglove/test_face", "io/instruments/test_read", "io/test_limits"),
            *("io/history/test_claim", "test_real_valves", "io/history/test_restart"),
            *("gateway/test_web", "io/fmu/test_plant", "io/history/test_history_processes"),
            *("nodes/test_soak", "nodes/test_kill", "nodes/gateway/test_node"),
            *("nodes/twin/test_node", "nodes/test_rough_inputs", "nodes/test_opcua_chain"),
            "demo/test_demo",
            *("nodes/test_history_trouble", "nodes/test_live", "nodes/runtime/test_node"),
            *("nodes/twin/history/test_upkeep", "nodes/test_real_valves_live"),
            *("nodes/test_live_actuator", "nodes/test_history_server"),
            *("nodes/twin/test_estimate_wait", "nodes/test_same_bits"),
        )
    )
}
"""Modules of half a minute and more, about the longest of each step of tools/check first: begun
before all others, for behind one that comes late the other processes have nothing to do. `colcon
test`, which has one process, leaves them out."""

hypothesis.settings.register_profile(
    "deterministic",
    derandomize=True,  # the same examples on every machine: a failure is repeated by running again
    database=None,
    deadline=None,  # the first call of a kernel may load it from the cache
    max_examples=50,
)
hypothesis.settings.load_profile("deterministic")


CPU = "cpu_s"
"""Name of what a report says of the CPU of its test or fixture, ended children included [s]."""
SINCE = pytest.StashKey[float]()
PACKAGE = "valve_twin"
"""What colcon calls its results."""
SHORT = pytest.StashKey[bool]()
"""Whether what takes long is left out."""


def pytest_addoption(parser: pytest.Parser) -> None:
    told = "tell the N tests and fixtures that took the most CPU, their ended children included"
    parser.addoption("--slowest", type=int, default=0, metavar="N", help=told)


def used_s() -> float:
    """Return the CPU of this process and its ended children [s]."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def pytest_report_header() -> str:
    return "random numbers: fixed seeds, named in each test; hypothesis profile: deterministic"


def pytest_configure(config: pytest.Config) -> None:
    """Leave to who asks for them the campaigns and, under `colcon test`, all that takes long."""
    if not config.option.markexpr and not config.option.keyword and not _names_tests(config):
        whole = config.args_source is not pytest.Config.ArgsSource.ARGS
        by_colcon = whole and config.option.junitprefix == PACKAGE
        config.option.markexpr = "not slow and not alone" if by_colcon else "not slow"
        config.stash[SHORT] = by_colcon


def _names_tests(config: pytest.Config) -> bool:
    return any("::" in argument for argument in config.args)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    for item in items:
        if NODES in item.path.parents:
            item.add_marker(pytest.mark.ros)
        marks = {mark.name for mark in item.iter_markers()}
        if marks & {"ros", "alone"} and not {item.path, *item.path.parents} & set(LIVE):
            msg = f"{item.nodeid}: tools/check does not look for tests marked ros or alone here"
            raise pytest.UsageError(msg)
    if config.stash.get(SHORT, False):
        config.hook.pytest_deselected(items=[item for item in items if item.path in LENGTHY])
        items[:] = [item for item in items if item.path not in LENGTHY]
    items.sort(key=lambda item: LENGTHY.get(item.path, len(LENGTHY)))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    try:
        return (yield)
    finally:
        gc.freeze()  # what imports made stays: looking through it again and again takes seconds
        gc.enable()


def cpu_s_of(report: pytest.TestReport) -> float:
    found = dict(report.user_properties).get(CPU)
    return found if isinstance(found, float) else 0.0


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    item.stash[SINCE] = used_s()
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Say in the report of a setup, call or teardown what CPU it took."""
    report = yield
    now = used_s()
    report.user_properties.append((CPU, now - item.stash[SINCE]))
    item.stash[SINCE] = now
    return report


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    reports = [r for found in terminalreporter.stats.values() for r in found]
    tests = [r for r in reports if isinstance(r, pytest.TestReport)]
    most = sorted(tests, key=cpu_s_of, reverse=True)[: config.getoption("--slowest")]
    if most:
        terminalreporter.section("most CPU, and elapsed [s]")
    for r in most:
        told = f"{cpu_s_of(r):8.2f} {r.duration:8.2f} {r.when:8} {r.nodeid}"
        terminalreporter.write_line(told)


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


def once(function: Callable[..., Any], folder: Path) -> Callable[..., Any]:
    """Return a function that computes what it was not yet asked for, in any process of this run.

    What it answers is kept by the bytes of all arguments: of equal ones only the first call
    computes, the others wait for it, and each gets a copy of its own.
    """

    def ask(*arguments: Any, **named: Any) -> Any:
        asked = pickle.dumps((function.__qualname__, arguments, sorted(named.items())))
        path = folder / hashlib.sha256(asked).hexdigest()
        with path.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # goes with its process
            if not path.exists():
                part = path.with_suffix(".part")
                part.write_bytes(pickle.dumps(function(*arguments, **named)))
                part.replace(path)
        return pickle.loads(path.read_bytes())

    return ask


@pytest.fixture(scope="session")
def shared_folder(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """Return a folder that all processes of this run have in common."""
    base = tmp_path_factory.getbasetemp()
    folder = (base if worker_id == "master" else base.parent) / "shared"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture
def transients_once(shared_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compute each transient field of a solenoid once a run: 4 s of CPU for the same numbers."""
    from valve_twin.design import chain
    from valve_twin.design.dynamics import eddies
    from valve_twin.design.field import run_transient

    replay = import_module("valve_twin.design.dynamics.replay")  # its function has the same name
    for module in (chain, eddies, replay):
        monkeypatch.setattr(module, "run_transient", once(run_transient, shared_folder))


@pytest.fixture(scope="module")
def maps_once(shared_folder: Path) -> Generator[None]:
    """Compute each map of fields once a run: those of worn sections take 4 s of CPU."""
    from valve_twin.design import chain, doubt, map, wear

    compute_map = map.compute_map

    def counted(section: Any, grid: Any) -> tuple[Any, int]:
        fields: list[int] = []
        return compute_map(section, grid, lambda: fields.append(1)), len(fields)

    shared = once(counted, shared_folder)

    def ask(section: Any, grid: Any = None, advance: Callable[[], None] = lambda: None) -> Any:
        found, fields = shared(section, grid)
        for _ in range(fields):
            advance()
        return found

    with pytest.MonkeyPatch.context() as patch:
        for module in (chain, doubt, map, wear):
            patch.setattr(module, "compute_map", ask)
        yield


@pytest.fixture(scope="session")
def root() -> Path:
    """Return the root of the repository."""
    return ROOT


@pytest.fixture(scope="session")
def measured() -> Path:
    """Return the folder of the measured records whose licence lets them stand in here."""
    return ROOT / "samples" / "measured"
