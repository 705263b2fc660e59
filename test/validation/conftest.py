# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The papers, recomputed once a run: for their own tests and for the document of all."""

from collections.abc import Callable
from pathlib import Path

import pytest

from test.conftest import once
from valve_twin.validation import Check, get_paper


def recompute(number: str) -> tuple[Check, ...]:
    advanced: list[int] = []
    paper = get_paper(number)
    found = paper.recompute(lambda: advanced.append(1))
    assert len(advanced) == paper.steps
    return tuple(found)


@pytest.fixture(scope="session")
def recomputed(shared_folder: Path) -> Callable[[str], tuple[Check, ...]]:
    """Return a function that recomputes the paper of a number."""
    return once(recompute, shared_folder)
