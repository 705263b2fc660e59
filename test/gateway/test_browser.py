# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The pages of a history in a real browser: every width, dark and light, keyboard, paper."""

from __future__ import annotations

import re
import sqlite3
import zlib
from contextlib import closing
from urllib.parse import quote

import pytest

from test.gateway.chromium import Browser
from test.gateway.test_web import HOSTILE, Server, store
from test.io.history.test_fleet import START_NS, estimate, record
from valve_twin.core.operation.events import Event
from valve_twin.core.types import Maintenance
from valve_twin.io.history.database import Database
from valve_twin.io.history.insert import Insert
from valve_twin.io.history.store import History
from valve_twin.io.history.tables import CYCLE, ESTIMATE, estimate_row, to_row
from valve_twin.io.history.valves.names import key_of

WORN, LONG = "/press/worn", "/press/line_12/valve_number_00"
PAGES = ("/", f"/valve{WORN}", f"/cycles{WORN}", f"/report{WORN}")
WIDTHS = (320, 390, 1400, 2560)
A4, TAB, ENTER = 700, 9, 13
CYCLES = 10_000
EVIL = '<img src=x onerror=alert(1)><script>alert(2)</script>" onfocus="alert(3)'

CONTRASTS = """(() => {
  const light = (c) => c.map((v) => v / 255)
    .map((v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const parts = (text) => text.match(/[\\d.]+/g).map(Number);
  const ground = (at) => {
    for (; at; at = at.parentElement) {
      const found = parts(getComputedStyle(at).backgroundColor);
      if (found.length < 4 || found[3] > 0) return found.slice(0, 3);
    }
    return [255, 255, 255];
  };
  const found = {};
  const kinds = ".sign, p, td, th, small, dd, dt, a, b, h1, h2, li";
  for (const at of document.querySelectorAll(kinds)) {
    if (!at.innerText?.trim() || !at.offsetParent) continue;
    const both = [parts(getComputedStyle(at).color).slice(0, 3), ground(at)].map(light);
    const ratio = (Math.max(...both) + 0.05) / (Math.min(...both) + 0.05);
    found[`${at.tagName}.${at.className}`] = ratio;
  }
  return found;
})()"""
"""Contrast of letters on their ground by kind, after WCAG 2.1."""


def fill(path, valve: str, cycles: int) -> None:
    """Store very many cycles in one transaction."""
    with closing(Database(str(path))) as database, database.write() as connection:
        number = key_of(connection, valve, database.where)
        cycle, estimates = Insert(database, CYCLE), Insert(database, ESTIMATE)
        for n in range(1, cycles + 1):
            values = {"K_in": 0.01 * (1 + 0.003 * (-1) ** n), "K_out": 0.045, "leak": 1e-3}
            cycle(connection, [to_row(record(n), number)])
            estimates(connection, [estimate_row(number, 0, estimate(n, values))])


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    path = tmp_path_factory.mktemp("pages") / "history.sqlite"
    store(path, WORN, range(1, 61), -0.0045)
    store(path, HOSTILE, range(1, 3), 0.0)
    with History(path) as history:
        history.add_maintenance(HOSTILE, Maintenance(START_NS, 2, EVIL))
        history.log.add(HOSTILE, Event(START_NS, 2, "x.y", "failure", EVIL))
    fill(path, LONG, CYCLES)
    made = Server(path)
    yield made
    assert made.end() == 0


@pytest.fixture(scope="module")
def browser(server, tmp_path_factory):
    made = Browser(tmp_path_factory.mktemp("browser") / "profile")
    yield made
    try:
        assert made.complaints() == []
        asked = {"/".join(address.split("/")[:3]) for address in made.asked()}
        assert asked == {server.address}
    finally:
        made.close()


def shown(browser, server, page: str) -> None:
    """Open a page in English and wait until it is whole."""
    browser.open(f"{server.address}{page}?lang=en")
    browser.wait_for("!document.body.innerText.includes('being drawn')")


@pytest.mark.parametrize("page", PAGES)
def test_no_page_is_wider_than_its_screen(server, browser, page):
    shown(browser, server, page)
    for width in WIDTHS:
        browser.resize(width, 800)
        assert browser.run("document.documentElement.scrollWidth") <= width, width
    browser.resize(2560, 800)
    if not page.startswith("/report"):
        assert browser.run("document.querySelector('main').clientWidth") > 0.9 * 2560


@pytest.mark.parametrize("page", PAGES[:3])
def test_letters_are_read_in_dark_and_light(server, browser, page):
    shown(browser, server, page)
    grounds = []
    for dark in (False, True):
        browser.resize(1400, 800, dark=dark)
        faint = {k: v for k, v in browser.run(CONTRASTS).items() if v < 4.5}
        assert faint == {}
        ground = "getComputedStyle(document.querySelector('main')).backgroundColor"
        grounds.append(browser.run(ground))
    assert grounds == ["rgb(255, 255, 255)", "rgb(28, 33, 38)"]


def test_rows_grow_with_the_screen_and_names_break_between_their_parts(server, browser):
    shown(browser, server, "/")
    size = "parseFloat(getComputedStyle(document.querySelector('.fleet th a')).fontSize)"
    sizes = []
    for width in (1400, 2560):
        browser.resize(width, 800)
        sizes.append(browser.run(size))
    assert sizes[1] > 2.0 * sizes[0]
    lines = browser.run(
        """[...document.querySelectorAll('.fleet .state')].map((cell) => {
          const words = document.createRange(); words.selectNode(cell.childNodes[1]);
          return [words.getBoundingClientRect().left,
            cell.querySelector('small').getBoundingClientRect().left];
        })"""
    )
    assert len(lines) == 3
    assert all(abs(word - verdict) < 2.0 for word, verdict in lines), lines
    browser.resize(1400, 800)
    rows = browser.run(f"""[...document.querySelectorAll('.fleet th a')]
        .find((a) => a.textContent === {LONG!r}).innerHTML""")
    assert rows == "/<wbr>press/<wbr>line_12/<wbr>valve_number_00"
    height = f"""[...document.querySelectorAll('.fleet th a')]
        .find((a) => a.textContent === {LONG!r}).getClientRects().length"""
    assert browser.run(height) <= 3


def test_a_time_in_a_table_stays_on_its_line_and_every_cell_of_a_phone_is_named(server, browser):
    """Dates took four lines at the widest screens; on a phone intervals stood without a word."""
    for page in ("/", f"/valve{quote(HOSTILE)}"):
        shown(browser, server, page)
        for width in (1400, 2560):
            browser.resize(width, 800)
            lines = browser.run(
                "[...document.querySelectorAll('td time')].map((t) => t.getClientRects().length)"
            )
            assert lines
            assert set(lines) == {1}
    shown(browser, server, f"/cycles{WORN}")
    browser.resize(390, 800)
    named = browser.run(
        "[...document.querySelectorAll('td')].map((c) => getComputedStyle(c, '::before').content)"
    )
    assert {name.replace('"', "").strip() for name in named} == {"Value", "95 % interval"}


def test_what_somebody_called_a_valve_or_wrote_runs_no_script(server, browser):
    hook = "window.ran = 0; window.alert = () => { window.ran += 1; };"
    made = browser.call("Page.addScriptToEvaluateOnNewDocument", source=hook)
    name = quote(HOSTILE)
    for page in ("/", f"/valve{name}", f"/cycles{name}", f"/report{name}"):
        shown(browser, server, page)
        assert HOSTILE in browser.run("document.body.textContent")
        assert browser.run("[window.ran, document.images.length]") == [0, 0]
    shown(browser, server, f"/valve{name}")
    assert browser.run("document.body.textContent").count(EVIL) == 3  # note, its event, event
    browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=made["identifier"])


def test_the_keyboard_reaches_every_link_and_shows_where_it_is(server, browser):
    browser.resize(1400, 800)
    shown(browser, server, "/")
    links = set(browser.run("[...document.querySelectorAll('a')].map((a) => a.href)"))
    reached = set()
    for _ in range(2 * len(links)):
        browser.press("Tab", TAB)
        href, style, width, left = browser.run("""(() => { const at = document.activeElement;
            const style = getComputedStyle(at);
            return [at.href ?? "", style.outlineStyle, parseFloat(style.outlineWidth),
                    at.getBoundingClientRect().left]; })()""")
        if href:
            reached.add(href)
            assert (style, width >= 2.0, left >= 0.0) == ("solid", True, True), href
        if reached == links:
            break
    assert reached == links
    browser.run("document.querySelector('.fleet th a').focus()")
    browser.press("Enter", ENTER)
    browser.wait_for("location.pathname.startsWith('/valve/')")


@pytest.mark.parametrize("page", PAGES[:3])
def test_a_printed_page_is_a_table_on_white(server, browser, page):
    shown(browser, server, page)
    browser.paper(A4)
    style = "getComputedStyle(document.querySelector('{}')).{}"
    assert browser.run(style.format("body", "backgroundColor")) == "rgb(255, 255, 255)"
    if browser.run("Boolean(document.querySelector('thead'))"):
        assert browser.run(style.format("thead", "display")) == "table-header-group"
    for left_out in ("nav", "form"):
        there = f"[...document.querySelectorAll('{left_out}')]"
        assert browser.run(f"{there}.every((at) => !at.offsetParent)"), left_out
    made = browser.printed()
    assert made.startswith(b"%PDF-")
    across = re.search(rb"/MediaBox \[0 0 8[34]\d", made) is not None
    assert across == (page == "/")
    drawn = [zlib.decompressobj().decompress(part)
             for part in re.findall(rb"stream\r?\n(x.*?)endstream", made, re.DOTALL)]  # fmt: skip
    assert any(b" rg" in part for part in drawn)
    assert not any(re.search(rb"\.945\d* \.95\d* \.96\d* rg", part) for part in drawn)
    browser.resize(1400, 800)


def test_ten_thousand_cycles_open(server, browser):
    browser.resize(1400, 800)
    shown(browser, server, f"/valve{LONG}")
    browser.wait_for("document.querySelectorAll('path.trend').length >= 3")
    assert str(CYCLES) in browser.text(".facts")
    assert browser.run("document.querySelectorAll('*').length") < 1000
    assert browser.run("document.documentElement.outerHTML.length") < 500_000
    shown(browser, server, f"/cycles{LONG}")
    assert f"1 to {CYCLES}" in browser.text("main")


def test_a_locked_history_is_told_and_shown_again(tmp_path, browser):
    path = tmp_path / "history.sqlite"
    store(path, "/v", range(1, 3), 0.0)
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("PRAGMA journal_mode=DELETE")  # else a writer keeps no reader out
        server = Server(path)
        try:
            seen = len(browser.told)
            shown(browser, server, "/valve/v")
            other.execute("BEGIN EXCLUSIVE")
            told = "document.querySelector('.lost:not([hidden])')"
            browser.wait_for(f"{told}?.textContent.includes('locked')")
            assert "The history cannot be read now" in browser.text(".lost")
            assert browser.text("h1") == "/v"
            other.execute("ROLLBACK")
            browser.wait_for(f"!{told}")
            assert browser.complaints() == []
        finally:
            assert server.end() == 0
            del browser.told[seen:]  # the other server is none of those that may be asked
