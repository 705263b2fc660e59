# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Sessions: for who knows the password, for a shift, and not without bound."""

from __future__ import annotations

import threading
import tracemalloc

import pytest

from valve_twin.gateway.page.accounts import MOST_SESSIONS, SESSION_S, Accounts
from valve_twin.gateway.passwords import PAUSE_S, user_line
from valve_twin.io.errors import ConfigError

RIGHT = "correct horse"


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def path(tmp_path):
    made = tmp_path / "users"
    made.write_text(user_line("anna", RIGHT) + "\n", encoding="utf-8")
    return made


def test_a_session_is_of_who_knows_the_password_and_ends(path):
    clock = Clock()
    accounts = Accounts(str(path), lambda _: None, clock)
    assert accounts.enter("anna", "wrong") == ""
    cookie = accounts.enter("anna", RIGHT)
    session = accounts.session(cookie)
    assert session is not None
    assert session.user == "anna"
    assert session.owns(session.token)
    assert not session.owns("")
    assert not session.owns("\N{SNOWMAN}")
    clock.now += SESSION_S - 1.0
    assert accounts.session(cookie) is session
    clock.now += SESSION_S + 1.0
    assert accounts.session(cookie) is None
    again = accounts.enter("anna", RIGHT)
    assert again != cookie
    accounts.leave(again)
    assert accounts.session(again) is None


def test_a_thousand_guesses_of_users_that_do_not_exist_are_one_line_and_little_memory(path):
    said: list[str] = []
    accounts = Accounts(str(path), said.append, Clock())
    accounts.enter("nobody", "warm")
    tracemalloc.start()
    begun = tracemalloc.get_traced_memory()[0]
    for number in range(1000):
        assert accounts.enter(f"guess {number} " + "x" * 500, "guess") == ""
    grown = tracemalloc.get_traced_memory()[0] - begun
    tracemalloc.stop()
    assert grown < 50_000
    (line,) = said
    assert (
        line == f"page: 5 wrong passwords of users that do not exist: refused for {PAUSE_S:.0f} s"
    )
    assert accounts.enter("anna", RIGHT)
    assert accounts.enter("x" * 2000, "x") == ""


def test_who_is_added_may_come_in_and_who_is_removed_may_not(path):
    accounts = Accounts(str(path), lambda _: None, Clock())
    path.write_text(user_line("bert", RIGHT) + "\n", encoding="utf-8")
    assert accounts.enter("bert", RIGHT)
    assert not accounts.enter("anna", RIGHT)
    path.unlink()
    with pytest.raises(ConfigError, match="cannot be read"):
        accounts.enter("bert", RIGHT)


def test_sessions_are_bounded(path, monkeypatch):
    monkeypatch.setattr("valve_twin.gateway.passwords._COST", {"n": 2, "r": 1, "p": 1})
    path.write_text(user_line("anna", RIGHT) + "\n", encoding="utf-8")
    accounts = Accounts(str(path), lambda _: None, Clock())
    cookies = [accounts.enter("anna", RIGHT) for _ in range(MOST_SESSIONS + 3)]
    alive = [c for c in cookies if accounts.session(c)]
    assert alive == cookies[3:]


def test_a_page_that_asks_anew_by_itself_keeps_no_session_alive(path):
    clock = Clock()
    accounts = Accounts(str(path), lambda _: None, clock)
    cookie = accounts.enter("anna", RIGHT)
    for _ in range(3):
        clock.now += 0.4 * SESSION_S
        found = accounts.session(cookie, used=False)
    assert found is None


def test_a_session_ends_with_its_user_or_his_password(path):
    accounts = Accounts(str(path), lambda _: None, Clock())
    cookie = accounts.enter("anna", RIGHT)
    assert accounts.still(cookie) is accounts.session(cookie)
    path.write_text(user_line("anna", "another password") + "\n", encoding="utf-8")
    assert accounts.still(cookie) is None
    assert accounts.session(cookie) is None
    cookie = accounts.enter("anna", "another password")
    path.write_text("", encoding="utf-8")
    assert accounts.still(cookie) is None


def test_a_guess_that_takes_long_keeps_no_page_waiting(path, monkeypatch):
    accounts = Accounts(str(path), lambda _: None, Clock())
    cookie = accounts.enter("anna", RIGHT)
    inside, go_on = threading.Event(), threading.Event()

    def slow(*_: object) -> bool:
        inside.set()
        return not go_on.wait(60.0)

    monkeypatch.setattr(accounts._passwords, "fits", slow)
    guess = threading.Thread(target=accounts.enter, args=("anna", "guess"))
    guess.start()
    assert inside.wait(60.0)
    assert accounts.session(cookie) is not None  # would wait for the guess
    assert guess.is_alive()
    go_on.set()
    guess.join(60.0)
