# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A report as it is served."""

import pytest

from valve_twin.gateway.page.filed import served_report
from valve_twin.gateway.pages import Visitor

PAGE = """<!DOCTYPE html>
<html lang="en"><head><title>x</title></head><body><main><h2>Remaining life</h2>
<p>From 2026-11-26 14:27:01 UTC, -0.5 %, written 2026-11-26 14:29 UTC</p>
<svg><text>2026-11-26 14:27:01 UTC</text></svg></main></body></html>"""


@pytest.mark.parametrize(
    ("language", "word", "figure"), [("en", "Remaining life", "−0.5 %"), ("de", "Rest", "−0,5 %")]
)
def test_it_speaks_the_visitors_language(language, word, figure):
    found = served_report(PAGE, "/press/valve_1", Visitor(language, "../../"))
    assert f'<html lang="{language}">' in found
    assert word in found
    assert figure in found


def test_it_leads_back_to_the_page_of_its_valve_by_any_prefix():
    found = served_report(PAGE, '/press/<b>"', Visitor("en", "../../"))
    assert '<a href="../../valve/press/%3Cb%3E%22" translate="no">' in found
    assert "<b>&#34;" not in found


def test_its_times_are_put_into_the_viewers_zone():
    found = served_report(PAGE, "/v", Visitor())
    assert '<time datetime="2026-11-26T14:27:01Z">2026-11-26 14:27:01 UTC</time>' in found
    assert '<time datetime="2026-11-26T14:29Z">' in found
    assert "<text>2026-11-26 14:27:01 UTC</text>" in found
