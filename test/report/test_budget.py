# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The error budget on the page: bars that add up, letters, words for what is refused."""

from __future__ import annotations

import dataclasses
import math
import re
from xml.etree import ElementTree as ET

import pytest

from valve_twin.core.valves.error_budget import Budget, BudgetColumn, BudgetRow
from valve_twin.report import render_report
from valve_twin.report.budget import budget_bars, budget_section

ROWS = (
    BudgetRow("a", "offset of v_in", 1e-3, (0.01, 0.3)),
    BudgetRow("f", "noise of <position>", 1e-3, (0.03, math.nan)),
    BudgetRow("k", "compressibility", 2e-4, (0.0, 0.1)),
)
BUDGET = Budget(
    (BudgetColumn("K_in", "output_error", 0.0094), BudgetColumn("leak", "output_error", 1e-3)),
    ROWS,
)


def bars():
    root = ET.fromstring(budget_bars(BUDGET))
    return [
        (float(r.attrib["y"]), float(r.attrib["width"]), r.findtext("title"))
        for r in root.iter("rect")
    ]


def test_each_bar_is_as_long_as_the_others_and_divided_as_the_sources_are():
    tops = sorted({top for top, _, _ in bars()})
    assert len(tops) == 2
    first, second = ([w for top, w, _ in bars() if top == t] for t in tops)
    assert sum(first) == pytest.approx(sum(second), abs=0.2)
    assert first[1] / first[0] == pytest.approx(3.0, rel=1e-2)
    assert second[0] / second[1] == pytest.approx(3.0, rel=1e-2)


def test_a_part_says_its_source_and_error_and_shows_its_letter():
    assert bars()[1][2] == "(f) noise of <position>: 3 %"
    letters = [t.text for t in ET.fromstring(budget_bars(BUDGET)).iter("text")]
    assert {"a", "f", "k", "4 %", "40 %"} <= set(letters)


def test_what_is_refused_is_a_dash_and_no_part():
    section = budget_section(BUDGET)
    row = next(r for r in re.findall(r"<tr>.*?</tr>", section) if "noise of" in r)
    assert row.count("<td>") == 3
    assert row.endswith("<td>3 %</td><td>–</td></tr>")
    assert "<position>" not in section


def test_the_page_has_the_budget_only_if_it_was_asked_for(example):
    data = example.report_data()
    assert "Error budget" not in render_report(data)
    assert "Error budget" in render_report(dataclasses.replace(data, budget=BUDGET))


def test_no_budget_says_why():
    assert "no motion" in budget_section(Budget((), (), "no motion"))
    assert budget_section(None) == ""
