# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Pages and interfaces over HTTP. Nothing that comes in changes anything: only GET is answered."""

from __future__ import annotations

import time
from datetime import datetime, timezone
from typing import TYPE_CHECKING

from valve_twin.gateway.metrics import TYPE, exposition
from valve_twin.gateway.pages import fleet_page, message_page, plain_valve
from valve_twin.io.errors import ValveTwinError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response

    from valve_twin.gateway.plant import Plant

HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
"""Of every answer: a page runs no script and loads nothing, whatever a valve is called."""


def application(plant: Plant) -> Starlette:
    """Return the application of a history.

    `/` all valves, `/valve/NAME` the report page of one, `/api/valves` and `/api/valves/NAME` the
    same as JSON, `/metrics` for Prometheus, `/health` 200 where the history can be read, else 503.

    Parameters
    ----------
    plant : Plant
        What is shown.
    """
    from starlette.applications import Starlette
    from starlette.exceptions import HTTPException
    from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
    from starlette.routing import Route

    def fleet(_: Request) -> Response:
        return HTMLResponse(fleet_page(plant.view(), time.time_ns()), headers=HEADERS)

    def valve(request: Request) -> Response:
        name = "/" + request.path_params["name"]
        try:
            page = plant.page(name) or plant.page(name[1:])
        except ValveTwinError as err:
            text = message_page("The history cannot be read", str(err))
            return HTMLResponse(text, 503, headers=HEADERS)
        if page is None:
            text = message_page("No such valve", f"The history knows nothing about {name}.")
            return HTMLResponse(text, 404, headers=HEADERS)
        return HTMLResponse(page, headers=HEADERS)

    def valves(_: Request) -> Response:
        view = plant.view()
        found = {
            "history": view.where,
            "read": _time(view.read_ns),
            "failure": view.failure,
            "valves": [plain_valve(view, row) for row in view.rows],
        }
        return JSONResponse(found, headers=HEADERS)

    def one(request: Request) -> Response:
        view, name = plant.view(), request.path_params["name"]
        row = view.row("/" + name) or view.row(name)
        if row is None:
            return JSONResponse({"failure": f"no valve {name}"}, 404, headers=HEADERS)
        return JSONResponse(plain_valve(view, row), headers=HEADERS)

    def metrics(_: Request) -> Response:
        return Response(exposition(plant.view()), media_type=TYPE, headers=HEADERS)

    def health(_: Request) -> Response:
        failure = plant.view().failure
        return PlainTextResponse(failure or "ok", 503 if failure else 200, headers=HEADERS)

    def refused(_: Request, err: Exception) -> Response:
        assert isinstance(err, HTTPException)
        text = message_page("Not here", f"{err.status_code} {err.detail}")
        return HTMLResponse(text, err.status_code, headers=HEADERS)

    routes = [
        Route("/", fleet),
        Route("/valve/{name:path}", valve),
        Route("/api/valves", valves),
        Route("/api/valves/{name:path}", one),
        Route("/metrics", metrics),
        Route("/health", health),
    ]
    return Starlette(routes=routes, exception_handlers={HTTPException: refused})


def _time(stamp_ns: int) -> str:
    return datetime.fromtimestamp(stamp_ns * 1e-9, timezone.utc).isoformat() if stamp_ns else ""
