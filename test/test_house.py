# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Rules of the house that no tool checks: who may import whom, headers, public names, output."""

from __future__ import annotations

import ast
import importlib
import re
from collections import Counter
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import yaml

from valve_twin.core.simulation.faults import KINDS
from valve_twin.core.valves.registry import DEFAULT_MODEL, get_model, model_names

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

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
ABOVE_VALIDATION = {f"valve_twin.{room}" for room in ("io", "report", "nodes", *COMMAND_ROOMS)}
ABOVE_CORE = ABOVE_VALIDATION | {f"valve_twin.{r}" for r in ("design", "gateway", "validation")}
ABOVE_IO = {f"valve_twin.{room}" for room in ("design", "gateway", "nodes", *COMMAND_ROOMS)}
FORBIDDEN = {
    "core": ROS | FILES_AND_CLOCKS | ABOVE_CORE,
    "design": ROS | ABOVE_VALIDATION | {"valve_twin.validation"},
    "validation": ROS | FILES_AND_CLOCKS | ABOVE_VALIDATION,
    "io": ROS | ABOVE_IO,
    "report": ROS | ABOVE_IO,
    "gateway": ROS | (ABOVE_IO - {"valve_twin.gateway"}) | {"valve_twin.validation"},
    "nodes": {f"valve_twin.{room}" for room in ("design", "cli", "bench", "demo")},
}
LAZY = {
    "SALib",
    "cvxpy",
    "ezdxf",
    "fmpy",
    "prometheus_client",
    "pymoo",
    "skfem",
    "starlette",
    "uvicorn",
    "ziglang",
}  # slow, or of an extra: only inside the function that uses it
SEEDED = {"BitGenerator", "Generator", "PCG64", "Philox", "SeedSequence", "default_rng"}
OUTPUT_AND_EXIT = {"print", "sys.exit", "exit", "quit"}
COMMON_SIGNALS = {"command", "current", "position"}  # words of any valve
COMMANDS = {"__main__.py", "warmup.py", "executables.py"}

SINCE_3_11 = {
    "tomllib",
    *(f"asyncio.{n}" for n in ("Barrier", "Runner", "TaskGroup", "timeout", "timeout_at")),
    "contextlib.chdir",
    "datetime.UTC",
    *(f"enum.{n}" for n in ("EnumCheck", "ReprEnum", "StrEnum", "member", "nonmember", "verify")),
    "hashlib.file_digest",
    "inspect.getmembers_static",
    "itertools.batched",
    *(f"math.{n}" for n in ("cbrt", "exp2", "fma", "sumprod")),
    "operator.call",
    "types.get_original_bases",
    *(f"typing.{n}" for n in ("LiteralString", "Never", "NotRequired", "Required", "Self")),
    *(f"typing.{n}" for n in ("TypeVarTuple", "Unpack", "assert_never", "assert_type")),
    *(f"typing.{n}" for n in ("dataclass_transform", "override", "reveal_type")),
}
"""What Python 3.11 and 3.12 added to modules that are in use."""

MOST_MODULES, MOST_LINES, MOST_PARAMETERS = 15, 450, 10
"""Of a folder beside its `__init__`, of a module, and of a public function."""

PUBLIC = {"_asdict", "_exit", "_fields", "_make", "_replace"}  # documented, for all their names
PUBLIC |= {"_ArgumentGroup", "_typeshed"}  # for types alone
REACHING = {"compat/interpreter.py", "compat/opcua.py", "compat/ros.py", "kernels.py"}
"""Modules that say, entry by entry, what they take of others' private things, why and how long."""

EXCEPTIONS = yaml.safe_load((ROOT / "test" / "house.yaml").read_text(encoding="utf-8"))
"""What still breaks a rule, and may only become less."""


def python_files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*.py") if "__pycache__" not in path.parts)


@cache
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


def names_taken(path: Path, tree: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """Yield every import and every attribute of a file."""
    yield from imported_modules(path, tree)
    yield from ((n, ast.unparse(n)) for n in ast.walk(tree) if isinstance(n, ast.Attribute))


def is_within(module: str, names: set[str]) -> bool:
    parts = module.split(".")
    return any(".".join(parts[:depth]) in names for depth in range(1, len(parts) + 1))


def test_nothing_is_taken_that_the_oldest_python_lacks() -> None:
    """Python 3.10 is allowed; the environment of most is newer, and ruff knows syntax alone."""
    assert 'python_requires=">=3.10' in (ROOT / "setup.py").read_text(encoding="utf-8")
    words = {name.rpartition(".")[2] for name in SINCE_3_11}
    any_of_them = re.compile(rf"\b({'|'.join(sorted(words))})\b")
    offences = {
        f"{place(path, node)} takes {name}"
        for folder in (PACKAGE, ROOT / "test", ROOT / "tools", ROOT / "launch")
        for path in python_files(folder)
        if any_of_them.search(path.read_text(encoding="utf-8"))
        for node, name in names_taken(path, parse(path))
        if is_within(name, SINCE_3_11)
    }
    assert not offences, "\n".join(sorted(offences))


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
        "valve_twin.nodes.twin",
    }


def test_the_check_of_the_oldest_python_sees_every_form() -> None:
    path = PACKAGE / "core" / "example.py"
    source = "import datetime, tomllib\nfrom enum import StrEnum\nnow = datetime.UTC\n"
    found = {name for _, name in names_taken(path, ast.parse(source))}
    assert {n for n in found if is_within(n, SINCE_3_11)} == {
        "tomllib",
        "enum.StrEnum",
        "datetime.UTC",
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


def test_nothing_outside_its_own_folder_names_a_valve() -> None:
    # a valve is known to the house by its protocol alone; validation and bench are about ours
    names = model_names()
    known = re.compile(rf"\b({'|'.join(names)})\b")
    common = COMMON_SIGNALS.union(KINDS)
    parameters = {p.name: name for name in names for p in get_model(name).parameters if p.trend}
    signals = {s: n for n in names for s in (*get_model(n).inputs, get_model(n).output)}
    followed = {s: n for s, n in (signals | parameters).items() if s not in common}
    valves = PACKAGE / "core" / "valves"
    free = {PACKAGE / "validation", PACKAGE / "bench", *(valves / name for name in names)}
    offences = []
    for path in python_files(PACKAGE):
        if free & {path.with_suffix(""), *path.parents}:
            continue
        tree = parse(path)
        texts = [(n, m) for n, m in imported_modules(path, tree)]
        docstrings = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}
        texts += [
            (node, str(node.value))
            for node in ast.walk(tree)
            if isinstance(node, ast.Constant) and id(node) not in docstrings
        ]
        offences += [f"{place(path, n)} names {text}" for n, text in texts if known.search(text)]
        offences += [
            f"{place(path, n)} names {word}, of {followed[word]}"
            for n, text in texts
            for word in {text, *(w for w in text.split("|") if "_" in w)}  # others are plain words
            if word in followed
        ]
    default = f"names {DEFAULT_MODEL}"  # what a configuration means that names no model
    offences = [o for o in offences if not ("valves/registry.py" in o and o.endswith(default))]
    assert not offences, "\n".join(offences)


def private_names(tree: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """Yield what a file names of the private things of others: neither bound in it nor its own."""
    bound = {"self", "cls", "super()"}
    found: list[tuple[ast.AST, str]] = []
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            bound.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            bound.add(node.id)
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) in {"self", "cls"}:
            bound.add(node.attr)
        elif isinstance(node, ast.Attribute):
            found.append((node, node.attr))
        elif isinstance(node, ast.Call) and ast.unparse(node.func) in {"getattr", "setattr"}:
            found.append((node, str(getattr(node.args[1], "value", ""))))
        elif isinstance(node, (ast.Import, ast.ImportFrom)):
            module = getattr(node, "module", "") or ""
            if not module.startswith("valve_twin"):
                names = [module, *(a.name for a in node.names)]
                found += [(node, part) for name in names for part in name.split(".")]
    for node, name in found:
        if re.match("_[^_]", name) and name not in bound | PUBLIC:
            yield node, name


def test_only_compat_reaches_into_what_others_keep_private() -> None:
    offences = [
        f"{place(path, node)} takes {name}"
        for path in python_files(PACKAGE)
        if str(path.relative_to(PACKAGE)) not in REACHING
        for node, name in private_names(parse(path))
    ]
    assert not offences, "\n".join(offences)


def unread_attributes(trees: Iterable[ast.AST]) -> set[str]:
    """Return the private attributes that objects are given and that nothing reads."""
    given: set[str] = set()
    read: set[str] = set()
    for node in (n for tree in trees for n in ast.walk(tree)):
        if isinstance(node, ast.AugAssign) and isinstance(node.target, ast.Attribute):
            read.add(node.target.attr)
        elif isinstance(node, ast.Attribute):
            (given if isinstance(node.ctx, ast.Store) else read).add(node.attr)
    return {name for name in given - read if re.match("_[^_]", name)}


def test_no_class_gives_its_base_what_that_keeps_private() -> None:
    ours = [p for p in python_files(PACKAGE) if str(p.relative_to(PACKAGE)) not in REACHING]
    assert unread_attributes(map(parse, ours)) == set()
    source = "class E(F):\n    def g(self):\n        self._h = self._i\n        self._i = 1\n"
    assert unread_attributes([ast.parse(source)]) == {"_h"}


def test_the_search_for_private_things_finds_them() -> None:
    source = (
        "from a import _b\nimport c._d\n"
        "class E(F):\n    def g(self, other):\n        self._h = other._h\n"
        "        self._i()\n        other._j = getattr(other, '_k', other._replace(x=1))\n"
    )
    assert [name for _, name in private_names(ast.parse(source))] == ["_b", "_d", "_j", "_k"]


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


def imports_between_modules() -> dict[str, set[str]]:
    """Return by module what it imports of ours, at any depth and for types only as well."""
    paths = {module_name(path): path for path in python_files(PACKAGE)}
    found: dict[str, set[str]] = {}
    for name, path in paths.items():
        named = {m.removeprefix("valve_twin.") for _, m in imported_modules(path, parse(path))}
        within: dict[str, set[str]] = {}
        for module in named:
            within.setdefault(module.rpartition(".")[0], set()).add(module)
        packages = {n for n in named if n in within and within[n] <= set(paths)}  # `from n import`
        found[name] = named.intersection(paths) - packages - {name}
    return found


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def reached(graph: dict[str, set[str]], start: str) -> set[str]:
    found: set[str] = set()
    waiting = [start]
    while waiting:
        new = graph.get(waiting.pop(), set()) - found
        found |= new
        waiting += new
    return found


def circles(graph: dict[str, set[str]]) -> list[set[str]]:
    """Return the largest sets of modules that all reach each other."""
    far = {name: reached(graph, name) for name in graph}
    found = {
        frozenset({name} | {other for other in far[name] if name in far[other]})
        for name in graph
        if name in far[name]
    }
    return sorted(map(set, found), key=sorted)


def test_no_import_circle() -> None:
    known_circles = [set(circle) for circle in EXCEPTIONS["circles"]]
    found = circles(imports_between_modules())
    new = [sorted(c) for c in found if not any(c <= known for known in known_circles)]
    assert not new, "modules that import each other: " + "; ".join(map(", ".join, new))
    gone = [sorted(known) for known in known_circles if not any(c <= known for c in found)]
    assert not gone, f"no circles any more, take them off house.yaml: {gone}"


def test_the_search_for_circles_finds_them_all() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"b", "d"}, "d": {"e"}, "e": {"d"}, "f": {"a"}}
    assert circles(graph) == [{"b", "c"}, {"d", "e"}]


def test_no_folder_has_more_modules_than_a_reader_can_take_in() -> None:
    count = Counter(p.parent for p in python_files(PACKAGE) if p.name != "__init__.py")
    full = {str(f.relative_to(ROOT)): n for f, n in count.items() if n > MOST_MODULES}
    assert not full, f"more than {MOST_MODULES} modules: {full}"


def test_no_module_is_longer_than_a_reader_can_take_in() -> None:
    lines = {
        str(path.relative_to(PACKAGE)): len(path.read_text(encoding="utf-8").splitlines())
        for path in python_files(PACKAGE)
    }
    long = {p: n for p, n in lines.items() if n > EXCEPTIONS["long"].get(p, MOST_LINES)}
    assert not long, f"longer than {MOST_LINES} lines, or than they were: {long}"
    short = sorted(p for p in EXCEPTIONS["long"] if lines.get(p, 0) <= MOST_LINES)
    assert not short, f"short enough, take them off house.yaml: {short}"


def public_functions(path: Path) -> Iterator[ast.FunctionDef]:
    """Yield functions and methods without an underscore."""
    for node in parse(path).body:
        if isinstance(node, ast.FunctionDef):
            yield node
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from (n for n in node.body if isinstance(n, ast.FunctionDef))


def arguments_of(function: ast.FunctionDef) -> list[ast.arg]:
    given = function.args
    found = [*given.posonlyargs, *given.args, *given.kwonlyargs]
    return found[1:] if found and found[0].arg in {"self", "cls"} else found


def described(docstring: str) -> dict[str, str]:
    """Return the text on each parameter, its type included, of a docstring of numpy's form."""
    _, _, section = f"\n{docstring}\n".partition("\nParameters\n----------\n")
    section = re.split(r"\n[A-Z][a-z]+\n---", section)[0]
    found: dict[str, str] = {}
    for names, text in re.findall(r"^(\S.*?)(?: : (.*(?:\n[ ].*|\n(?=\n ))*))?$", section, re.M):
        found |= dict.fromkeys((n.strip(" *") for n in names.split(",")), text)
    return found


def lacks_of(function: ast.FunctionDef) -> list[str]:
    """Return what the docstring of a function leaves open about its parameters.

    An array needs its shape and every floating-point number its unit, `[1]` if it has none;
    a name in backticks refers to where both stand, "as `name`" to where all of them do.
    """
    arguments = arguments_of(function)
    docstring = ast.get_docstring(function) or ""
    if len(arguments) < 3 or function.name.startswith("_") or re.search(r"\bas `", docstring):
        return []
    texts = described(docstring)
    found = []
    for argument in arguments:
        kind = ast.unparse(argument.annotation) if argument.annotation else ""
        text = texts.get(argument.arg)
        if text is None:
            found.append(f"{argument.arg} is not described")
        elif "`" in text:
            continue
        elif re.match(r"\w+Array\b", kind) and "(" not in text:
            found.append(f"{argument.arg} lacks a shape")
        elif re.match(r"float\b|FloatArray\b", kind) and not re.search(r"\[.+\]", text):
            found.append(f"{argument.arg} lacks a unit")
    return found


def undescribed() -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for path in python_files(PACKAGE):
        for function in public_functions(path):
            for lack in lacks_of(function):
                text = f"{place(path, function)} {function.name}: {lack}"
                found.setdefault(str(path.relative_to(PACKAGE)), []).append(text)
    return found


def test_public_functions_describe_their_parameters_with_shape_and_unit() -> None:
    offences = [
        line
        for path, lines in undescribed().items()
        if path not in EXCEPTIONS["undescribed"]
        for line in lines
    ]
    assert not offences, "\n".join(offences)


def test_no_list_of_undescribed_modules_outlives_its_reason() -> None:
    gone = sorted(set(EXCEPTIONS["undescribed"]) - set(undescribed()))
    assert not gone, f"described or gone, take them off house.yaml: {gone}"


def test_only_compiled_kernels_take_more_than_ten_parameters() -> None:
    offences = [
        f"{place(path, function)} {function.name}: {len(arguments_of(function))}"
        for path in python_files(PACKAGE)
        for function in public_functions(path)
        if len(arguments_of(function)) > MOST_PARAMETERS and not function.name.startswith("_")
        if not any("njit" in ast.unparse(decorator) for decorator in function.decorator_list)
    ]
    assert not offences, "\n".join(offences)


def test_the_check_of_parameters_sees_what_is_missing() -> None:
    source = (
        "def f(a: FloatArray, b: float, c: int, d: FloatArray, e: float):\n"
        '    """Do.\n\n    Parameters\n    ----------\n    a, d : (N,) arrays\n'
        "        Pressures [Pa].\n\n        Two.\n    b : float\n        Time.\n    e : float\n"
        "        As in `g`.\n\n    Returns\n    -------\n    c : int\n        Count.\n"
        '    """\n'
    )
    (function,) = ast.parse(source).body
    assert isinstance(function, ast.FunctionDef)
    assert lacks_of(function) == ["b lacks a unit", "c is not described"]
    (function,) = ast.parse(f'def f(a, b, c):\n    """Do as `{"g"}` says."""').body
    assert isinstance(function, ast.FunctionDef)
    assert lacks_of(function) == []


def test_the_tests_mirror_the_package() -> None:
    tests = ROOT / "test"
    files = {str(p.relative_to(tests)) for p in tests.rglob("test_*.py")}
    modules = {str(p.relative_to(PACKAGE)) for p in python_files(PACKAGE)}
    tested_in = EXCEPTIONS["tested_in"]
    of_modules = {str(Path(m).with_name(f"test_{Path(m).name}")) for m in modules}
    of_modules |= {str(Path(m).with_name(f"test_{Path(m).parent.name}.py")) for m in modules}
    of_more = {
        str(Path(f, f"test_{n}.py"))
        for f, names in EXCEPTIONS["tests_of_more"].items()
        for n in names
    }
    strays = sorted(files - of_modules - of_more)
    assert not strays, (
        f"tests of no module of their name; name them so, or what they test: {strays}"
    )
    folders = {str(Path(m).parent) for m in modules if not m.endswith("__init__.py")} - {"."}
    tested = {str(Path(f).parent) for f in files}
    untested = sorted(folders - tested - set(tested_in))
    assert not untested, f"folders without a folder of tests: {untested}"
    stale = sorted(of_more - (files - of_modules))
    stale += sorted(set(tested_in) - (folders - tested)) + sorted(set(tested_in.values()) - tested)
    assert not stale, f"no exceptions any more: {stale}"
