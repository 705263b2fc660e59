# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Marks and acknowledgements over HTTP: only with a session and its token, and kept with who."""

from __future__ import annotations

import http.client
import re
import ssl
import urllib.parse
from datetime import datetime, timedelta, timezone

import pytest

pytest.importorskip("starlette", reason="needs the extra gateway")

from test.gateway.test_web import Server, store
from valve_twin.core.operation.events import Event
from valve_twin.gateway.page.forms import inside
from valve_twin.gateway.passwords import user_line
from valve_twin.io.history.store import History

RIGHT = "correct horse"
COOKIE = re.compile(r"valve_twin_session=([^;]+); (.*)")


def make_pair(folder, days: int = 10):
    """Write a certificate of our own with its key; return both paths."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "localhost")])
    end = datetime.now(timezone.utc) + timedelta(days=days)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(1)
        .not_valid_before(end - timedelta(days=20))
        .not_valid_after(end)
        .sign(key, hashes.SHA256())
    )
    folder.mkdir(exist_ok=True)
    certificate, secret = folder / "certificate.pem", folder / "key.pem"
    certificate.write_bytes(made.public_bytes(serialization.Encoding.PEM))
    secret.write_bytes(
        key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )
    )
    return str(certificate), str(secret)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    made = tmp_path_factory.mktemp("forms") / "history.sqlite"
    store(made, "/press/one", range(1, 21), 0.0)
    with History(made) as history:
        history.log.add("/press/one", Event(10**18, 3, "x.y", "failure", "<b>stuck</b>"))
    return made


@pytest.fixture(scope="module")
def server(path):
    users = path.with_name("users")
    users.write_text(user_line("anna", RIGHT) + "\n", encoding="utf-8")
    certificate, key = make_pair(path.parent)
    made = Server(
        path, "--users", str(users), "--certificate", certificate, "--key", key, scheme="https"
    )
    yield made
    assert made.end() == 0


class Browser:
    """Keeps the cookie, as a browser does."""

    def __init__(self, server: Server) -> None:
        self._place = server.address.removeprefix("https://")
        self.cookie = self.attributes = ""

    def ask(self, method: str, path: str, headers=None, **fields: str):
        """Return status, text and where it leads."""
        context = ssl.create_default_context()
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        connection = http.client.HTTPSConnection(self._place, timeout=60, context=context)
        given = {"Cookie": f"valve_twin_session={self.cookie}", **(headers or {})}
        body = urllib.parse.urlencode(fields) if method == "POST" else None
        connection.request(method, path, body, given)
        answer = connection.getresponse()
        found = COOKIE.match(answer.headers.get("set-cookie", ""))
        if found:
            self.cookie, self.attributes = found.groups()
        text = answer.read().decode()
        connection.close()
        where = answer.headers.get("location", "")
        prefixed = urllib.parse.urljoin(f"/plant/valves{path}", where)  # as behind a proxy
        assert not where or prefixed.startswith("/plant/valves/"), where
        return answer.status, text, prefixed.removeprefix("/plant/valves") if where else ""

    def enter(self) -> str:
        """Log in and return the token of the forms."""
        status, _, where = self.ask(
            "POST", "/login", user="anna", password=RIGHT, next="/valve/press/one"
        )
        assert (status, where) == (303, "/valve/press/one")
        _, page, _ = self.ask("GET", where)
        (token,) = set(re.findall(r'name="token" value="([^"]+)"', page))
        return str(token)


@pytest.fixture
def browser(server):
    return Browser(server)


def test_who_has_come_in_marks_and_acknowledges_with_his_name_in_the_log(browser, path):
    token = browser.enter()
    attributes = browser.attributes.lower()
    assert all(a in attributes for a in ("httponly", "samesite=strict", "secure", "path=/"))
    fields = {"token": token, "valve": "/press/one"}
    note = "<script>alert(1)</script> seal"
    status, _, where = browser.ask("POST", "/mark", **fields, note=note)
    assert status == 303
    _, page, _ = browser.ask("GET", where)
    assert "/press/one: maintenance noted from cycle 21 on" in page
    assert "<script>alert" not in page
    assert "maintenance noted" not in browser.ask("GET", where)[1]  # said once
    with History(path, read_only=True) as history:
        (entry,) = [e for e in history.log.events("/press/one") if e.code == "x.y"]
    browser.ask("POST", "/acknowledge", **fields, number=str(entry.id), note="seen")
    with History(path, read_only=True) as history:
        (work,) = history.maintenance("/press/one")
        events = {e.id: e for e in history.log.events("/press/one")}
    assert work.note == f"{note} (anna, on the page)"
    seen = events[entry.id]
    assert (seen.acknowledged, seen.acknowledged_by) == (True, "anna")
    assert seen.acknowledged_at_ns > 0
    assert any("anna has seen entry" in e.text for e in events.values())
    status, _, _ = browser.ask("POST", "/logout", token=token)
    assert status == 303
    assert browser.ask("POST", "/mark", **fields, note="again")[0] == 403


@pytest.mark.parametrize(
    ("headers", "change"),
    [
        ({}, {"token": ""}),
        ({}, {"token": "guess"}),
        ({"Cookie": "valve_twin_session=guess"}, {}),
        ({"Cookie": ""}, {}),
        ({"Origin": "https://evil.example"}, {}),
        ({"Sec-Fetch-Site": "cross-site"}, {}),
        ({"Sec-Fetch-Site": "same-site", "Origin": "https://evil.example"}, {}),
    ],
)
def test_a_form_of_another_site_does_nothing(browser, path, headers, change):
    token = browser.enter()
    with History(path, read_only=True) as history:
        before = history.maintenance("/press/one")
    fields = {"token": token, "valve": "/press/one", "note": "forged", **change}
    status, text, _ = browser.ask("POST", "/mark", headers, **fields)
    assert status == 403
    assert "Traceback" not in text
    with History(path, read_only=True) as history:
        assert history.maintenance("/press/one") == before


def test_what_is_no_form_is_refused_in_a_line(browser):
    token = browser.enter()
    assert browser.ask("POST", "/mark", token=token, note="x" * 20_000)[0] == 400
    for fields, why in (
        ({"valve": "/none", "note": "x"}, "knows no valve"),
        ({"valve": "/press/one", "note": " "}, "the note is empty"),
    ):
        _, _, where = browser.ask("POST", "/mark", token=token, **fields)
        shown = browser.ask("GET", where if fields["valve"] != "/none" else "/valve/press/one")[1]
        assert "Not done: " in shown
        assert why in shown
    assert browser.ask("POST", "/acknowledge", token=token, valve="/press/one", number="x")[0] == (
        400
    )


def test_a_wrong_password_is_one_page_and_a_thousand_are_one_line(browser, server):
    status, page, _ = browser.ask("POST", "/login", user="eve", password="x", next="/")
    assert status == 403
    assert "do not fit" in page
    assert browser.cookie == ""
    for _ in range(40):
        assert browser.ask("POST", "/login", user="eve", password="x")[0] == 403
    assert browser.enter()
    assert server.said().count("5 wrong passwords of users that do not exist") == 1


@pytest.mark.parametrize(
    ("given", "kept"),
    [("/valve/a", "/valve/a"), ("//evil.example", "/"), ("https://evil.example", "/"),
     ("/\\evil", "/"), ("", "/"), ("/a\r\nSet-Cookie: x", "/"), ("/valve/<b>", "/valve/%3Cb%3E")],
)  # fmt: skip
def test_a_login_leads_to_this_site_only(given, kept):
    assert inside(given) == kept


def test_a_proxy_that_replaces_the_name_of_the_host_hides_no_form_of_ours(browser, path):
    token = browser.enter()
    headers = {"Host": "backend:8107", "Origin": "https://plant", "Sec-Fetch-Site": "same-origin"}
    fields = {"token": token, "valve": "/press/one", "note": "behind a proxy"}
    status, _, where = browser.ask("POST", "/mark", headers, **fields)
    assert (status, where) == (303, "/valve/press/one")
    with History(path, read_only=True) as history:
        assert history.maintenance("/press/one")[-1].note.startswith("behind a proxy")
    del headers["Sec-Fetch-Site"]  # nothing but the names: who guards, says what to do
    status, text, _ = browser.ask("POST", "/mark", headers, **fields)
    assert status == 403
    assert "let it pass on the header Host" in text
