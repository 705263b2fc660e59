# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Rules of the house that no tool checks: who may import whom, headers, public names, output."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "valve_twin"
HEADER = ("# SPDX-License-Identifier: Apache-2.0", "# Copyright 2026 valve_twin maintainers")
SOURCE_FOLDERS = ("config", "launch", "msg_defs", "test", "tools", "valve_twin")
SOURCE_SUFFIXES = {".py", ".pyi", ".sh", ".yaml", ".yml", ".toml"}
SOURCE_FILES = ("Makefile", ".ci/run", "tools/run", "tools/check", "tools/valve-twin", "setup.py")

ROS = {"rclpy", "launch", "launch_ros", "rosidl_runtime_py", "ament_index_python"}
FILES_AND_CLOCKS = {
    "alembic",
    "datetime",
    "glob",
    "io",
    "logging",
    "lz4",
    "matplotlib",
    "mcap",
    "multiprocessing",
    "os",
    "pathlib",
    "psycopg",
    "random",
    "rich",
    "rosbags",
    "shutil",
    "socket",
    "sqlalchemy",
    "sqlite3",
    "subprocess",
    "tempfile",
    "threading",
    "time",
    "yaml",
    "zstandard",
}
COMMAND_ROOMS = ("cli", "bench", "demo", "warmup")
ABOVE_CORE = {f"valve_twin.{room}" for room in ("io", "report", "nodes", *COMMAND_ROOMS)}
ABOVE_IO = {f"valve_twin.{room}" for room in ("nodes", *COMMAND_ROOMS)}
FORBIDDEN = {
    "core": ROS | FILES_AND_CLOCKS | ABOVE_CORE,
    "io": ROS | ABOVE_IO,
    "report": ROS | ABOVE_IO,
    "nodes": {"valve_twin.cli", "valve_twin.bench", "valve_twin.demo"},
}
LAZY = {"cvxpy"}  # seconds to import: only inside the function that uses it
SEEDED = {"BitGenerator", "Generator", "PCG64", "Philox", "SeedSequence", "default_rng"}
OUTPUT_AND_EXIT = {"print", "sys.exit", "exit", "quit"}
COMMANDS = {"__main__.py", "warmup.py", "executables.py"}


def python_files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*.py") if "__pycache__" not in path.parts)


def parse(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


def place(path: Path, node: ast.AST) -> str:
    return f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 1)}"


def imported_modules(path: Path, tree: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """Yield every import of a file, at any depth, as absolute dotted names."""
    package = path.relative_to(ROOT).with_suffix("").parts[:-1]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(part for part in (base, node.module) if part)
            yield node, module
            yield from ((node, f"{module}.{alias.name}") for alias in node.names)


def is_within(module: str, names: set[str]) -> bool:
    parts = module.split(".")
    return any(".".join(parts[:depth]) in names for depth in range(1, len(parts) + 1))


@pytest.mark.parametrize("room", sorted(FORBIDDEN))
def test_dependencies_point_one_way(room: str) -> None:
    messages_allowed = room == "nodes"
    offences = {
        f"{place(path, node)} imports {module}"
        for path in python_files(PACKAGE / room)
        for node, module in imported_modules(path, parse(path))
        if is_within(module, FORBIDDEN[room])
        or (not messages_allowed and module.split(".")[0].endswith(("_msgs", "_interfaces")))
    }
    assert not offences, "\n".join(sorted(offences))


def test_the_check_of_imports_sees_every_form(tmp_path: Path) -> None:
    source = (
        "import mcap.reader\nfrom valve_twin import io\nfrom ..nodes import twin\n"
        "def late():\n    from sqlalchemy import create_engine\n"
    )
    path = PACKAGE / "core" / "example.py"
    found = {module for _, module in imported_modules(path, ast.parse(source))}
    assert {m for m in found if is_within(m, FORBIDDEN["core"])} == {
        "mcap.reader",
        "sqlalchemy",
        "sqlalchemy.create_engine",
        "valve_twin.io",
        "valve_twin.nodes",
        "valve_twin.nodes.twin.node",
    }


def test_the_value_types_import_nothing_of_ours() -> None:
    path = PACKAGE / "core" / "types.py"
    ours = [module for _, module in imported_modules(path, parse(path)) if "valve_twin" in module]
    assert ours == []


def test_slow_packages_are_imported_where_they_are_used() -> None:
    offences = [
        place(path, node)
        for path in python_files(PACKAGE)
        for node, module in imported_modules(path, ast.Module(parse(path).body, []))
        if is_within(module, LAZY) and getattr(node, "col_offset", 0) == 0
    ]
    assert not offences, "\n".join(offences)


def test_the_core_opens_no_file_and_draws_no_unseeded_number() -> None:
    offences = []
    for path in python_files(PACKAGE / "core"):
        for node in ast.walk(parse(path)):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "open":
                offences.append(f"{place(path, node)} opens a file")
            if isinstance(node, ast.Attribute) and ast.unparse(node.value) in {
                "np.random",
                "numpy.random",
            }:
                if node.attr not in SEEDED:
                    offences.append(f"{place(path, node)} uses the global np.random.{node.attr}")
                elif node.attr == "default_rng" and is_called_without_seed(path, node):
                    offences.append(f"{place(path, node)} seeds from the operating system")
    assert not offences, "\n".join(offences)


def is_called_without_seed(path: Path, function: ast.Attribute) -> bool:
    return any(
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and (node.func.lineno, node.func.col_offset) == (function.lineno, function.col_offset)
        and not node.args
        and not node.keywords
        for node in ast.walk(parse(path))
    )


def test_nothing_below_the_commands_prints_or_exits() -> None:
    offences = []
    for path in python_files(PACKAGE):
        if PACKAGE / "cli" in path.parents or path.name in COMMANDS:
            continue
        for node in ast.walk(parse(path)):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in OUTPUT_AND_EXIT:
                offences.append(f"{place(path, node)} calls {ast.unparse(node.func)}")
            if isinstance(node, ast.Raise) and "SystemExit" in ast.unparse(node):
                offences.append(f"{place(path, node)} raises SystemExit")
    assert not offences, "\n".join(offences)


def source_files() -> list[Path]:
    found = {
        path
        for folder in SOURCE_FOLDERS
        for path in (ROOT / folder).rglob("*")
        if path.suffix in SOURCE_SUFFIXES and "__pycache__" not in path.parts
    }
    top = {path for path in ROOT.iterdir() if path.is_file() and path.suffix in SOURCE_SUFFIXES}
    return sorted(found | top | {ROOT / name for name in SOURCE_FILES})


def test_every_source_file_starts_with_its_licence() -> None:
    offences = []
    for path in source_files():
        lines = path.read_text(encoding="utf-8").splitlines()
        if lines and lines[0].startswith("#!"):
            del lines[0]
        if tuple(lines[:2]) != HEADER:
            offences.append(str(path.relative_to(ROOT)))
    assert not offences, "without the two lines of the licence:\n" + "\n".join(offences)


def public_packages() -> list[str]:
    found = []
    for path in python_files(PACKAGE):
        if path.name != "__init__.py":
            continue
        if any(isinstance(node, (ast.Import, ast.ImportFrom)) for node in parse(path).body):
            found.append(".".join(path.parent.relative_to(ROOT).parts))
    return found


@pytest.mark.parametrize("package", public_packages())
def test_a_package_that_exports_names_lists_them_sorted_and_all(package: str) -> None:
    if package.startswith("valve_twin.nodes"):
        pytest.importorskip("rclpy", reason="the nodes need ROS 2")
    module = importlib.import_module(package)
    path = ROOT.joinpath(*package.split("."), "__init__.py")
    bound = {
        alias.asname or alias.name
        for node in parse(path).body
        if isinstance(node, ast.ImportFrom) and node.module != "__future__"
        for alias in node.names
    }
    exported = list(getattr(module, "__all__", ()))
    assert exported == sorted(set(exported)), f"{package}.__all__ is not sorted"
    assert {name for name in bound if not name.startswith("_")} <= set(exported)
    assert all(hasattr(module, name) for name in exported)


def test_every_package_says_what_it_is_for() -> None:
    offences = [
        str(path.relative_to(ROOT))
        for path in python_files(PACKAGE)
        if not ast.get_docstring(parse(path))
    ]
    assert not offences, "\n".join(offences)
    folders = {path.parent for path in python_files(PACKAGE)}
    missing = sorted(str(f) for f in folders if not (f / "__init__.py").is_file())
    assert not missing, "without __init__.py, so not installed: " + ", ".join(missing)
