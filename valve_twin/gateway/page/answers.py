# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What all answers have in common, and for whom they are."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.gateway.page.accounts import COOKIE
from valve_twin.gateway.pages import Visitor
from valve_twin.report.language import words

if TYPE_CHECKING:
    from collections.abc import Mapping

    from starlette.requests import Request

    from valve_twin.gateway.page.accounts import Accounts

HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; connect-src 'self'; "
    "style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
"""Of every answer: a page runs the one script of ours and loads nothing else, whatever a valve is
called."""

MARK = "X-Valve-Twin-Mark"
"""Header with what a page shows already, when it asks anew by itself; it is answered 204 where
there is nothing new."""


def visitor_of(request: Request, accounts: Accounts | None = None) -> Visitor:
    """Return for whom a page is made.

    Parameters
    ----------
    request : Request
        What asks for it.
    accounts : Accounts or None
        Who may come in.
    """
    path = request.url.path
    asked, kept = request.query_params.get("lang", ""), request.cookies.get(words.COOKIE, "")
    language = words.chosen(asked, kept, request.headers.get("accept-language", ""))
    session = None
    if accounts is not None:
        used = MARK.lower() not in request.headers
        session = accounts.session(request.cookies.get(COOKIE, ""), used=used)
    root = "../" * (path.count("/") - 1)
    return Visitor(language, root, path, session, accounts is not None)
