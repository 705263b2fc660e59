# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A program that runs in an interpreter of its own, as a start does."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def programmed(program: str, **environment: str) -> str:
    """Return what a program of its own prints, in an environment with some variables more."""
    command = [sys.executable, "-c", program]
    given = {**os.environ, **environment}
    done = subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT, env=given)
    return done.stdout
