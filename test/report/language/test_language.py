# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A report in German with steps and error budget has no sentence left in English."""

from __future__ import annotations

import ast
import inspect
import re
from html import unescape
from typing import TYPE_CHECKING

import pytest

from valve_twin.cli import main
from valve_twin.core.operation import command_steps, step_metrics
from valve_twin.core.valves.press_cartridge import approximations
from valve_twin.core.valves.registry import get_model
from valve_twin.io.config.valve import load_config
from valve_twin.report.language import words as module
from valve_twin.report.language.words import sentence, whole_page, words

if TYPE_CHECKING:
    from valve_twin.io.config.valve import ValveConfig

TERMS = {"parameter", "estimators"}
"""The same in both languages."""

WORD = re.compile("[a-z]{3,}")


def left_english(page: str, names: set[str]) -> list[str]:
    """Return what of an English page is the same in German and is more than names."""
    parts = {p for p in module._NOT_OURS.split(page) if not p.startswith("<")}
    german = whole_page(page, "de")
    kept = set(module._NOT_OURS.split(german)) & parts
    kept |= set(re.findall(r'<span lang="en">(.*?)</span>', german))
    return [k for k in kept if set(WORD.findall(unescape(k).lower())) - names]


def names_of(config: ValveConfig) -> set[str]:
    """Return every word of the names of a valve's parameters, estimators and signals."""
    names = *(p.name for p in get_model(config.model).parameters), *config.options.estimators
    return TERMS.union(*(WORD.findall(n.lower()) for n in (*names, *config.signals)))


@pytest.mark.parametrize("model", ["press_cartridge", "first_order"])
def test_a_report_with_steps_and_budget_has_no_sentence_in_english(root, tmp_path, model):
    config, bag, page = root / "config" / f"{model}.yaml", tmp_path / "bag", tmp_path / "page.html"
    asked = ["--config", str(config)]
    assert main(["simulate", *asked, "--cycles", "6", "--seed", "8", "--out", str(bag)]) == 0
    assert main(["report", str(bag), *asked, "--budget", "--out", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    assert "Error budget" in text
    assert "Why it is not told" in text
    assert left_english(text, names_of(load_config(config)[0])) == []


def said(module) -> list[str]:
    """Return the texts of a module of two words or more, 3 for what differs; no docstrings."""
    tree = ast.parse(inspect.getsource(module))
    docs: set[object] = set()
    joined = [n for n in ast.walk(tree) if isinstance(n, ast.JoinedStr)]
    inside = {id(part) for whole in joined for part in whole.values}
    texts = [
        "".join(str(p.value) if isinstance(p, ast.Constant) else "3" for p in whole.values)
        for whole in joined
    ]
    for n in ast.walk(tree):
        if isinstance(n, ast.Expr):  # a docstring
            docs.add(getattr(n.value, "value", None))
        elif isinstance(n, ast.Constant) and isinstance(n.value, str) and id(n) not in inside:
            texts += [n.value]
    texts = [text for text in texts if text not in docs]
    return [text for text in texts if len(WORD.findall(text)) > 1 and " " in text]


def test_every_reason_of_a_step_and_row_of_the_budget_is_told_in_german():
    german = words("de", "_report")
    texts = [*said(command_steps), *said(step_metrics), *said(approximations)]
    assert len(texts) > 20
    assert [text for text in texts if 'lang="en"' in sentence(text, german)] == []
