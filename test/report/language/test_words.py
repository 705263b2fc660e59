# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Every word of the pages is there in German, and a browser gets the language that it asks for."""

from __future__ import annotations

import ast
import math
import re
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from markupsafe import Markup

import valve_twin.core.valves
import valve_twin.gateway
import valve_twin.nodes
from valve_twin.core.aging.assess import Assessment
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.aging.verdict import Trend, TrendStatus, VerdictKind, decide, held_back
from valve_twin.core.cycles import Closing
from valve_twin.core.diagnosis.changes.finding import (
    UNKNOWN,
    Diagnosis,
    Finding,
    describe_finding,
    lately_over,
)
from valve_twin.core.diagnosis.table import BY_NAME, FAULT_TYPES, PAIRS, PARTS, SHOWN_BY, partner
from valve_twin.core.faults.advice import BY_VERDICT, FAILURE_MODES, FAULT_ADVICE, NOW, advise
from valve_twin.core.faults.kinds import FAULT_KINDS, diagnosed
from valve_twin.core.faults.ne107 import Ne107
from valve_twin.core.types import Prediction, Validity
from valve_twin.core.valves.registry import get_model, model_names
from valve_twin.gateway.first_reading import WAITING
from valve_twin.gateway.page import forms
from valve_twin.report import plots
from valve_twin.report.faults import faults_section
from valve_twin.report.language.words import (
    cell,
    chosen,
    drawn,
    figures,
    language_of,
    read_catalogue,
    sentence,
    whole_page,
    words,
)
from valve_twin.report.plots import plot_cycle
from valve_twin.report.tables import STATUS_WORDS

if TYPE_CHECKING:
    from collections.abc import Iterator

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


def test_what_to_do_against_every_fault_of_a_node_is_told_in_german():
    german = words("de")
    remedies = {kind.remedy for kind in FAULT_KINDS}
    remedies |= {diagnosed("valve", advice).remedy for advice in FAULT_ADVICE.values()}
    assert len(remedies) > 30
    assert [
        r for r in remedies if sentence(r, german) == r or "lang=" in sentence(r, german)
    ] == []


def evidence_of_nodes() -> Iterator[str]:
    """Yield what the nodes file with a fault of their own words, 7 for all that differs."""
    for path in sorted(Path(valve_twin.nodes.__file__).parent.rglob("*.py")):
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(call, ast.Call) or not isinstance(call.func, ast.Attribute):
                continue
            if call.func.attr not in {"report", "look"} or len(call.args) < 2:
                continue
            for said in ast.walk(call.args[1]):
                if isinstance(said, ast.JoinedStr):
                    parts = (getattr(v, "value", "7") for v in said.values)
                    yield "".join(p if isinstance(p, str) else "7" for p in parts)
                    break
                if isinstance(said, ast.Constant) and said.value:
                    yield str(said.value)


def test_what_nodes_file_with_their_faults_is_told_in_german():
    german, told = words("de"), set(evidence_of_nodes())
    assert len(told) >= 9
    sentences = [t.removesuffix("; 7") for t in sorted(told)]
    assert [t for t in sentences if "lang=" in sentence(t, german)] == []
    full = "/bags/x: cannot be written: No space left on device: free some space"
    stops = sentence(f"recording stops: {full}", german)
    assert "lang=" not in stops
    assert "kein Platz mehr: Platz schaffen" in stops
    held = sentence("v_in = 1.2: must be a number from 0 to 1 [1]; limited", german)
    assert held == "v_in = 1.2: muss eine Zahl von 0 bis 1 [1] sein; begrenzt"


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


def test_a_drawing_for_a_phone_has_short_words_of_the_language():
    stamp_ns = np.arange(20, dtype=np.int64) * 10**8
    x = np.linspace(0.0, 1.0, 20)
    valid = np.full(20, Validity.VALID, dtype=np.uint8)
    prediction = Prediction(7, stamp_ns, x, x, x, 0.0 * x, 1e-3, valid)
    found = drawn(plot_cycle(prediction, narrow=True), words("de"))
    texts = re.findall(r"<text [^>]*>([^<]*[a-z]{3}[^<]*)<", found)
    assert "Residuum; Band: 2 erwartete Standardabweichungen" in texts
    assert max(map(len, texts)) < 50
    assert 'viewBox="0 0 560 ' in found


@pytest.mark.parametrize(
    ("page", "english", "german"),
    [
        ("<p>-25.1 % (-25.4 .. +0.3)</p>", "−25.1 % (−25.4 .. +0.3)", "−25,1 % (−25,4 .. +0,3)"),
        ("<p>leak -0.0 %, +0.0 %, 0 %</p>", "leak 0.0 %, 0.0 %, 0 %", "leak 0,0 %, 0,0 %, 0 %"),
        ("<p>p = 9.4e-84.</p>", "p = 9.4e−84.", "p = 9,4e−84."),
        ("<p>version 0.1.0, 2026-11-14, /v-1.5</p>",) + ("version 0.1.0, 2026-11-14, /v-1.5",) * 2,
        ('<svg d="M-1.5 2.5"/><b translate="no">-1.5</b>',) + ("-1.5",) * 2,
        ("<text>0.5</text>", "0.5", "0,5"),
    ],
)
def test_numbers_are_written_as_the_language_does(page, english, german):
    for language, text in (("en", english), ("de", german)):
        found = figures(page, language)
        assert re.sub("<[^>]*>", "", found) == text
        assert re.findall("<[^>]*>", found) == re.findall("<[^>]*>", page)


def test_the_words_in_the_cells_of_a_table_are_translated():
    german = words("de")
    made = Markup("steady<small>60 estimates</small>")
    assert cell(made, german) == "stabil<small>60 Schätzungen</small>"
    assert cell("<b>due</b>", german) == "&lt;b&gt;due&lt;/b&gt;"
    assert cell("due", german) == "fällig"
    assert cell("warning 0.5, warning in doubt", german) == "Warnung 0.5, Warnung ungewiss"
    assert cell("warning 0.5", german) == "Warnung 0.5"
    said = "46 … 57, bends (power), 12 % before the next stop"
    assert cell(said, german) == "46 … 57, biegt sich (power), 12 % vor dem nächsten Stillstand"
    assert cell(said.replace(", bends (power)", ""), german).endswith(
        "57, 12 % vor dem nächsten Stillstand"
    )
    assert cell(said.partition(", 12")[0], german) == "46 … 57, biegt sich (power)"
    assert cell(made, words("en")) == made


def trends() -> Iterator[Trend]:
    """Yield a trend for every outlook and for every way its level is told."""
    known = Trend(1, "/v", "K_in", "1/sample", "cycles", TrendStatus.DRIFTING, "why", 20, 1, 1.0,
                  20.0, level=0.012, reference=0.014, drift_reference=-14.0,
                  drift_reference_lower_95=-15.0, drift_reference_upper_95=-13.0,
                  mean_lower_95=0.011, mean_upper_95=0.013, p_value=1e-9)  # fmt: skip
    limited = replace(known, threshold=0.012)
    for trend in (
        replace(known, status=TrendStatus.NOT_ENOUGH_DATA),
        known,
        replace(limited, status=TrendStatus.BEYOND_THRESHOLD),
        replace(limited, unbounded=False, remaining_low=3.0, remaining_high=9.0),
        replace(limited, unbounded=False, bends=True, law="exponential", remaining_median=9.0),
        replace(limited, bends=True, law="power", remaining_low=30.0),
        replace(limited, remaining_low=0.0),
        replace(limited, remaining_low=30.0),
        limited,
    ):
        yield trend
        yield replace(trend, axis="hours", reference_source="commissioning")
        yield replace(trend, drift_reference=np.nan)
        yield replace(trend, share_lost=0.9)


def findings() -> Iterator[Finding]:
    """Yield every fault, with and without a size, alone and with what fits as well."""
    for name, kind in BY_NAME.items():
        for size, deviation in ((0.3, 5.0), (0.3, np.inf), (np.nan, np.nan), (2.0, 1e9)):
            found = Finding(name, (), kind.part, size, deviation, 9, 7)
            yield found
            other = partner(name)
            yield replace(found, rivals=("leak", "delay", *([other] if other else ())))
    yield Finding(UNKNOWN, (), "valve", np.nan, 6.0, 9, 7)


PARTS_OF_REASONS = {
    ": faster than the sampling shows": "rests on its bound 7: faster than the sampling shows",
    "the position never 7 by a fifth of its motion": (
        "the position never fell by a fifth of its motion"
    ),
    "7 runs from 7 to 7, it is to be 0 to 1: correct signals.7.scale (7) and .offset": (
        "x runs from 7 to 7, it is to be 0 to 1: correct signals.x.scale (0.01 for percent) and "
        ".offset"
    ),
    "nothing is commanded, 7 all the time: correct 7": (
        "nothing is commanded, u at 1 and v at 0 all the time: correct signals.u.topic and "
        "signals.v.topic"
    ),
    "7 (7 standard errors)": "K_in differs by 7 % at commands above 7 (7 standard errors)",
}
"""What stands in a reason and is none alone, with the whole."""


def is_german(text: str) -> bool:
    """Return whether nothing of a sentence stayed English."""
    said = sentence(text, words("de"))
    return said != text and "<span" not in said


def test_what_a_verdict_says_is_translated_with_its_figures():
    judged = partial(decide, config=AgingConfig(), valve="/v", stamp_ns=1, cycle=20)
    given = replace(next(trends()), reason="3 of 10 estimates since the segment began")
    said = [judged([t]).evidence for t in (given, *trends())]
    said += [describe_finding(found) for found in findings()]
    said += [describe_finding(replace(found, severity=math.nan)) for found in findings()]
    over = [Diagnosis((replace(f, end=20),), 20, ready=True) for f in findings()]
    said += [lately_over(found, 20) for found in over]
    said += [judged([t], fault=f).evidence
             for t, f in zip(trends(), findings(), strict=False)]  # fmt: skip
    said += [f"valve: {text}" for text in said]
    said += [judged([]).evidence, WAITING]
    hidden = [f"{BY_NAME[fault].text} below 0.4 s ({shown})" for fault, shown in SHOWN_BY.items()]
    hidden += [f"{BY_NAME[fault].text} ({shown})" for fault, shown in SHOWN_BY.items()]
    said += [f"what these cycles do not show: {', '.join(hidden[k:][:1 + k % 3])}"
             for k in range(len(hidden))]  # fmt: skip
    fine = replace(given, status=TrendStatus.STEADY, threshold=0.02)
    said += [held_back(judged([fine]), off).evidence for off in (5.2, 1e3)]
    odd = "cycle 7 shows what no sound valve does"
    said += [held_back(judged([fine]), 0.0, odd=f"{odd} ({t})").evidence
             for t in ("grown dead band", "freezing position sensor")]  # fmt: skip
    assert all(text.startswith("not yet judged") for text in said[-4:])
    assert len(set(said)) > 300
    assert [text for text in said if not is_german(text)] == []
    text = "K_in -14.0 % of new (95 %: -15.0 .. -13.0), 6 cycles left (3 .. 9)"
    german = "K_in -14.0 % gegen neu (95 %: -15.0 .. -13.0), noch 6 Zyklen (3 .. 9)"
    assert sentence(text, words("de")) == german
    assert sentence(text, words("en")) == text


def on_the_report(text: str) -> str:
    """Return a text as the German report page tells it."""
    return whole_page(f"<p>{Markup.escape(text)}</p>", "de").split("<p>")[1].split("</p>")[0]


def is_english(text: str) -> bool:
    """Return whether a clause stays English on the report page."""
    clauses = [clause for clause in text.split("; ") if re.search("[A-Za-z]{3}", clause)]
    found = [(clause, on_the_report(clause)) for clause in clauses]
    return any("<span" in told or told == str(Markup.escape(said)) for said, told in found)


def test_all_that_an_advice_says_is_german_on_the_report():
    advices = [*FAULT_ADVICE.values(), *BY_VERDICT.values()]
    trend = replace(next(trends()), status=TrendStatus.BEYOND_THRESHOLD, threshold=0.012)
    verdict = decide([trend], AgingConfig(), valve="/v", stamp_ns=1, cycle=20)
    worn = advise(replace(verdict, kind=VerdictKind.VALVE, fault="K_in"), [trend])
    advices.append(worn)
    told = {f"probably {a.cause}" for a in advices if a.cause}
    told |= {a.cause for a in advices if a.cause} | {a.part for a in advices if a.part}
    told |= {f"{code} {mode} (ISO 14224)" for code, mode in FAILURE_MODES.items()}
    told |= {f"NE 107: {state.value}" for state in Ne107} | {a.sentence for a in advices}
    told |= {a.action for a in advices} | {replace(a, urgency=NOW).sentence for a in advices}
    told -= {""}
    assert "probably set or broken spring, changed return pressure" in told
    assert worn.cause == "wear or dirt that changes K_in"
    assert len(told) > 140
    assert [text for text in sorted(told) if is_english(text)] == []
    said = "NE 107: maintenance required; PDE parameter deviation (ISO 14224); probably "
    assert on_the_report(said + FAULT_ADVICE["preload"].cause) == (
        "NE 107: Wartungsbedarf; PDE Parameterabweichung (ISO 14224); "
        "wahrscheinlich gesetzte oder gebrochene Feder, veränderter Rücklaufdruck"
    )


def test_faults_and_what_shows_them_are_german_on_the_report():
    told = {*SHOWN_BY.values(), *PARTS, *(kind.text for kind in FAULT_TYPES)}
    told |= {
        f"the data fit as well: grown delay: {shown} to tell the two" for shown in PAIRS.values()
    }
    assert len(told) > 35
    assert [text for text in sorted(told) if is_english(text)] == []
    found = Finding("slow", ("lost_motion", "delay"), "valve", 0.3, 5.0, 9, 7)
    verdict = decide([], AgingConfig(), valve="/v", stamp_ns=1, cycle=20)
    shown = Assessment((), verdict, (), Diagnosis((found,), 20, ready=True))
    section = whole_page(faults_section(shown), "de")
    assert '<th scope="col">Oder</th>' in section
    assert "<td>Umkehrspiel, Anteil des Wegs<br>gewachsene Totzeit</td>" in section


REASONS = ("Refusal", "Guard", "ParameterValue", "blank", "not_excited", "at_bound", "conclude")
"""What carries a reason to the pages."""

NO_REASON = ("bench_fits", "check", "plant", "published", "interface")
"""Modules whose texts go elsewhere: to a terminal, a simulation, a parameter."""


def phrase(node: ast.expr) -> str:
    """Return the text of an expression, 7 for what differs; empty = none."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else ""
    parts = node.values if isinstance(node, ast.JoinedStr) else ()
    return "".join(str(p.value) if isinstance(p, ast.Constant) else "7" for p in parts)


def phrases(node: ast.AST) -> Iterator[str]:
    """Yield the whole texts below a node, but none of an error, and no docstring."""
    if isinstance(node, ast.JoinedStr | ast.Constant):
        yield phrase(node)
    elif not isinstance(node, ast.Raise) and not (
        isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    ):
        for child in ast.iter_child_nodes(node):
            yield from phrases(child)


def reasons_of(text: str) -> set[str]:
    """Return what a module calls reasons: what it gives to `REASONS`, and what it returns."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        called = isinstance(node, ast.Call) and getattr(node.func, "id", "") in REASONS
        named = isinstance(node, ast.Assign) and any(
            getattr(target, "id", "") in ("reason", "text", "why") for target in node.targets
        )
        if called or named or isinstance(node, ast.Return):
            found |= set(phrases(node))
    return {f for f in found if " " in f.strip() and len(re.findall("[A-Za-z]{2,}", f)) > 1}


def test_why_nothing_is_told_is_german_on_the_report():
    folder = Path(valve_twin.core.valves.__file__).parent
    paths = [*folder.rglob("*.py"), *(folder.parent / "estimation").rglob("*.py")]
    told = {
        reason
        for path in paths
        if path.stem not in NO_REASON
        for reason in reasons_of(path.read_text(encoding="utf-8"))
    }
    told |= {closing.value for closing in Closing}
    assert "7 usable samples, 7 needed" in told
    assert len(told) > 120
    assert sorted(reason for reason in told - set(PARTS_OF_REASONS) if is_english(reason)) == []
    assert [reason for reason in PARTS_OF_REASONS.values() if is_english(reason)] == []


def test_what_is_to_be_done_is_translated():
    advices = [a.sentence for a in (*FAULT_ADVICE.values(), *BY_VERDICT.values()) if a.sentence]
    assert len(advices) > 25
    assert [text for text in advices if not is_german(text)] == []
    leak = FAULT_ADVICE["leak"].sentence
    german = "Sitz und Dichtungen der Kammer: spülen, dann Sitz und Dichtungen prüfen"
    assert sentence(leak, words("de"), begins=True) == f"{german}, beim nächsten Stillstand"
    assert sentence(leak, words("en"), begins=True) == "S" + leak[1:]


def test_the_description_of_every_parameter_is_translated():
    told = {p.description for name in model_names() for p in get_model(name).parameters}
    assert len(told) > 150
    german = words("de").sentences
    missing = [text for text in told if text not in german and not is_german(text)]
    assert missing == []


def test_what_is_not_known_stays_english_and_says_so():
    german = words("de")
    assert sentence("mend the seat or <b>: now", german) == (
        '<span lang="en">mend the seat or &lt;b&gt;: now</span>'
    )
    text = "the newest 5 cycles gave no estimate: the moon is full"
    part = '<span lang="en">the moon is full</span>'
    assert sentence(text, german) == f"die neuesten 5 Zyklen ergaben keine Schätzung: {part}"
    hostile = "a: {0}{x} " * 2000
    begun = time.thread_time()
    assert "{0}{x}" in sentence(hostile, german)
    assert "a: a" in sentence("a: " * 190, german)
    assert time.thread_time() - begun < 1.0


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


def test_a_whole_report_is_translated_and_says_so():
    page = (
        '<!DOCTYPE html><html lang="en"><title>Valve report /a</title><style>b{x:1}</style>'
        "<b>The valve needs attention</b><p>: no significant slope in 46 estimates (p = 0.7)</p>"
        "<p>NE 107: out of specification; PDE parameter deviation (ISO 14224)</p>"
        "<p>Pilot stage: clean it or renew it.</p><td>spring &lt;renewed&gt; by Anna</td>"
        '<svg aria-label="K_in over cycle">'
        '<text x="1">time since the start of the cycle [s]</text>'
    )
    found = whole_page(Markup(page), "de")
    for part in (
        '<html lang="de">',
        "<title>Ventilbericht /a</title><style>b{x:1}</style>",
        "<b>Am Ventil ist etwas zu tun</b>",
        "<p>: keine signifikante Steigung in 46 Schätzungen (p = 0.7)</p>",
        "<p>NE 107: außerhalb der Spezifikation; PDE Parameterabweichung (ISO 14224)</p>",
        "<td>spring &lt;renewed&gt; by Anna</td>",
        '<text x="1">Zeit seit Beginn des Zyklus [s]</text>',
    ):
        assert part in found
    assert whole_page(page, "en") == page
    assert (language_of(page), language_of(found), language_of("")) == ("en", "de", "en")


def test_what_a_user_wrote_is_not_told_in_another_language():
    page = '<h1 translate="no">cycle</h1><td>good</td><td translate="no">good</td>'
    assert whole_page(page, "de") == page.replace("<td>good", "<td>gut")


def test_no_file_of_words_has_an_original_twice(root):
    folder = root / "valve_twin" / "report" / "language" / "locale"
    for path in sorted(folder.glob("*.po")):
        originals = re.findall(r"^msgid (.+)$", path.read_text(encoding="utf-8"), re.M)
        twice = {text for text in originals if originals.count(text) > 1}
        assert originals, path.name
        assert not twice, path.name
