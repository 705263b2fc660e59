# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Where two pages depart: section, figure and what stands in either."""

from valve_twin.report.provenance.page import page_differences

PAGE = (
    "<html><p>Valve 1</p><h2>Life</h2><td>12 %</td><h2>Figures</h2>"
    '<h3>K_in<small>gain</small></h3><svg><path d="M1 2"/></svg>'
    '<h3>K_out</h3><svg><path d="M3 4"/></svg></html>'
)


def test_equal_pages_have_no_difference():
    assert page_differences(PAGE, PAGE) == []


def test_names_section_and_both_texts():
    assert page_differences(PAGE, PAGE.replace("12 %", "13 %")) == [
        "page: section 'Life': 'Life 12 %' in the report, 'Life 13 %' made again"
    ]


def test_names_the_figure():
    (line,) = page_differences(PAGE, PAGE.replace("M3", "M5"))
    assert line.startswith("page: section 'Figures', figure 'K_out': ")
    (line,) = page_differences(PAGE, PAGE.replace("M1", "M5"))
    assert line.startswith("page: section 'Figures', figure 'K_in': ")


def test_names_every_section_that_differs_or_is_missing():
    other = PAGE.replace("Valve 1", "Valve 2").replace("<h2>Life</h2><td>12 %</td>", "")
    lines = page_differences(PAGE, f"{other}<h2>More</h2>")
    assert lines[0].startswith("page: head and verdict: ")
    assert lines[1:] == [
        "page: section 'Life': only in the report",
        "page: section 'More': only made again",
    ]
    (line,) = page_differences(PAGE, f"{PAGE} ")
    assert line.startswith("page: section 'Figures', figure 'K_out'")


def test_a_changed_order_is_a_difference():
    turned = "<h2>B</h2>x<h2>A</h2>x"
    assert page_differences("<h2>A</h2>x<h2>B</h2>x", turned) == [
        "page: its sections stand in another order"
    ]
