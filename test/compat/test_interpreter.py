# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What stands in for what Python and numba keep private."""

import argparse
import sys

import pytest

from test.programmed import programmed
from valve_twin.compat import interpreter


def test_the_interpreter_is_shared():
    before = sys.getswitchinterval()
    try:
        interpreter.share_interpreter()
        assert sys.getswitchinterval() == pytest.approx(interpreter.SWITCH_S)
    finally:
        sys.setswitchinterval(before)


KERNELS_ALONE = """
import sys
from valve_twin.compat import interpreter

interpreter.load_kernels_alone()
import numpy as np
from valve_twin.core.estimation.cycle.movement import find_moves
from valve_twin.kernels import njit

assert find_moves(np.linspace(0.0, 1.0, 8)).travel > 0.9
early = {"cffi", "numba.np.linalg"} & sys.modules.keys()
solve = njit(lambda a, b: np.linalg.solve(a, b))(2.0 * np.eye(2), np.ones(2))
assert solve.tolist() == [0.5, 0.5]
print(*early, *({"scipy.linalg"} & sys.modules.keys()), "was needed")
"""


def test_a_kernel_comes_from_its_cache_without_the_compiler_and_one_of_none_is_compiled():
    """What a compiler needs is not there before; what BLAS needs comes with its first call."""
    assert programmed(KERNELS_ALONE).split()[-3:] == ["scipy.linalg", "was", "needed"]
    assert programmed(KERNELS_ALONE) == "scipy.linalg was needed\n"  # now it is in the cache


def test_who_wants_coverage_gets_it_after_the_kernels():
    pytest.importorskip("coverage")
    assert (
        programmed(
            "from valve_twin.compat.interpreter import load_kernels_alone\n"
            "load_kernels_alone()\n"
            "import sys; print('coverage' in sys.modules, end=' ')\n"
            "import coverage; print(coverage.__name__)"
        )
        == "False coverage\n"
    )


def test_a_number_with_an_exponent_is_no_option():
    parser = argparse.ArgumentParser()
    parser.add_argument("--at", type=float, nargs="+")
    parser.add_argument("file", nargs="?")
    interpreter.take_exponents(parser)
    for text in ("-5e-4", "-5E+4", "-.5e3", "-5.e3", "-5", "-0.5"):
        assert parser.parse_args(["--at", text]).at == [float(text)]
    for text in ("-5e", "-e4", "-x"):
        with pytest.raises(SystemExit):
            parser.parse_args(["--at", text])
