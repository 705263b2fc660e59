# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin serve`: the valves of a history in a browser, without ROS."""

from __future__ import annotations

import socket
from contextlib import suppress
from typing import TYPE_CHECKING

from valve_twin.cli.archive.fleet import aging_rules
from valve_twin.cli.common import OK, USAGE, add_url, add_verb, fail, say

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs

_MOST = 65535


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "serve",
        "Show the valves of a history in a browser; without ROS, read only.",
        _serve,
    )
    add_url(parser)
    parser.add_argument(
        "--config",
        metavar="FILE",
        help="YAML of the valves, for their service limits; default the usual ones",
    )
    parser.add_argument(
        "--host", default="127.0.0.1", help="address to listen at, default this machine only"
    )
    parser.add_argument("--port", type=int, default=8107, help="TCP port, default 8107; 0 = any")


def _serve(arguments: argparse.Namespace) -> int:
    try:
        import prometheus_client  # noqa: F401
        import starlette  # noqa: F401
        import uvicorn
    except ModuleNotFoundError as err:
        return fail(f"serve: {err.name} is missing: pip install valve_twin[gateway]", USAGE)
    from valve_twin.gateway.plant import Plant
    from valve_twin.gateway.web import application

    if not 0 <= arguments.port <= _MOST:
        return fail(f"serve: port {arguments.port} is not in 0 .. {_MOST}", USAGE)
    plant = Plant(arguments.url, aging_rules(arguments.config))
    view = plant.view()
    if view.failure:
        return fail(view.failure)
    family = socket.AF_INET6 if ":" in arguments.host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((arguments.host, arguments.port))
            listening.listen()  # who asks before the server has started waits for it
        except OSError as err:
            where = f"{arguments.host}:{arguments.port}"
            why = f"serve: cannot listen at {where}: {err.strerror or err}: choose another --port"
            return fail(f"{why} or --host")
        host, port = listening.getsockname()[:2]
        shown = f"[{host}]" if ":" in host else host
        say(f"{view.where}: {len(view.rows)} valves at http://{shown}:{port}/ (Ctrl-C ends it)")
        config = uvicorn.Config(application(plant), log_level="warning", server_header=False)
        with suppress(KeyboardInterrupt):  # the usual end
            uvicorn.Server(config).run(sockets=[listening])
    return OK
