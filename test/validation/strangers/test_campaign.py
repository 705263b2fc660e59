# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The campaign of strangers in short and in full: no figure falls behind the first table."""

import json

import pytest
from scipy.stats import binom

from valve_twin.cli.strangers import setup_of
from valve_twin.validation.strangers.campaign import SCORED_BASE, meet, pooled, seeds

SHORT_BASE, SHORT_COUNT = 960_003, 3
"""Seeds of the short form: neither scored in a table nor tuned on."""

CHANCE = 0.01
"""Of a figure of three strangers, were its share a table's; of independent cycles, assumed."""


@pytest.fixture(scope="module")
def committed(root):
    path = root / "docs" / "campaigns" / "strangers.json"
    return json.loads(path.read_text(encoding="utf-8"))


def share(shares, name):
    hits, cases = shares[name]
    return hits / cases


def test_a_seed_base_below_nothing_is_refused():
    with pytest.raises(ValueError, match="give a base of 0 or more"):
        seeds(-1, 3)


def test_the_first_table_is_of_the_frozen_seeds(committed):
    first = committed["first"]
    assert first["seeds"][0] == SCORED_BASE
    assert len(first["verdicts"]) == first["strangers"] >= 100


@pytest.mark.parametrize(
    ("name", "base", "count"),
    [
        ("thirteenth", 94_000, 400),
        ("fourteenth", 99_500, 200),
        ("sixteenth", 103_000, 200),
        ("eighteenth", 110_000, 200),
        ("nineteenth", 120_000, 100),
    ],
)
def test_the_newest_tables_are_of_lists_of_their_own(committed, name, base, count):
    newest = committed[name]
    assert newest["seeds"] == [base, base + count - 1]
    assert len(newest["verdicts"]) == newest["strangers"] == count
    assert share(newest["shares"], "not enough data") <= 0.05


@pytest.fixture(scope="module")
def short():
    return pooled(list(meet(seeds(SHORT_BASE, SHORT_COUNT), setup_of(None)))).shares


def test_the_short_form_is_better_than_the_first_table_beyond_chance(short, committed):
    first = committed["first"]["shares"]
    hits, cases = short["silent wrong"]
    assert binom.cdf(hits, cases, share(first, "silent wrong")) < CHANCE
    hits, cases = short["right part"]
    assert binom.sf(hits - 1, cases, share(first, "right part")) < CHANCE


@pytest.mark.parametrize(
    ("name", "table"),
    [
        ("silent wrong", "fourth"),
        ("flicker", "fourth"),
        # cycles of one press are not independent: one lasting false alarm is a third of all
        ("false alarm", "third"),
        ("not enough data", "third"),
    ],
)
def test_the_short_form_is_no_worse_than_a_table_beyond_chance(short, committed, name, table):
    hits, cases = short[name]
    assert binom.sf(hits - 1, cases, share(committed[table]["shares"], name)) > CHANCE


def test_the_short_form_finds_what_begins_late_and_is_never_silent_about_it(short):
    for name in ("frozen", "sensor_offset"):
        assert short[f"detected: {name}"] == [1, 1]
    for name in ("frozen", "sensor_offset", "supply_drop"):  # the last one: cycles 12 to 15
        assert short[f"silent wrong: {name}"][0] == 0


@pytest.fixture(scope="module")
def long():
    """Shares of all frozen seeds."""
    return pooled(list(meet(seeds(), setup_of(None)))).shares


@pytest.mark.slow
def test_the_long_form_is_better_than_the_first_table(long, committed):
    first = committed["first"]["shares"]
    for name in ("silent wrong", "false alarm", "flicker"):
        assert share(long, name) < share(first, name), name
    assert share(long, "right part") > share(first, "right part")


@pytest.mark.slow
def test_not_enough_data_is_said_in_at_most_5_percent(long):
    assert share(long, "not enough data") <= 0.05
