# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""C from compiled Python: the same numbers as numba gives, and a line where there is none."""

import ctypes
import math
import os
import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest
from numba import njit

from valve_twin.core.types import Restart
from valve_twin.core.valves.hydraulic_actuator.kernels import free_run
from valve_twin.core.valves.kit import Lawful
from valve_twin.core.valves.positioner.kernels import advance
from valve_twin.core.valves.registry import get_model, model_names
from valve_twin.gateway.fmu.c_code import Translation
from valve_twin.gateway.fmu.c_kinds import Array
from valve_twin.io.errors import FmuError

pytest.importorskip("ziglang")
pytestmark = pytest.mark.timeout(900)  # the first use of the compiler builds its C library

LIMIT = 3
BENT = 0.3


@njit
def helper(a, b):
    if a > b:
        return a - b, 1.0
    return b - a, 0.5


@njit
def whole(a, n):
    total = 0
    for k in range(n, -n, -2):
        if k == 1:
            continue
        total += k * k // 3 - (k % 4)
    return float(total) + a


@njit
def everything(x, u, p, period_s):
    """Use all that has a translation."""
    far, sign = helper(u[0], x[0])
    near = min(far, p[0], 2.0) if far > 0.1 else max(far, 0)
    inner = np.zeros(LIMIT)
    for i in range(LIMIT):
        inner[i] = p[1] * i - x[-1]
    inner[1:] = 0.25
    x[1:3] = inner[:2]
    part = x[1:]
    count = 0
    while True:
        count += 1
        if count > 5 or (near > 3.0 and count != 2):
            break
    a, b = x[0], near
    a, b = b, a
    flag = Restart.BAD if 0.0 <= sign < 0.7 else Restart.GAP
    power = p[1] ** 3 + abs(b) ** 0.5 + (-p[0]) ** 2 - 2.0**-2
    modulo = (-7.5 * p[0]) % 2.0 + (7 // -2) - (-7 % 3) + int(-2.7)
    x[0] = a + sign * period_s * math.tanh(power) + np.hypot(b, BENT) + modulo
    x[0] += whole(part[0], 6) + count + (flag == Restart.BAD) + len(part) + helper(a, b)[0]
    x[0] += round_down(p[0])
    x[2] -= math.exp(-abs(x[0])) * (1.0 if np.isfinite(x[0]) and u[0] != u[1] else -1.0)


@njit
def round_down(a):
    return math.floor(a * 10.0) / 10 - np.arctan2(a, 2.0)


def compiled(folder, function, kinds):
    """Return a function of rows of doubles, and of one double for each kind that is none."""
    translation = Translation()
    name = translation.add(function, kinds).name
    rows = [f"a{i}" if isinstance(k, Array) else f"*a{i}" for i, k in enumerate(kinds)]
    head = ", ".join(f"double *a{i}" for i in range(len(kinds)))
    face = f"void face({head}) {{ {name}({', '.join(rows)}); }}\n"
    (folder / "law.c").write_text(translation.text() + face)
    command = [sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-linux-gnu.2.17", "-O2"]
    command += ["-std=c99", "-ffp-contract=off", "-fno-sanitize=all", "-shared", "-s", "-fPIC"]
    done = subprocess.run(
        [*command, "law.c", "-o", "law.so", "-lm"],
        cwd=folder,
        env={**os.environ, "LD_LIBRARY_PATH": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    law = ctypes.CDLL(str(folder / "law.so"))
    return lambda *rows: law.face(*(r.ctypes.data_as(ctypes.c_void_p) for r in rows))


def test_the_c_of_a_law_gives_the_numbers_of_numba(tmp_path):
    kinds = (Array(3), Array(2), Array(2), "double")
    run = compiled(tmp_path, everything, kinds)
    random = np.random.default_rng(1)
    for _ in range(300):
        x, u, p = random.normal(size=3), random.normal(size=2), random.uniform(0.1, 2.0, 2)
        ours, theirs = x.copy(), x.copy()
        everything(theirs, u, p, 0.05)
        run(ours, u, p, np.array([0.05]))
        np.testing.assert_allclose(ours, theirs, rtol=1e-14, atol=1e-14)


@njit
def own_numbers(x):
    """Use what C does otherwise where a row is written from its own numbers."""
    x[1:] = x[:-1]
    x[4:6] = x[4] + 1.0
    a = np.zeros(2)
    b = np.zeros(2)
    a[0], b[0] = x[0], 3.0
    a, b = b, a
    for i in range(3):
        x[i] += x[i - 1]
    for i in range(3):
        made = np.zeros(2)
        made[0] += x[i]
    x[6] = x[0] // 0.1
    x[7] = x[7] * a[0] + b[0] + made[0] + -0.0 % 3.0 + x[0] // -0.3


def test_rows_that_are_written_from_themselves_give_the_numbers_of_numba(tmp_path):
    run = compiled(tmp_path, own_numbers, (Array(8),))
    for first in (1.0, -0.7, 0.3):
        x = np.arange(first, first + 8.0)
        ours, theirs = x.copy(), x.copy()
        own_numbers(theirs)
        run(ours)
        np.testing.assert_array_equal(ours, theirs)


LAWS = [m for m in map(get_model, model_names()) if isinstance(m, Lawful)]


@pytest.mark.parametrize("valve", LAWS, ids=lambda valve: valve.name)
def test_every_law_of_the_kit_gives_the_same_numbers(valve, tmp_path):
    law, inputs = valve.law, len(valve.inputs)
    kinds = (Array(law.states), Array(inputs), Array(len(law.parameters)), "double")
    run = compiled(tmp_path, law.step, kinds)
    random = np.random.default_rng(2)
    for _ in range(300):
        x, u = random.uniform(size=law.states), random.uniform(size=inputs)
        ours, theirs = x.copy(), x.copy()
        law.step(theirs, u, law.values, 0.05)
        run(ours, u, law.values, np.array([0.05]))
        np.testing.assert_allclose(ours, theirs, rtol=1e-15)


class _Spring(NamedTuple):
    rate: float
    turns: int
    bends: bool


@njit
def _spring_of(p):
    return _Spring(p[0], int(p[1]), p[2] > 0.5)


@njit
def _pushed(spring, ends, x):
    if spring.bends and x > ends[0]:
        return ends[1], 1
    return spring.rate * spring.turns * x, ends[1]


@njit
def tuples(x, p):
    """Keep tuples in one name, with and without names of their own."""
    spring = _spring_of(p)
    ends = (1, 2.5)
    for k in range(3):
        x[k], lost = _pushed(spring, ends, x[k])
        ends = (lost + k, x[k])
        if ends[0] > 4.0:
            spring = _Spring(0.5 * spring.rate, 7, False)
    x[3] = _pushed(spring, (x[0], x[1]), x[2])[1] + spring.turns


def test_tuples_with_and_without_names_give_the_numbers_of_numba(tmp_path):
    run = compiled(tmp_path, tuples, (Array(4), Array(3)))
    for first in (0.2, 0.9, 1.1, 3.0):
        for bends in (0.0, 1.0):
            x, p = np.array([first, 0.4, 2.0, 0.0]), np.array([1.3, 2.0, bends])
            ours, theirs = x.copy(), x.copy()
            tuples(theirs, p)
            run(ours, p)
            np.testing.assert_array_equal(ours, theirs)


def test_kernels_that_were_not_written_for_it_have_a_translation():
    translation = Translation()
    translation.add(advance, ("double", "double", Array(5), "double"))
    translation.add(free_run, (Array(10), Array(50), "double", Array(50)))
    assert translation.text().count("static ") > 10


@njit
def _prints(x):
    x[0] = 1.0
    print(x[0])  # noqa: T201


@njit
def _slices_by_a_variable(x):
    n = int(x[0])
    x[:n] = 0.0


@njit
def _calls_itself(x):
    if x[0] > 0.0:
        _calls_itself(x)


@njit
def _raises(x):
    if x[0] > 0.0:
        raise ValueError


@njit
def _goes_over_numbers(x):
    for v in x:
        x[0] += v


@njit
def _reaches_too_far(x):
    x[0] = x[2]


@njit
def _keeps_a_row_that_is_made_anew(x):
    old = np.zeros(2)
    for _ in range(2):
        made = np.zeros(2)
        x[0] += old[0]
        made[0] = x[0]
        old = made


TABLE = np.array([1.0, 2.0])


@njit
def _knows_a_table(x):
    x[0] = TABLE[0]


@pytest.mark.parametrize(
    ("function", "line", "said"),
    [
        (_prints, 2, "calls what is neither compiled nor a function of math"),
        (_slices_by_a_variable, 2, "the ends of a part must be known now"),
        (_calls_itself, 0, "_calls_itself calls itself"),
        (_raises, 2, "(Raise) has no translation into C"),
        (_goes_over_numbers, 1, "(For) has no translation into C"),
        (_reaches_too_far, 1, "lies outside its 2 numbers"),
        (_keeps_a_row_that_is_made_anew, 3, "makes a row anew in a loop that keeps rows"),
        (_knows_a_table, 1, "is a ndarray: only numbers have a translation"),
    ],
)
def test_what_has_no_translation_is_refused_with_its_line(function, line, said):
    with pytest.raises(FmuError) as caught:
        Translation().add(function, (Array(2),))
    text = str(caught.value)
    assert said in text
    assert "\n" not in text
    if line:
        number = function.py_func.__code__.co_firstlineno + 1 + line  # behind the decorator
        assert text.startswith(f"test_c_code.py:{number}:"), text
