# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import time

from valve_twin.core.quantity import suggest


def test_the_nearest_name_is_suggested():
    assert suggest("perid_s", ["period_s", "model"]) == "did you mean 'period_s'?"


def test_where_none_is_near_the_first_are_listed():
    assert suggest("x", ["alpha", "beta"]) == "there are alpha, beta"
    assert suggest("x", [f"name_{n}" for n in range(20)], shown=2).endswith("and 18 more")
    assert suggest("x", []) == "there are none"


def test_many_that_ask_again_do_not_search_again():
    """A twin of 50 valves that is started before its plant asks for 250 topics every second."""
    known = [f"/plant/valve_{i}/{t}" for i in range(50) for t in ("position", "command/v_in")]
    wrong = [f"/sim{name}" for name in known]
    first, again = (_seconds(lambda: [suggest(n, known) for n in wrong]) for _ in range(2))
    assert again < first / 10


def _seconds(run) -> float:
    begun = time.thread_time()
    run()
    return time.thread_time() - begun
