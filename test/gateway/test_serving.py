# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Where the pages are served: what cannot be is one line, what everybody can see is told."""

from __future__ import annotations

import io
import sys

import pytest

pytest.importorskip("cryptography", reason="needs the extra gateway")

from test.gateway.page.test_forms import make_pair
from valve_twin.cli import main
from valve_twin.gateway.passwords import read_users
from valve_twin.gateway.serving import Place, check_pair, check_place, listen
from valve_twin.io.errors import ConfigError


def refusal(*given: str) -> str:
    with pytest.raises(ConfigError) as caught:
        check_pair(*given)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_a_pair_that_browsers_would_not_take_is_refused_in_a_line(tmp_path):
    certificate, key = make_pair(tmp_path / "a")
    check_pair(certificate, key)
    other = make_pair(tmp_path / "b")
    assert f"{other[1]}: is no key" in refusal(certificate, other[1])
    old = make_pair(tmp_path / "c", days=-1)
    assert f"{old[0]}: holds from" in refusal(*old)
    early = make_pair(tmp_path / "d", days=30)
    assert f"{early[0]}: holds from" in refusal(*early)
    assert "is no certificate (PEM)" in refusal(key, key)
    missing = str(tmp_path / "none.pem")
    assert refusal(missing, key) == f"{missing}: cannot be read: No such file or directory"
    assert refusal(certificate, missing).startswith(missing)


def test_who_can_look_on_is_told_and_passwords_do_not_go_in_the_clear(tmp_path):
    certificate, key = make_pair(tmp_path)
    for host in ("127.0.0.1", "localhost", "::1"):
        assert check_place(Place(host), accounts=True) == ""
    for host in ("0.0.0.0", "::", "192.168.0.7", "plant.example"):
        assert "without TLS" in check_place(Place(host), accounts=False)
        with pytest.raises(ConfigError, match="in the clear"):
            check_place(Place(host), accounts=True)
        assert check_place(Place(host, 0, certificate, key), accounts=True) == ""
    with pytest.raises(ConfigError, match="the key is missing"):
        check_place(Place(certificate=certificate), accounts=False)
    with pytest.raises(ConfigError, match="the certificate is missing"):
        check_place(Place(key=key), accounts=False)
    with pytest.raises(ConfigError, match="choose another port or host"):
        listen(Place("256.1.1.1"))


def test_a_user_is_added_with_a_password_that_no_list_of_processes_shows(
    tmp_path, monkeypatch, capsys
):
    users = tmp_path / "users"
    command = ["serve", "--users", str(users), "--add-user"]
    monkeypatch.setattr(sys, "stdin", io.StringIO("correct horse\nmore\n"))
    assert main([*command, "anna"]) == 0
    assert set(read_users(users)) == {"anna"}
    assert "correct horse" not in users.read_text()
    assert users.stat().st_mode & 0o077 == 0
    monkeypatch.setattr(sys, "stdin", io.StringIO("correct horse\n"))
    assert main([*command, "anna"]) == 1
    monkeypatch.setattr(sys, "stdin", io.StringIO("short\n"))
    assert main([*command, "bert"]) != 0
    assert main(["serve", "--add-user", "bert"]) == 2
    assert "needs --users FILE" in capsys.readouterr().err
    assert set(read_users(users)) == {"anna"}
