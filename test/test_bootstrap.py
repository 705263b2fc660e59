# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Set-up: what it refuses, what it patches, what it redoes, what the lock files promise."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import time
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

ROOT = Path(__file__).resolve().parent.parent
BOOTSTRAP = ROOT / "tools" / "bootstrap.py"
LOCKS = ("requirements.lock", "requirements-ros.lock", "requirements-ros-kilted.lock")
INPUTS = (*LOCKS, "setup.py", "setup.cfg", "package.xml")


@pytest.fixture
def step(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], Any]]:
    """Import a module of the set-up, which lives outside the package."""
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    yield lambda name: importlib.import_module(f"setup_steps.{name}")
    for name in [name for name in sys.modules if name.partition(".")[0] == "setup_steps"]:
        del sys.modules[name]


@pytest.mark.parametrize("version", [(3, 9, 18), (3, 14, 0)])
def test_refuses_another_python_in_one_line(version: tuple[int, int, int]) -> None:
    code = (
        "import runpy, sys\n"
        f"sys.version_info = {version}\n"
        f"runpy.run_path({str(BOOTSTRAP)!r}, run_name='__main__')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert f"Python {version[0]}.{version[1]}" in line
    assert "3.10 to 3.13" in line
    assert "PYTHON=" in line


def test_uses_nothing_but_the_standard_library() -> None:
    allowed = sys.stdlib_module_names | {"setup_steps"}
    for path in [BOOTSTRAP, *(ROOT / "tools" / "setup_steps").glob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
            assert {name.partition(".")[0] for name in names} <= allowed, path


def test_names_the_missing_compiler(
    step: Callable[[str], Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CXX", raising=False)
    assert "g++" in step("system").missing_system_packages()


def test_names_the_command_where_it_may_not_install(
    step: Callable[[str], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    system = step("system")
    monkeypatch.setattr(system.shutil, "which", lambda name: f"/usr/bin/{name}")
    monkeypatch.setattr(system, "_as_root", lambda: None)
    with pytest.raises(step("console").SetupError) as caught:
        system.install_system_packages(["g++", "python3.12-venv"])
    assert "sudo apt-get install g++ python3.12-venv" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_names_the_packages_where_there_is_no_apt(
    step: Callable[[str], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    system = step("system")
    monkeypatch.setattr(system.shutil, "which", lambda _: None)
    with pytest.raises(step("console").SetupError, match=r"g\+\+ \(names in Debian\)"):
        system.install_system_packages(["g++"])


def test_refuses_a_sourced_ros_of_another_python(
    step: Callable[[str], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    prefix = step("prefix")
    failed: subprocess.CompletedProcess[str] = subprocess.CompletedProcess([], 1)
    monkeypatch.setattr(prefix.subprocess, "run", lambda *_args, **_kwargs: failed)
    with pytest.raises(step("console").SetupError, match=r"ROS 2 jazzy is sourced, but .* rclpy"):
        prefix.refuse_what_cannot_work("jazzy")


def test_refuses_a_machine_without_wheels(
    step: Callable[[str], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    prefix = step("prefix")
    monkeypatch.setattr(prefix.platform, "machine", lambda: "aarch64")
    with pytest.raises(step("console").SetupError, match="aarch64: source an installed ROS 2"):
        prefix.refuse_what_cannot_work("")


def test_a_failed_command_shows_its_end_and_names_its_log(
    step: Callable[[str], Any],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    console = step("console")
    monkeypatch.setattr(console, "ROOT", tmp_path)
    monkeypatch.setattr(console, "LOG", tmp_path / "setup.log")
    with pytest.raises(console.SetupError, match=r"the step failed \(exit code 3\).*setup\.log"):
        console.run(["/bin/sh", "-c", "echo the cause; exit 3"], "the step", dict(os.environ))
    assert "the cause" in capsys.readouterr().err


def test_points_the_wheels_at_this_python(step: Callable[[str], Any], tmp_path: Path) -> None:
    folder = tmp_path / "share" / "std_msgs" / "cmake"
    folder.mkdir(parents=True)
    builder = "/opt/python/cp311-cp311"
    wheel = folder / "std_msgs__rosidl_generator_pyExport.cmake"
    wheel.write_text(
        f'"{builder}/include/python3.11;'
        f'{builder}/lib/python3.11/site-packages/numpy/_core/include"\n'
    )
    other = folder / "other.cmake"
    other.write_text("set(path /opt/python)\n")
    patch_wheels = step("prefix").patch_wheels

    assert patch_wheels(tmp_path) == 1
    version = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    numpy_headers = tmp_path / "lib" / version / "site-packages" / "numpy/_core/include"
    include, headers = wheel.read_text().strip().strip('"').split(";")
    assert Path(include, "Python.h").is_file()
    assert headers == str(numpy_headers)
    assert other.read_text() == "set(path /opt/python)\n"
    assert patch_wheels(tmp_path) == 0


def test_packages_are_found_by_a_python_with_another_scheme(
    step: Callable[[str], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = {"purelib": "{base}/local/lib/python3/dist-packages"}
    monkeypatch.setitem(sysconfig._INSTALL_SCHEMES, "posix_local", paths)  # type: ignore[attr-defined]
    monkeypatch.setattr(sysconfig, "get_default_scheme", lambda: "posix_local")
    found = step("prefix").site_packages(tmp_path)
    version = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    assert found == tmp_path / "lib" / version / "site-packages"


def copied_inputs(folder: Path) -> None:
    """Copy what the fingerprints look at into a folder."""
    for name in (*INPUTS, "colcon_defaults.yaml"):
        shutil.copy(ROOT / name, folder / name)
    for name in ("tools/setup_steps", "msg_defs", "launch", "resource"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("core", "io/cdr"):
        (folder / "valve_twin" / name).mkdir(parents=True)
        (folder / "valve_twin" / name / "kernel.py").write_text("x = 1\n")


def fingerprints_of(folder: Path, ros: str = "") -> dict[str, str]:
    code = (
        "import json; from setup_steps.inputs import fingerprints as f; print(json.dumps(f('')))"
    )
    environment = {**os.environ, "PYTHONPATH": str(folder / "tools"), "VALVE_TWIN_ROS": ros}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    found: dict[str, str] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize(
    ("changed", "redone"),
    [
        ("requirements.lock", {"packages", "kernels"}),
        ("requirements-ros.lock", {"packages", "messages"}),
        ("msg_defs/msg/Verdict.msg", {"messages"}),
        ("launch/new.launch.py", {"package"}),
        ("setup.py", {"package"}),
        ("valve_twin/core/kernel.py", {"kernels"}),
        ("valve_twin/io/cdr/kernel.py", {"kernels"}),
        ("valve_twin/__init__.py", set()),
    ],
)
def test_a_change_redoes_only_what_depends_on_it(
    tmp_path: Path, changed: str, redone: set[str]
) -> None:
    copied_inputs(tmp_path)
    before = fingerprints_of(tmp_path)
    with (tmp_path / changed).open("a", encoding="utf-8") as file:
        file.write("\n")
    after = fingerprints_of(tmp_path)
    assert {step for step in before if before[step] != after[step]} == redone


def test_kilted_has_pins_of_its_own_and_takes_the_rest_from_the_others(tmp_path: Path) -> None:
    copied_inputs(tmp_path)
    jazzy, kilted = fingerprints_of(tmp_path), fingerprints_of(tmp_path, "kilted")
    assert {step for step in jazzy if jazzy[step] != kilted[step]} == {"packages", "messages"}


def test_another_distribution_is_refused_in_one_line(
    step: Callable[[str], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    console, prefix = step("console"), step("prefix")
    monkeypatch.setattr(prefix, "WHEELS", "rolling")
    with pytest.raises(console.SetupError, match="ROS=rolling: there are wheels of jazzy and kil"):
        prefix.refuse_what_cannot_work("")
    monkeypatch.setattr(prefix, "WHEELS", "kilted")
    monkeypatch.setattr(prefix, "SUFFIX", "-kilted")
    with pytest.raises(console.SetupError, match="ROS 2 jazzy is sourced, ROS=kilted was asked"):
        prefix.refuse_what_cannot_work("jazzy")


def test_the_demo_compiles_one_valve_and_a_whole_set_up_adds_the_rest(
    step: Callable[[str], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    step("console")  # puts the folder of the set-up on the path
    bootstrap = importlib.import_module("bootstrap")
    monkeypatch.delitem(sys.modules, "bootstrap")
    done: list[str | None] = []
    monkeypatch.setattr(bootstrap, "compile_ahead", lambda _, demo: done.append(demo))
    state, wanted = {"kernels": "old"}, {"kernels": "new"}
    state |= bootstrap.compile_kernels(state, wanted, "", "")
    assert done == [""]
    assert bootstrap.compile_kernels(state, wanted, "", "") == {}
    state |= bootstrap.compile_kernels(state, wanted, "", "stepper_servo")
    state |= bootstrap.compile_kernels(state, wanted, "", None)
    assert done == ["", "stepper_servo", None]
    assert bootstrap.compile_kernels(state, wanted, "", "servo_system") == {}


def test_the_sources_are_translated_also_where_processes_may_not_do_it(
    step: Callable[[str], Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    workspace = step("workspace")
    (tmp_path / "valve_twin").mkdir()
    source = tmp_path / "valve_twin" / "module.py"
    source.write_text("VALUE = 1\n")
    monkeypatch.setattr(workspace, "ROOT", tmp_path)
    monkeypatch.setattr(workspace, "PYTHON", Path(sys.executable))
    workspace.translate_sources()
    assert Path(importlib.util.cache_from_source(str(source))).is_file()
    source.with_name("broken.py").write_text("VALUE = \n")
    with pytest.raises(workspace.SetupError, match=r"broken\.py"):
        workspace.translate_sources()


def test_a_second_call_does_nothing_and_is_quick(step: Callable[[str], Any]) -> None:
    inputs = step("inputs")
    distro = os.environ.get("ROS_DISTRO", "")
    if not inputs.fingerprints(distro).items() <= inputs.read_state().items():
        pytest.skip("this environment is not the one of make setup, or its inputs changed since")
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, BOOTSTRAP], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert time.perf_counter() - start < 2.0
    assert (done.returncode, done.stderr) == (0, "")
    (line,) = done.stdout.splitlines()
    assert line.startswith("setup: ready")


def test_run_without_an_environment_says_what_to_call(tmp_path: Path) -> None:
    (tmp_path / "tools").mkdir()
    shutil.copy(ROOT / "tools" / "run", tmp_path / "tools" / "run")
    command = [str(tmp_path / "tools" / "run"), "true"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "call make setup first" in done.stderr


def pins(lock: str) -> list[Requirement]:
    lines = (ROOT / lock).read_text(encoding="utf-8").splitlines()
    return [Requirement(line) for line in lines if line and not line.startswith("#")]


@pytest.mark.parametrize("lock", LOCKS)
def test_a_lock_pins_every_package_and_names_no_address(lock: str) -> None:
    text = (ROOT / lock).read_text(encoding="utf-8")
    assert not re.search(r"://|^\s*-|@|\bfile:|/", text, flags=re.MULTILINE)
    for pin in pins(lock):
        assert re.fullmatch(r"==[\w.!+]+", str(pin.specifier)), pin


def wanted(source: str) -> set[str]:
    lines = (ROOT / source).read_text(encoding="utf-8").splitlines()
    found = [Requirement(line) for line in lines if line and not line.startswith("#")]
    return {canonicalize_name(requirement.name) for requirement in found}


def described_requirements() -> set[str]:
    """Return what setup.py requires, extras included."""
    tree = ast.parse((ROOT / "setup.py").read_text(encoding="utf-8"))
    lists = {
        keyword.arg: ast.literal_eval(keyword.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        for keyword in node.keywords
        if keyword.arg in {"install_requires", "extras_require"}
    }
    extras = [name for names in lists["extras_require"].values() for name in names]
    return {canonicalize_name(Requirement(n).name) for n in [*lists["install_requires"], *extras]}


def test_the_lock_covers_what_the_package_requires() -> None:
    locked = {canonicalize_name(pin.name) for pin in pins("requirements.lock")}
    assert described_requirements() <= locked
    assert wanted("requirements.in") <= locked


@pytest.mark.parametrize("ros", ["requirements-ros", "requirements-ros-kilted"])
def test_a_ros_lock_covers_what_is_wanted_and_agrees_with_the_other(ros: str) -> None:
    ours = {str(pin) for pin in pins("requirements.lock")}
    names = {canonicalize_name(pin.name) for pin in pins("requirements.lock")}
    found = pins(f"{ros}.lock")
    assert wanted(f"{ros}.in") <= {canonicalize_name(pin.name) for pin in found}
    assert {str(pin) for pin in found if canonicalize_name(pin.name) in names} <= ours


def test_every_python_has_one_pin_a_package() -> None:
    for version in ("3.10", "3.11", "3.12", "3.13"):
        machine = {
            "python_version": version,
            "python_full_version": f"{version}.0",
            "sys_platform": "linux",
            "platform_machine": "x86_64",
        }
        for lock in LOCKS:
            active = [p.name for p in pins(lock) if p.marker is None or p.marker.evaluate(machine)]
            assert len(active) == len(set(active)), version


def test_the_environment_holds_what_the_lock_pins() -> None:
    state = ROOT / ".venv" / "valve_twin_setup.json"
    if not state.is_file() or Path(sys.prefix) != ROOT / ".venv":
        pytest.skip("this Python is not that of make setup")
    if os.environ.get("ROS_DISTRO"):
        pytest.skip("a sourced ROS 2 may put its own packages first")
    active = [p for p in pins("requirements.lock") if p.marker is None or p.marker.evaluate()]
    found = {pin.name: metadata.version(pin.name) for pin in active}
    assert found == {pin.name: str(pin.specifier).removeprefix("==") for pin in active}


@pytest.mark.parametrize(
    ("given", "asked", "taken"),
    [
        ("", "", ""),
        ("kilted", "", "kilted"),
        ("", "kilted", "kilted"),
        ("kilted", "jazzy", "jazzy"),
    ],
)
def test_make_takes_whose_wheels_from_its_call_or_the_environment(
    given: str, asked: str, taken: str
) -> None:
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    command = ["make", "-pn", "help"] + ([f"ROS={asked}"] if asked else [])
    environment = {**os.environ, "VALVE_TWIN_ROS": given}
    for name in ("MAKEFLAGS", "MAKEOVERRIDES"):  # of the make that runs the tests
        environment.pop(name, None)
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert re.search(r"^ROS :?= ?(.*)$", done.stdout, re.MULTILINE)[1] == taken  # type: ignore[index]


def test_a_container_is_built_from_no_built_environment() -> None:
    ignored = (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()
    kept_out = (ROOT / ".containerignore").read_text(encoding="utf-8").split()
    built = [name.strip("/") for name in ignored if re.match(r"/(\.venv|build|install)", name)]
    assert len(built) >= 3
    assert set(built) <= set(kept_out)
