# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Who knows the password comes in; who guesses is refused unheard for a while."""

from __future__ import annotations

import pytest

from valve_twin.gateway.passwords import (
    MOST_PLACES,
    PAUSE_S,
    TRIES,
    Passwords,
    read_users,
    user_line,
)
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


def test_who_guesses_somewhere_does_not_shut_out_its_owner_elsewhere(users):
    said: list[str] = []
    door = Passwords(users, said.append, "page", clock=lambda: 0.0)
    for _ in range(3 * TRIES):
        assert not door.fits("anna", "guess", "10.0.0.9")
    assert not door.fits("anna", RIGHT, "10.0.0.9")
    assert door.fits("anna", RIGHT, "10.0.0.7")
    assert said == ["page: 5 wrong passwords of user anna from 10.0.0.9: refused for 30 s"]


def test_a_network_of_ipv6_is_one_place_and_a_mapped_address_that_of_ipv4(users):
    door = Passwords(users, lambda _: None, clock=lambda: 0.0)
    for number in range(TRIES):
        assert not door.fits("anna", "guess", f"2001:db8:0:1::{number + 1}")
    assert not door.fits("anna", RIGHT, "2001:db8:0:1:ffff::7")
    assert door.fits("anna", RIGHT, "2001:db8:0:2::1")
    for _ in range(TRIES):
        assert not door.fits("anna", "guess", "::ffff:10.0.0.9")
    assert not door.fits("anna", RIGHT, "10.0.0.9")


def test_places_are_bounded(users, monkeypatch):
    monkeypatch.setattr("valve_twin.gateway.passwords._COST", {"n": 2, "r": 1, "p": 1})
    door = Passwords(users, lambda _: None, clock=lambda: 0.0)
    for number in range(MOST_PLACES + 50):
        assert not door.fits("anna", "guess", f"10.0.{number // 250}.{number % 250}")
    assert len(door._wrong) == MOST_PLACES
