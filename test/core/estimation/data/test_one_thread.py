# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Products of long arrays: right, and with as many BLAS threads as fast as with one."""

import os
import subprocess
import sys

import numpy as np
import pytest

from valve_twin.core.estimation.data.one_thread import dot, rows_times

SPENT = """
import threading, time
import numpy as np
from valve_twin.core.aging.joining import _score
from valve_twin.core.diagnosis.lines import Rays
rest, rows, some = np.ones(20_000), np.ones((4096, 13)), np.ones((24, 13))
rays = Rays(np.eye(13), some, some, some)
_score(rest, 1.0), rays.along(rows), rays.whitened(rows)
all_, own = time.process_time(), time.thread_time()
for _ in range(200):
    _score(rest, 1.0), rays.along(rows), rays.whitened(rows)
print((time.process_time() - all_) / (time.thread_time() - own))
"""
"""Prints the time that all threads spent, in that of the one that calculates."""


def test_products_are_those_of_the_blas():
    random = np.random.default_rng(1)
    u, v = random.standard_normal((2, 30_000))
    rows, matrix = random.standard_normal((9001, 13)), random.standard_normal((13, 24))
    assert dot(u, v) == pytest.approx(u @ v, rel=1e-9)
    assert np.allclose(rows_times(rows, matrix), rows @ matrix, rtol=1e-12, atol=1e-12)
    assert rows_times(rows[:0], matrix).shape == (0, 24)


@pytest.mark.no_cover
def test_what_a_verdict_multiplies_takes_no_other_thread():
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "2", "OMP_NUM_THREADS": "2"}
    answer = subprocess.run(
        [sys.executable, "-c", SPENT], env=environment, capture_output=True, text=True, check=True
    )
    assert float(answer.stdout) < 1.05
