# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A compiled kernel is taken from the cache only where all behind it is the same."""

import importlib
import os
import re
import subprocess
import sys
from pathlib import Path

import numba
import pytest
from numba.core import event

from valve_twin import kernels

PACKAGE = Path(kernels.__file__).parent

OUTER = """
from valve_twin.kernels import njit
from {name}.inner import (
    shift,
)
from {name} import numbers

@njit(cache=True)
def moved(x: float) -> float:
    return shift(x) + numbers.OFFSET
"""

INNER = """
from valve_twin.kernels import njit
from {name}.deep import SCALE

@njit(cache=True)
def shift(x: float) -> float:
    return SCALE * x
"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Return a package of kernels that call each other."""
    name = f"kernels_of_{re.sub('[^a-z0-9]', '_', tmp_path.name.lower())}"
    folder = tmp_path / name
    folder.mkdir()
    for module, text in {
        "__init__": "",
        "outer": OUTER,
        "inner": INNER,
        "deep": "SCALE = 2.0\n",
        "numbers": "OFFSET = 0.5\n",
        "other": "NOTHING = 1\n",
    }.items():
        (folder / f"{module}.py").write_text(text.format(name=name))
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    yield folder
    forget(folder.name)


def forget(name):
    for module in [m for m in sys.modules if m.partition(".")[0] == name]:
        del sys.modules[module]
    importlib.invalidate_caches()


class Compilations(event.Listener):
    def __init__(self):
        self.count = 0

    def on_start(self, _event):
        self.count += 1

    def on_end(self, _event):
        pass


def moved_in_a_new_program(folder, x=1.0):
    """Return what the outer kernel gives, and whether anything was compiled for it."""
    forget(folder.name)
    seen = Compilations()
    with event.install_listener("numba:compile", seen):
        found = importlib.import_module(f"{folder.name}.outer").moved(x)
    return found, seen.count > 0


@pytest.mark.parametrize(
    ("module", "text", "wanted"),
    [("deep", "SCALE = 3.0\n", 3.5), ("numbers", "OFFSET = 0.25\n", 2.25)],
)
def test_what_changed_behind_a_kernel_is_compiled_anew(package, module, text, wanted):
    assert moved_in_a_new_program(package) == (2.5, True)
    assert moved_in_a_new_program(package) == (2.5, False)
    (package / f"{module}.py").write_text(text)
    assert moved_in_a_new_program(package) == (wanted, True)
    assert moved_in_a_new_program(package) == (wanted, False)


@pytest.mark.parametrize(
    "form",
    [
        "import {name}.numbers as numbers",
        "import math, {name}.numbers as numbers",
        "from . import numbers",
        "from . import (\n    numbers as numbers,\n)",
    ],
)
def test_every_form_of_an_import_is_seen(package, form):
    text = (package / "outer.py").read_text()
    old = f"from {package.name} import numbers"
    (package / "outer.py").write_text(text.replace(old, form.format(name=package.name)))
    assert moved_in_a_new_program(package) == (2.5, True)
    (package / "numbers.py").write_text("OFFSET = 0.25\n")
    assert moved_in_a_new_program(package) == (2.25, True)


def test_what_a_kernel_does_not_import_and_a_new_date_do_not_matter(package):
    moved_in_a_new_program(package)
    (package / "other.py").write_text("NOTHING = 2\n")
    os.utime(package / "deep.py", ns=(1, 1))
    assert moved_in_a_new_program(package) == (2.5, False)


def test_a_kernel_of_another_package_is_left_to_numba(tmp_path, monkeypatch):
    path = tmp_path / "a_stranger_to_us.py"
    path.write_text("from numba import njit\n\n@njit(cache=True)\ndef one():\n    return 1\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    one = importlib.import_module("a_stranger_to_us").one
    assert not isinstance(one._cache._impl.locator, kernels._Stamped)
    assert one() == 1


def test_a_valve_of_a_user_that_calls_our_kernels_is_covered(tmp_path, monkeypatch):
    path = tmp_path / "a_valve_of_a_user.py"
    text = "from numba import njit\nfrom valve_twin.core.types import Validity\n"
    path.write_text(text + "\n@njit(cache=True)\ndef one():\n    return int(Validity.VALID)\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    one = importlib.import_module("a_valve_of_a_user").one
    assert isinstance(one._cache._impl.locator, kernels._Stamped)


def test_every_kernel_of_the_package_takes_njit_from_there():
    written = re.compile(r"^\s*(from numba import .*\bnjit\b|import numba\b)", re.MULTILINE)
    others = [p for p in PACKAGE.rglob("*.py") if written.search(p.read_text(encoding="utf-8"))]
    assert others == [PACKAGE / "kernels.py"]


def test_a_program_that_took_numba_first_is_served_too():
    text = (
        "import numba\nfrom valve_twin.core.physics.solenoid_map import coil_flux\n"
        "print(type(coil_flux._cache._impl.locator).__mro__[1].__name__)\n"
    )
    said = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, timeout=120, check=True
    )
    assert said.stdout.strip() == "_Stamped"
    assert numba.njit is kernels.njit


def test_an_index_that_names_a_module_that_is_gone_is_compiled_anew(package):
    """After an upgrade that moved a type every program ended with ModuleNotFoundError."""
    (package / "kinds.py").write_text(
        "from typing import NamedTuple\n\nclass Pair(NamedTuple):\n    a: float\n    b: float\n"
    )
    text = (
        "from valve_twin.kernels import njit\nfrom {name}.{kinds} import Pair\n\n"
        "@njit(cache=True)\ndef added(pair):\n    return pair.a + pair.b\n\n"
        "def moved(x):\n    return added(Pair(x, 1.0))\n"
    )
    outer = package / "outer.py"
    outer.write_text(text.format(name=package.name, kinds="kinds"))
    assert moved_in_a_new_program(package) == (2.0, True)
    (package / "kinds.py").rename(package / "sorts.py")
    outer.write_text(text.format(name=package.name, kinds="sorts"))
    assert moved_in_a_new_program(package, 2.0) == (3.0, True)
    assert moved_in_a_new_program(package, 2.0) == (3.0, False)
