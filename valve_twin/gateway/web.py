# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Pages and interfaces over HTTP. Nothing that comes in can reach a valve.

Only GET is answered, but for marks and acknowledgements where accounts are switched on.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from valve_twin.gateway.metrics import TYPE, exposition
from valve_twin.gateway.page import forms
from valve_twin.gateway.page.answers import HEADERS, MARK, visitor_of
from valve_twin.gateway.page.filed import served_report
from valve_twin.gateway.page.lines import iso
from valve_twin.gateway.page.samples import NoSamplesError, Samples
from valve_twin.gateway.pages import (
    ShownCycle,
    Visitor,
    cycles_page,
    fleet_mark,
    fleet_page,
    message_page,
    script,
    valve_mark,
    valve_page,
)
from valve_twin.gateway.plain import plain_faults, plain_valve, plain_words
from valve_twin.io.errors import ValveTwinError
from valve_twin.report.language import words

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response

    from valve_twin.gateway.live.channel import Channels
    from valve_twin.gateway.page.accounts import Accounts
    from valve_twin.gateway.page.marking import Marker
    from valve_twin.gateway.plant import Plant
    from valve_twin.io.history.fleet import FleetRow


@dataclass(frozen=True, slots=True)
class Site:
    """What is served beside the history.

    Attributes
    ----------
    live : Channels or None
        Live twins; None = none.
    commands : mapping
        Names of the commands of each live valve.
    samples : Samples
        Bags with the samples of cycles.
    accounts, marker : Accounts, Marker or None
        Who may mark and acknowledge, and who takes it down; None = nobody may.
    secure : bool
        Whether the pages are served by TLS.
    """

    live: Channels | None = None
    commands: Mapping[str, Sequence[str]] = field(default_factory=dict)
    samples: Samples = field(default_factory=lambda: Samples(()))
    accounts: Accounts | None = None
    marker: Marker | None = None
    secure: bool = False


def application(plant: Plant, site: Site | None = None) -> Starlette:
    """Return the application of a history.

    `/` all valves, `/valve/NAME` one, `/report/NAME` its report, `/cycles/NAME` two of its cycles,
    `/live/NAME` its moving plot as server-sent events, `/api/valves` and `/api/valves/NAME` the
    same as JSON, `/metrics` for Prometheus, `/health` 200 where the history can be read, else 503.

    Parameters
    ----------
    plant : Plant
        What is shown.
    site : Site, optional
        What is served beside.
    """
    from starlette.applications import Starlette
    from starlette.exceptions import HTTPException
    from starlette.responses import HTMLResponse
    from starlette.routing import Route

    pages = _Pages(plant, site or Site())

    def refused(request: Request, err: Exception) -> Response:
        assert isinstance(err, HTTPException)
        text = message_page("Not here", f"{err.status_code} {err.detail}", visitor_of(request))
        return HTMLResponse(text, err.status_code, headers=HEADERS)

    routes = [
        Route("/", pages.fleet),
        Route("/page.js", pages.script),
        Route("/valve/{name:path}", pages.valve),
        Route("/report/{name:path}", pages.report),
        Route("/cycles/{name:path}", pages.cycles),
        Route("/live/{name:path}", pages.live),
        Route("/api/valves", pages.valves),
        Route("/api/valves/{name:path}", pages.one),
        Route("/metrics", pages.metrics),
        Route("/health", pages.health),
    ]
    if pages.site.accounts is not None and pages.site.marker is not None:
        routes += forms.routes(pages.site.accounts, pages.site.marker, secure=pages.site.secure)
    made = Starlette(routes=routes, exception_handlers={HTTPException: refused})
    made.router.redirect_slashes = False  # it would lead to the host's own name, without a prefix
    return made


class _Pages:
    """What answers each address."""

    def __init__(self, plant: Plant, site: Site) -> None:
        self._plant, self.site = plant, site

    def _html(self, text: str, request: Request, status: int = 200) -> Response:
        from starlette.responses import HTMLResponse

        answer = HTMLResponse(text, status, headers=HEADERS)
        asked = request.query_params.get("lang", "")
        if asked in words.LANGUAGES:
            answer.set_cookie(
                words.COOKIE,
                asked,
                max_age=365 * 24 * 3600,
                httponly=True,
                samesite="lax",
                secure=self.site.secure,
            )
        return answer

    def _visitor(self, request: Request) -> Visitor:
        return visitor_of(request, self.site.accounts)

    def _row(self, request: Request) -> FleetRow | None:
        name = request.path_params["name"]
        view = self._plant.glance()
        return view.row("/" + name) or view.row(name)

    def _message(self, title: str, text: str, request: Request, status: int) -> Response:
        return self._html(message_page(title, text, self._visitor(request)), request, status)

    def _unknown(self, request: Request) -> Response:
        failure = self._plant.glance().failure
        if failure:
            return self._message("The history cannot be read", failure, request, 503)
        text = f"The history knows nothing about /{request.path_params['name']}."
        return self._message("No such valve", text, request, 404)

    def fleet(self, request: Request) -> Response:
        view = self._plant.glance()
        if _has(request, fleet_mark(view)) and not view.failure:
            return _nothing_new()
        return self._html(fleet_page(view, time.time_ns(), self._visitor(request)), request)

    def script(self, _: Request) -> Response:
        from starlette.responses import Response

        return Response(script(), media_type="text/javascript; charset=utf-8", headers=HEADERS)

    def valve(self, request: Request) -> Response:
        from valve_twin.gateway.page.details import Details

        row = self._row(request)
        if row is None:
            return self._unknown(request)
        try:
            details = self._plant.details(row.valve) or Details()
        except ValveTwinError as err:
            details = Details(failure=str(err))
        view, visitor = self._plant.glance(), self._visitor(request)
        if _has(request, valve_mark(view, row, details)) and not view.failure:
            return _nothing_new()
        said = ""
        if visitor.session is not None and MARK.lower() not in request.headers:
            said, visitor.session.said = visitor.session.said, ""
        live, name = self.site.live, row.valve
        commands = self.site.commands.get(name, ()) if live and name in live else None
        page = valve_page(view, row, details, visitor, commands=commands, said=said)
        return self._html(page, request)

    def report(self, request: Request) -> Response:
        row = self._row(request)
        try:
            page = self._plant.page(row.valve) if row is not None else None
        except ValveTwinError as err:
            return self._message("The history cannot be read", str(err), request, 503)
        if row is None or page is None:
            return self._unknown(request)
        return self._html(served_report(page, row.valve, self._visitor(request)), request)

    def cycles(self, request: Request) -> Response:
        row = self._row(request)
        if row is None:
            return self._unknown(request)
        numbers = [
            _whole(request.query_params.get("cycle", ""), row.cycle),
            _whole(request.query_params.get("beside", ""), max(row.cycle - 1, 1)),
        ]
        try:
            stored = self._plant.cycles(row.valve, numbers)
            first = self._plant.first_cycle(row.valve)
        except ValveTwinError as err:
            return self._message("The history cannot be read", str(err), request, 503)
        shown = []
        for number, found in zip(numbers, stored, strict=True):
            if found is None:
                shown.append(ShownCycle(number))
                continue
            record, estimates = found
            try:
                samples, why = self.site.samples.cycle(row.valve, record), ""
            except NoSamplesError as err:
                samples, why = None, str(err)
            shown.append(ShownCycle(number, record, estimates, samples, why))
        return self._html(cycles_page(row, shown, first, self._visitor(request)), request)

    async def live(self, request: Request) -> Response:
        from starlette.responses import PlainTextResponse, StreamingResponse

        name, live = "/" + request.path_params["name"], self.site.live
        if live is None or name not in live:
            return PlainTextResponse(f"no live twin of {name}\n", 404, headers=HEADERS)
        if live.full:
            return PlainTextResponse("too many look on\n", 503, headers=HEADERS)
        events = live.events(name)
        return StreamingResponse(events, media_type="text/event-stream", headers=HEADERS)

    def valves(self, _: Request) -> Response:
        from starlette.responses import JSONResponse

        view = self._plant.glance()
        found = {
            "history": view.where,
            "read": iso(view.read_ns),
            "failure": view.failure,
            "whole": view.whole,
            "valves": [plain_valve(view, row) | plain_words(view, row) for row in view.rows],
            "faults": plain_faults(view.faults),
        }
        return JSONResponse(found, headers=HEADERS)

    def one(self, request: Request) -> Response:
        from starlette.responses import JSONResponse

        row = self._row(request)
        if row is None:
            failure = {"failure": f"no valve {request.path_params['name']}"}
            return JSONResponse(failure, 404, headers=HEADERS)
        view = self._plant.glance()
        return JSONResponse(plain_valve(view, row) | plain_words(view, row), headers=HEADERS)

    def metrics(self, _: Request) -> Response:
        from starlette.responses import Response

        return Response(exposition(self._plant.glance()), media_type=TYPE, headers=HEADERS)

    def health(self, _: Request) -> Response:
        from starlette.responses import PlainTextResponse

        failure = self._plant.glance().failure
        return PlainTextResponse(failure or "ok", 503 if failure else 200, headers=HEADERS)


def _has(request: Request, mark: str) -> bool:
    return request.headers.get(MARK, "") == mark


def _nothing_new() -> Response:
    from starlette.responses import Response

    return Response(status_code=204, headers=HEADERS)


def _whole(text: str, otherwise: int) -> int:
    """Return a number that somebody typed; what is none counts as not given."""
    digits = text.strip()
    return int(digits) if digits.isascii() and digits.isdigit() and len(digits) < 16 else otherwise
