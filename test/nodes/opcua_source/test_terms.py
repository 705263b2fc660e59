# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A queue is short or not by what the server grants and by what is known of the rate."""

from __future__ import annotations

import math

from valve_twin.nodes.opcua_source.terms import Terms

NODES = ["i=1", "i=2"]


def test_where_no_rate_is_known_there_is_no_doubt():
    terms = Terms(0.0, 100, 50.0, {0: 1, 1: 1}, {0: 0.0, 1: 0.0})
    assert math.isinf(terms.wanted_ms())
    assert not terms.doubt(NODES)


def test_the_period_goes_before_what_the_server_says_that_it_looks():
    of_the_server = Terms(0.0, 100, 50.0, {0: 100, 1: 100}, {0: 1.0, 1: 4.0})
    assert of_the_server.wanted_ms() == 50.0
    assert not of_the_server.doubt(NODES)
    configured = Terms(0.0001, 100, 50.0, {0: 100, 1: 100}, {0: 1.0, 1: 4.0})
    assert math.isclose(configured.wanted_ms(), 5.0)


def test_a_short_queue_of_ours_is_told_to_be_raised():
    assert Terms(0.001, 40, 50.0, {0: 40}, {0: 0.0}).doubt(NODES) == (
        "the server keeps 40 samples of i=1, 40 ms at 1000 Hz, and sends every 50 ms: samples get "
        "lost where it is late: raise queue to 100"
    )
