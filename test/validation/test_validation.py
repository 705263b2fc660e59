# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""docs/validation.md is what `validate` computes; what counts as evidence keeps to its kind."""

from __future__ import annotations

import importlib
import math
import re

import pytest

from valve_twin.validation import Kind, Verdict, counted, paper_numbers

NUMBER = re.compile(r"(?<![\w.])-?\d+(\.\d+)?(e-?\d+)?(?![\w])")


@pytest.fixture(scope="module")
def checks(recomputed):
    return {n: recomputed(n) for n in paper_numbers()}


@pytest.fixture
def text(root, monkeypatch, checks):
    monkeypatch.syspath_prepend(str(root / "tools"))
    return importlib.import_module("validation").document(checks)


def test_the_committed_document_is_current(root, text):
    """Words are the same; numbers may differ in the last digit from machine to machine."""
    committed = (root / "docs" / "validation.md").read_text(encoding="utf-8")
    advice = "run tools/run python tools/validation.py"
    assert NUMBER.sub("#", committed) == NUMBER.sub("#", text), advice
    for old, new in zip(NUMBER.finditer(committed), NUMBER.finditer(text), strict=True):
        assert float(old[0]) == pytest.approx(float(new[0]), rel=0.02), advice


def test_every_paper_is_in_the_document(text):
    assert [n for n in paper_numbers() if f"## Paper {n}, " not in text] == []


def test_limits_are_no_wider_than_the_value(checks):
    """A row whose limits are wide beside its value is no evidence."""
    wide = [
        (number, c.quantity)
        for number, found in checks.items()
        for c in found
        if not isinstance(c.published, str)
        and c.kind is not Kind.REGRESSION
        and "settled" not in c.quantity
        and math.isfinite(c.upper - c.lower)
        and c.upper - c.lower > 3.0 * abs(c.published)
    ]
    assert wide == []


def test_what_cannot_be_reproduced_counts_for_no_kind(checks):
    rows = checks["002"]
    words = counted(rows)
    made = sum(int(n) for n in re.findall(r"(\d+) (?:agree|do not)", words))
    missing = sum(c.verdict is Verdict.CANNOT for c in rows)
    assert made + missing == len(rows)
    assert words.endswith(f"{missing} cannot be reproduced")
