# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Every word of the pages is there in German, and a browser gets the language that it asks for."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from markupsafe import Markup

import valve_twin.gateway
from valve_twin.core.aging.verdict import VerdictKind
from valve_twin.core.faults.ne107 import Ne107
from valve_twin.core.types import Prediction, Validity
from valve_twin.gateway.page import forms
from valve_twin.gateway.page.words import cell, chosen, drawn, read_catalogue, words
from valve_twin.report import plots
from valve_twin.report.plots import plot_cycle
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


def test_the_words_inside_a_picture_are_translated():
    stamp_ns = np.arange(20, dtype=np.int64) * 10**8
    x = np.linspace(0.0, 1.0, 20)
    valid = np.full(20, Validity.VALID, dtype=np.uint8)
    plot = plot_cycle(Prediction(7, stamp_ns, x, x, x, 0.0 * x, 1e-3, valid))
    found = drawn(plot, words("de"))
    assert drawn(plot, words("en")) == plot
    assert 'aria-label="Stellung und Residuum über Zyklus 7"' in found
    texts = re.findall(r"<text [^>]*>([^<]*[a-z]{3}[^<]*)<", plot)
    assert len(texts) == 3
    assert not [text for text in texts if text in found]
    name = '<text class="label">K_in & <b> over cycle</text>'.replace("& <b>", "&amp; &lt;b&gt;")
    assert drawn(name, words("de")) == name.replace("over cycle", "über Zyklus")
    limit = '<text class="limit">service limit 0.5, beyond this view ▼</text>'
    assert ">Wartungsgrenze 0.5, unterhalb dieses Bildes ▼<" in drawn(limit, words("de"))


def test_the_words_in_the_cells_of_a_table_are_translated():
    german = words("de")
    made = Markup("steady<small>60 estimates</small>")
    assert cell(made, german) == "stetig<small>60 Schätzungen</small>"
    assert cell("<b>due</b>", german) == "&lt;b&gt;due&lt;/b&gt;"
    assert cell("due", german) == "fällig"
    assert cell(made, words("en")) == made


def test_every_word_that_the_plots_write_is_translated():
    known = {message.split("{}")[0] for message in words("de").catalogue}
    text = Path(plots.__file__).read_text(encoding="utf-8")
    written = re.findall(r'(?:panel\.text\([^"\n]*, |_label=|text = |title = )f?"([^"{]+)', text)
    written = [w for w in written if re.search("[a-z]{3}", w) and not w.startswith("residual")]
    assert len(written) >= 5
    assert set(written) - {"limit", "tick"} <= known  # these are styles


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
