# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""BLAS runs in one thread in every process of ours, unless its user wants otherwise."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

NAMES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def threads(module: str, **given: str) -> int:
    """Return the threads of a process that imported a module and multiplied large matrices."""
    code = f"import {module}, os, numpy as np; a = np.ones((900, 900)); a @ a; "
    code += "print(len(os.listdir('/proc/self/task')))"
    kept = {k: v for k, v in os.environ.items() if k not in NAMES}
    done = subprocess.run(
        [sys.executable, "-c", code], env=kept | given, capture_output=True, text=True, check=True
    )
    return int(done.stdout)


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="needs two cores")
def test_one_unless_more_are_wanted():
    alone = threads("valve_twin.cli")
    assert threads("valve_twin.cli", OMP_NUM_THREADS="2") == alone + 1
