# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Who knows the password comes in; who guesses is refused unheard for a while."""

from __future__ import annotations

import pytest

from valve_twin.gateway.passwords import PAUSE_S, TRIES, Passwords, read_users, user_line
from valve_twin.io.errors import ConfigError

RIGHT = "correct horse"


@pytest.fixture
def users(tmp_path):
    path = tmp_path / "users"
    path.write_text(f"# plant\n{user_line('anna', RIGHT)}\n\n", encoding="utf-8")
    return read_users(path)


def test_a_file_of_users_holds_no_password(users):
    assert set(users) == {"anna"}
    assert RIGHT not in str(users)
    assert user_line("anna", RIGHT) != user_line("anna", RIGHT)  # salted


def test_who_guesses_is_refused_unheard_for_a_while(users):
    now = 0.0
    said: list[str] = []
    door = Passwords(users, said.append, clock=lambda: now)
    assert door.fits("anna", RIGHT)
    for _ in range(1000):
        assert not door.fits("anna", "guess")
    assert len(said) == 1
    assert not door.fits("anna", RIGHT)
    now = PAUSE_S
    assert door.fits("anna", RIGHT)


def test_a_name_that_does_not_exist_does_not_shut_out_one_that_does(users):
    door = Passwords(users, lambda _: None, clock=lambda: 0.0)
    for number in range(2 * TRIES):
        assert not door.fits(f"user {number}", RIGHT)
    assert door.fits("anna", RIGHT)


@pytest.mark.parametrize("line", ["anna", "anna:00:00", ":" + "0" * 32 + ":" + "0" * 128])
def test_a_line_that_is_none_of_a_user_is_named(tmp_path, line):
    path = tmp_path / "users"
    path.write_text(f"# first\n{line}\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="line 2 is none of a user"):
        read_users(path)


@pytest.mark.parametrize(("name", "password"), [("a:b", RIGHT), ("", RIGHT), ("anna", "short")])
def test_a_bad_name_or_short_password_is_refused(name, password):
    with pytest.raises(ConfigError, match="user"):
        user_line(name, password)
