# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Every word of the pages is there in German, and a browser gets the language that it asks for."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import valve_twin.gateway
from valve_twin.core.aging.verdict import VerdictKind
from valve_twin.core.faults.ne107 import Ne107
from valve_twin.gateway.page import forms
from valve_twin.gateway.page.words import chosen, read_catalogue, words
from valve_twin.report.tables import STATUS_WORDS

TEMPLATES = Path(valve_twin.gateway.__file__).parent / "templates"


def test_every_word_of_the_templates_is_translated():
    texts = [path.read_text(encoding="utf-8") for path in sorted(TEMPLATES.glob("*.html"))]
    asked = {found for text in texts for _, found in re.findall(r"_\((['\"])(.+?)\1\)", text)}
    for text in texts:  # headings in lists
        for listed in re.findall(r"\{% for [\w, ]+ in \((.+?)\) %\}", text):
            asked |= {w for w in re.findall(r'"([^"]+)"', listed) if not w.islower()}
    assert len(asked) > 60
    missing = asked - set(words("de").catalogue) - {"95 %"}
    assert not missing


def test_words_that_come_from_elsewhere_are_translated():
    known = set(words("de").catalogue)
    assert {state.value for state in Ne107} <= known
    assert {kind.text for kind in VerdictKind} <= known
    assert set(STATUS_WORDS.values()) <= known
    assert forms.WRONG in known


def test_a_catalogue_is_read_with_lines_that_go_on():
    text = '# note\nmsgid ""\nmsgstr "header"\n\nmsgid "a "\n"\\"b\\""\nmsgstr "c\\n"\n"d"\n'
    assert read_catalogue(text) == {'a "b"': "c\nd"}
    assert words("en").gettext("anything") == "anything"
    assert words("de").gettext("not there") == "not there"


@pytest.mark.parametrize(
    ("asked", "kept", "accepted", "language"),
    [
        ("", "", "", "en"),
        ("de", "en", "en", "de"),
        ("xx", "de", "en", "de"),
        ("", "", "fr, de-CH;q=0.8, en;q=0.9", "en"),
        ("", "", "de-DE,de;q=0.9", "de"),
        ("", "", "en;q=x, de;q=nan, ;;;" + "a" * 10_000, "en"),
    ],
)
def test_the_language_is_the_one_asked_for(asked, kept, accepted, language):
    assert chosen(asked, kept, accepted) == language
