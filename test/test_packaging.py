# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Packages as colcon, ros2 run and ros2 launch see them."""

from __future__ import annotations

import ast
import configparser
import importlib
import os
import re
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest
from catkin_pkg.package import parse_package

import valve_twin

ROOT = Path(__file__).resolve().parent.parent
INSTALLED = ROOT / "install" / "valve_twin"
EXECUTABLES = {"aging_monitor", "bag_player", "bag_recorder", "simulated_valve", "twin"}
LAUNCH_FILES = sorted((ROOT / "launch").glob("*.launch.py"))
COMMON_ARGUMENTS = {"autostart", "log_level", "namespace", "params_file", "use_sim_time"}
ROS_MODULES = (
    "rclpy",
    "builtin_interfaces.msg",
    "diagnostic_msgs.msg",
    "lifecycle_msgs.msg",
    "rcl_interfaces.msg",
    "rosgraph_msgs.msg",
    "std_msgs.msg",
    "valve_twin_msgs.msg",
    "valve_twin_msgs.srv",
)
IMPORT_NAMES = {"pyyaml": "yaml"}


def test_colcon_sees_both_packages_with_their_types() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "colcon", "list"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    listed = {tuple(line.split("\t")) for line in done.stdout.splitlines()}
    assert listed == {
        ("valve_twin", ".", "(ros.ament_python)"),
        ("valve_twin_msgs", "msg_defs", "(ros.ament_cmake)"),
    }


@pytest.mark.parametrize("folder", [".", "msg_defs"])
def test_the_package_description_is_valid(folder: str) -> None:
    warnings: list[str] = []
    package = parse_package(str(ROOT / folder), warnings=warnings)
    package.validate(warnings=warnings)
    assert warnings == []
    assert package.package_format == 3
    assert package.licenses == ["Apache-2.0"]


def test_all_places_name_one_version() -> None:
    versions = {parse_package(str(ROOT / folder)).version for folder in (".", "msg_defs")}
    (from_setup,) = re.findall(r'version="([^"]+)"', (ROOT / "setup.py").read_text())
    assert versions == {from_setup} == {valve_twin.__version__}


def test_scripts_go_where_ros2_run_looks() -> None:
    config = configparser.ConfigParser()
    config.read(ROOT / "setup.cfg")
    assert config["develop"]["script_dir"] == "$base/lib/valve_twin"
    assert config["install"]["install_scripts"] == "$base/lib/valve_twin"


def test_colcon_test_finds_pytest() -> None:
    required = metadata.requires("valve_twin") or []
    assert any(re.match(r"pytest\b(?!-)", line) and "extra" in line for line in required)


@pytest.mark.ros
def test_every_executable_is_installed_and_leads_to_a_function() -> None:
    registered = metadata.distribution("valve_twin").entry_points
    points = {p.name: p for p in registered.select(group="console_scripts")}
    assert set(points) == EXECUTABLES | {"valve-twin"}
    for name, point in points.items():
        assert os.access(INSTALLED / "lib" / "valve_twin" / name, os.X_OK)
        assert callable(point.load()), name


@pytest.mark.ros
def test_the_installed_executables_python_imports_every_required_package() -> None:
    scripts = [INSTALLED / "lib" / "valve_twin" / name for name in EXECUTABLES | {"valve-twin"}]
    first_lines = [script.read_text().splitlines()[0] for script in scripts]
    interpreters = {line.removeprefix("#!").split()[-1] for line in first_lines}  # after env
    (interpreter,) = interpreters
    lines = [line for line in metadata.requires("valve_twin") or [] if "extra" not in line]
    required = [re.match(r"[\w-]+", line) for line in lines]
    names = [match.group().lower() for match in required if match]
    modules = [*ROS_MODULES, *(IMPORT_NAMES.get(name, name) for name in names)]
    done = subprocess.run(
        [interpreter, "-c", "import " + ", ".join(modules)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert len(names) >= 10


@pytest.mark.ros
def test_the_command_is_on_the_path_of_an_installed_workspace() -> None:
    found = shutil.which("valve-twin")
    assert found is not None
    assert Path(found) == INSTALLED / "bin" / "valve-twin"
    done = subprocess.run([found, "--help"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "estimate" in done.stdout


@pytest.mark.ros
@pytest.mark.parametrize("folder", ["launch", "config", "layouts"])
def test_what_users_read_is_installed_in_share(folder: str) -> None:
    source = {
        p.name for p in (ROOT / folder).glob("*") if p.suffix in {".py", ".yaml", ".xml", ".json"}
    }
    installed = {p.name for p in (INSTALLED / "share" / "valve_twin" / folder).glob("*")}
    assert source
    assert source <= installed


def arguments_of(path: Path) -> dict[str, dict[str, ast.expr]]:
    """Return the keywords of every argument that a launch file declares."""
    found = {}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), filename=str(path))):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "DeclareLaunchArgument":
            name = ast.literal_eval(node.args[0])
            found[name] = {str(keyword.arg): keyword.value for keyword in node.keywords}
    return found


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_every_launch_argument_is_described_and_bounded(path: Path) -> None:
    arguments = arguments_of(path)
    assert set(arguments) >= COMMON_ARGUMENTS
    for name, keywords in arguments.items():
        assert {"default_value", "description"} <= set(keywords), name
        default = keywords["default_value"]
        if isinstance(default, ast.Constant) and default.value in {"true", "false"}:
            assert ast.literal_eval(keywords["choices"]) == ["true", "false"], name
    assert "choices" in arguments["log_level"]


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_a_launch_file_uses_every_argument_and_only_declared_ones(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    used = {
        ast.literal_eval(node.args[0])
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and ast.unparse(node.func) == "LaunchConfiguration"
        and isinstance(node.args[0], ast.Constant)
    }
    declared = set(arguments_of(path))
    assert used <= declared
    named = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    assert declared <= named


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_a_launch_file_names_files_and_executables_that_exist(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "PathJoinSubstitution":
            (parts,) = (argument for argument in node.args if isinstance(argument, ast.List))
            package, *inside = parts.elts
            assert ast.unparse(package) == "FindPackageShare('valve_twin')"
            assert ROOT.joinpath(*(ast.literal_eval(part) for part in inside)).is_file()
    executables = {
        keyword.value.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "Node"
        for keyword in node.keywords
        if keyword.arg == "executable" and isinstance(keyword.value, ast.Constant)
    }
    assert executables <= EXECUTABLES


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_a_launch_file_sets_only_parameters_that_its_nodes_declare(path: Path) -> None:
    known = {"use_sim_time", "topic_prefix"}
    for specs in importlib.import_module(
        "valve_twin.io.config.node_parameters"
    ).NODE_PARAMETERS.values():
        known |= {spec.name for spec in specs}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.keyword) and node.arg == "parameters":
            for table in (n for n in ast.walk(node.value) if isinstance(n, ast.Dict)):
                assert {ast.literal_eval(key) for key in table.keys if key} <= known


@pytest.mark.parametrize(
    "path",
    sorted((ROOT / "msg_defs").glob("[ms][sr][gv]/*.*")),
    ids=lambda path: path.name,
)
def test_every_field_of_a_message_is_explained(path: Path) -> None:
    for line in path.read_text(encoding="utf-8").splitlines():
        if line and not line.startswith(("#", "---")):
            assert "#" in line, f"{path.name}: {line}"
