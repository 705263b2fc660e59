# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What comes in by forms: coming in and going, marks and acknowledgements.

A form counts only with the cookie of a session and the token of that session; the cookie is not
sent by other sites, no script sees it, and with TLS it goes by TLS alone.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, quote

from valve_twin.gateway.page.accounts import COOKIE, SESSION_S
from valve_twin.gateway.page.answers import HEADERS, visitor_of
from valve_twin.gateway.page.marking import Seen, Work
from valve_twin.gateway.pages import login_page, message_page
from valve_twin.io.errors import ValveTwinError

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping

    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.routing import Route

    from valve_twin.gateway.page.accounts import Accounts, Session
    from valve_twin.gateway.page.marking import Marker

MOST_BYTES = 16_384
"""Longest form that is read [B]."""

WRONG = "Name and password do not fit, or were tried too often: wait half a minute."
NO_FORM = "The form cannot be read"
STRANGE = "The form is none of this session"
FOREIGN = (
    "The form comes from another site: where a proxy stands before these pages, let it pass on "
    "the header Host"
)


async def fields_of(request: Request) -> dict[str, str] | None:
    """Return the fields of a form; None where it is too long or none."""
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > MOST_BYTES:
            return None
    try:
        found = parse_qs(body.decode("ascii"), keep_blank_values=True, max_num_fields=20,
                         errors="strict")  # fmt: skip
    except ValueError:  # UnicodeError, too
        return None
    return {name: values[-1] for name, values in found.items()}


def is_own(request: Request) -> bool:
    """Return whether a form comes from a page of ours, as far as the browser says.

    What it says of the site counts before the name of the host, which a proxy may have replaced;
    browsers say it by TLS and on this machine only.
    """
    site = request.headers.get("sec-fetch-site")
    if site is not None:
        return site in {"same-origin", "none"}
    origin = request.headers.get("origin")
    return origin is None or origin.partition("://")[2] == request.headers.get("host", "")


def inside(path: str) -> str:
    """Return a way on this site; the page of all valves for any other."""
    plain = path.startswith("/") and not path.startswith(("//", "/\\")) and path.isprintable()
    return quote(path, safe="/%") if plain else "/"


def routes(accounts: Accounts, marker: Marker, *, secure: bool) -> list[Route]:
    """Return the addresses of the forms.

    Parameters
    ----------
    accounts : Accounts
        Who may come in.
    marker : Marker
        Takes down what is marked.
    secure : bool
        Whether the pages are served by TLS.
    """
    from starlette.routing import Route

    forms = _Forms(accounts, marker, secure=secure)
    return [
        Route("/login", forms.ask, methods=["GET"]),
        Route("/login", forms.enter, methods=["POST"]),
        Route("/logout", forms.leave, methods=["POST"]),
        Route("/mark", forms.mark, methods=["POST"]),
        Route("/acknowledge", forms.acknowledge, methods=["POST"]),
    ]


class _Forms:
    def __init__(self, accounts: Accounts, marker: Marker, *, secure: bool) -> None:
        self._accounts, self._marker, self._secure = accounts, marker, secure

    async def ask(self, request: Request) -> Response:
        return self._login(request, request.query_params.get("next", "/"))

    def _login(self, request: Request, following: str, wrong: str = "") -> Response:
        from starlette.responses import HTMLResponse

        page = login_page(visitor_of(request, self._accounts), inside(following), wrong)
        return HTMLResponse(page, 403 if wrong else 200, headers=HEADERS)

    async def enter(self, request: Request) -> Response:
        from starlette.concurrency import run_in_threadpool

        given = await fields_of(request)
        if given is None:
            return self._refuse(request, NO_FORM, 400)
        if not is_own(request):
            return self._refuse(request, FOREIGN, 403)
        following = given.get("next", "/")
        user, password = given.get("user", ""), given.get("password", "")
        try:
            address = request.client.host if request.client is not None else ""
            cookie = await run_in_threadpool(self._accounts.enter, user, password, address)
        except ValveTwinError as err:
            return self._refuse(request, str(err), 503)
        if not cookie:
            return self._login(request, following, WRONG)
        answer = _go_on(inside(following))
        answer.set_cookie(
            COOKIE,
            cookie,
            max_age=round(SESSION_S),
            httponly=True,
            samesite="strict",
            secure=self._secure,
        )
        return answer

    async def leave(self, request: Request) -> Response:
        return await self._with_session(request, self._leave)

    async def _leave(self, request: Request, _: Session, __: Mapping[str, str]) -> Response:
        self._accounts.leave(request.cookies.get(COOKIE, ""))
        answer = _go_on("/")
        answer.delete_cookie(COOKIE, httponly=True, samesite="strict", secure=self._secure)
        return answer

    async def mark(self, request: Request) -> Response:
        return await self._with_session(request, self._mark)

    async def _mark(self, _: Request, session: Session, given: Mapping[str, str]) -> Response:
        valve = given.get("valve", "")
        anew = given.get("new_reference") == "1"
        work = Work(valve, given.get("note", ""), session.user, anew)
        return await _told(session, valve, partial(self._marker.mark, work))

    async def acknowledge(self, request: Request) -> Response:
        return await self._with_session(request, self._acknowledge)

    async def _acknowledge(
        self, request: Request, session: Session, given: Mapping[str, str]
    ) -> Response:
        valve, number = given.get("valve", ""), given.get("number", "")
        if not (number.isascii() and number.isdigit() and len(number) < 19):
            return self._refuse(request, NO_FORM, 400)
        seen = Seen(valve, int(number), given.get("note", ""), session.user)
        return await _told(session, valve, partial(self._marker.acknowledge, seen))

    async def _with_session(
        self,
        request: Request,
        act: Callable[[Request, Session, Mapping[str, str]], Awaitable[Response]],
    ) -> Response:
        """Act where a form is one of a session's own."""
        given = await fields_of(request)
        if given is None:
            return self._refuse(request, NO_FORM, 400)
        if not is_own(request):
            return self._refuse(request, FOREIGN, 403)
        try:
            session = self._accounts.still(request.cookies.get(COOKIE, ""))
        except ValveTwinError as err:
            return self._refuse(request, str(err), 503)
        if session is None or not session.owns(given.get("token", "")):
            return self._refuse(request, STRANGE, 403)
        return await act(request, session, given)

    def _refuse(self, request: Request, why: str, status: int) -> Response:
        from starlette.responses import HTMLResponse

        page = message_page("Not done", why, visitor_of(request, self._accounts))
        return HTMLResponse(page, status, headers=HEADERS)


async def _told(session: Session, valve: str, act: Callable[[], str]) -> Response:
    """Act on a thread and keep what is said for the page of the valve."""
    from starlette.concurrency import run_in_threadpool

    try:
        session.said = await run_in_threadpool(act)
    except ValveTwinError as err:
        session.said = f"Not done: {err}"
    return _go_on("/valve/" + quote(valve.lstrip("/")))


def _go_on(where: str) -> Response:
    """Lead to a page of ours; beside the form, since a proxy may put a prefix before all."""
    from starlette.responses import RedirectResponse

    return RedirectResponse(f".{where}", 303, headers=HEADERS)
