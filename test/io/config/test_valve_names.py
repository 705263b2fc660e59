# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Fifty valves are configured in three lines; one that is wrong does not stop the others."""

from __future__ import annotations

import pytest

from valve_twin.io.config.valve import load_config, parse_config
from valve_twin.io.config.valve_names import expand_names
from valve_twin.io.errors import ConfigError

FLEET = """\
/**:
  ros__parameters:
    valves: ["press/valve_{01..50}"]
    period_s: 0.02
    press/valve_07:
      period_s: 0.05
"""


def test_a_range_is_written_out_with_its_leading_zeros():
    assert expand_names(["a_{08..11}"]) == ("a_08", "a_09", "a_10", "a_11")
    assert expand_names(["a_{8..11}"]) == ("a_8", "a_9", "a_10", "a_11")
    assert expand_names(["", "spare", "x_{1..2}"]) == ("spare", "x_1", "x_2")


def test_two_ranges_give_every_pair():
    assert expand_names(["p{1..2}/v{1..2}"]) == ("p1/v1", "p1/v2", "p2/v1", "p2/v2")


@pytest.mark.parametrize("name", ["v_{9..2}", "v_{1..5000}"])
def test_a_range_that_cannot_be_meant_is_refused(name):
    with pytest.raises(ValueError, match="first <= last"):
        expand_names([name])


def test_too_many_valves_are_refused():
    with pytest.raises(ValueError, match="more than 1000 valves"):
        expand_names(["v{1..100}/w{1..100}"])


def test_fifty_valves_share_one_block_and_one_has_its_own(tmp_path):
    path = tmp_path / "fleet.yaml"
    path.write_text(FLEET, encoding="utf-8")
    configs = load_config(path)
    assert [c.name for c in configs] == [f"/press/valve_{n:02d}" for n in range(1, 51)]
    assert {c.name: c.period_s for c in configs if c.period_s != 0.02} == {"/press/valve_07": 0.05}
    assert configs[3].signals["v_in"].topic == "/press/valve_04/command/v_in"


def test_a_wrong_valve_is_left_out_and_named_where_that_is_wanted():
    flat = {"valves": ["a", "b"], "b.period_s": -1.0}
    with pytest.raises(ConfigError, match=r"key 'b\.period_s'"):
        parse_config(flat, "file.yaml")
    refused: dict[str, str] = {}
    (only,) = parse_config(flat, "file.yaml", refused=refused)
    assert only.name == "/a"
    assert "key 'b.period_s'" in refused["/b"]


def test_a_file_without_any_usable_valve_is_an_error():
    flat = {"valves": ["a", "b"], "b.period_s": -1.0, "a.model": "gone"}
    with pytest.raises(ConfigError, match="'gone' is unknown"):
        parse_config(flat, "file.yaml", refused={})
