# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin serve`: the valves of a history in a browser and by other faces, without ROS."""

from __future__ import annotations

import gc
import os
import signal
import socket
import sys
import threading
from contextlib import ExitStack, contextmanager
from functools import partial
from getpass import getpass
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.cli.archive.fleet import aging_rules, nameplates
from valve_twin.cli.common import OK, USAGE, add_url, add_verb, fail, say
from valve_twin.compat.interpreter import load_kernels_alone
from valve_twin.io.errors import ConfigError, unwritable
from valve_twin.io.uncollected import uncollected

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator
    from types import FrameType

    from uvicorn import Server

    from valve_twin.cli.common import Verbs
    from valve_twin.gateway.web import Site
    from valve_twin.io.config.gateway_parameters import FaceParameters

_MOST = 65535


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "serve",
        "Show the valves of a history in a browser, by OPC UA, MQTT and in Foxglove; without ROS,"
        " read only.",
        _serve,
    )
    add_url(parser, required=False)
    parser.add_argument(
        "--config",
        metavar="FILE",
        help="YAML of the valves, for their service limits; default the usual ones",
    )
    parser.add_argument(
        "--host", default="127.0.0.1", help="address to listen at, default this machine only"
    )
    parser.add_argument("--port", type=int, default=8107, help="TCP port, default 8107; 0 = any")
    parser.add_argument(
        "--foxglove",
        type=int,
        nargs="?",
        const=8765,
        metavar="PORT",
        help="serve Foxglove at ws://HOST:PORT, default 8765; 0 = any",
    )
    parser.add_argument("--certificate", metavar="FILE", default="", help="PEM, for TLS")
    parser.add_argument("--key", metavar="FILE", default="", help="its key, PEM")
    parser.add_argument(
        "--bag",
        action="append",
        default=[],
        metavar="PATH",
        help="bag with the samples of stored cycles, to look at two beside each other; repeatable",
    )
    parser.add_argument(
        "--users",
        metavar="FILE",
        default="",
        help="users with hashed passwords, who may mark and acknowledge on the page",
    )
    parser.add_argument(
        "--add-user",
        metavar="NAME",
        help="ask for a password (or read it from stdin), add the user to --users, and end",
    )
    opcua = parser.add_argument_group("OPC UA, off unless --opcua is given")
    opcua.add_argument(
        "--opcua",
        nargs="?",
        const="opc.tcp://127.0.0.1:4840",
        metavar="ADDRESS",
        help="serve devices (DI) at opc.tcp://HOST:PORT, default opc.tcp://127.0.0.1:4840",
    )
    opcua.add_argument("--opcua-users", metavar="FILE", help="users with hashed passwords")
    opcua.add_argument(
        "--opcua-add-user",
        metavar="NAME",
        help="ask for a password, add the user to --opcua-users, and end",
    )
    opcua.add_argument(
        "--opcua-pki",
        metavar="FOLDER",
        default="~/.config/valve_twin/opcua",
        help="certificate.der, key.pem (made where both are missing) and trusted/*.der of clients",
    )
    opcua.add_argument(
        "--anonymous", action="store_true", help="let anybody look by OPC UA, unencrypted too"
    )
    _add_mqtt(parser.add_argument_group("MQTT, off unless --mqtt is given"))


def _add_mqtt(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--mqtt", metavar="ADDRESS", help="tell a broker: mqtt://HOST, mqtts://HOST"
    )
    group.add_argument(
        "--mqtt-format",
        choices=("sparkplug", "json"),
        default="sparkplug",
        help="Sparkplug B (default), or retained topics of plain JSON",
    )
    group.add_argument(
        "--mqtt-group", default="valve_twin", help="group id, or prefix of the JSON topics"
    )
    group.add_argument(
        "--mqtt-node", default=socket.gethostname(), help="edge node id, default the host's name"
    )
    group.add_argument(
        "--mqtt-state",
        metavar="FILE",
        default="~/.local/state/valve_twin/mqtt.json",
        help="keeps which cycles the broker has; one for each broker and node",
    )
    group.add_argument("--mqtt-user", default="", help="password in VALVE_TWIN_MQTT_PASSWORD")
    group.add_argument(
        "--mqtt-ca", metavar="FILE", default="", help="whom we trust, default whom the system does"
    )
    group.add_argument("--mqtt-cert", metavar="FILE", default="", help="our certificate")
    group.add_argument("--mqtt-key", metavar="FILE", default="", help="its key")


def _serve(arguments: argparse.Namespace) -> int:
    for option in ("users", "opcua_users"):
        name = getattr(arguments, option.replace("users", "add_user"))
        if name:
            return _add_user(f"--{option.replace('_', '-')}", getattr(arguments, option), name)
    with ExitStack() as stack:
        with uncollected():
            run = _opened(arguments, stack)
            gc.freeze()  # what a start makes stays
        if isinstance(run, int):
            return run
        run()
    return OK


@contextmanager
def _ended_by_ctrl_c(server: Server) -> Iterator[None]:
    """End a server by Ctrl-C also before it runs, and where it has just ended.

    uvicorn looks at signals while it runs, and repeats what it got to whom it found.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, frame: FrameType | None) -> None:
        del number, frame
        server.should_exit = True

    before = signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _opened(arguments: argparse.Namespace, stack: ExitStack) -> Callable[[], None] | int:
    """Open all that is asked for; return what serves until Ctrl-C, or the exit code."""
    try:
        import prometheus_client  # noqa: F401
        import starlette  # noqa: F401
        import uvicorn  # noqa: F401
    except ModuleNotFoundError as err:
        return fail(f"serve: {err.name} is missing: pip install valve_twin[gateway]", USAGE)
    if not arguments.url:
        return fail("serve: --url is missing: name the history", USAGE)
    load_kernels_alone()
    from valve_twin.gateway import serving
    from valve_twin.gateway.faces import faces
    from valve_twin.gateway.plant import Plant
    from valve_twin.gateway.web import application

    if not 0 <= (arguments.foxglove or 0) <= _MOST:
        return fail(f"serve: port {arguments.foxglove} is not in 0 .. {_MOST}", USAGE)
    place = serving.Place(arguments.host, arguments.port, arguments.certificate, arguments.key)
    try:
        told = serving.check_place(place, accounts=bool(arguments.users))
        site = _site(arguments, secure=place.secure)
    except ConfigError as err:
        return fail(f"serve: {err}", USAGE)
    if told:
        say(f"serve: {told}")
    plates = nameplates(arguments.config)
    plant = Plant(arguments.url, aging_rules(arguments.config), plates)
    view = plant.view()
    if view.failure and not plant.is_reading:  # else it takes long, as where kernels are compiled
        view = plant.view()  # it may have come to its end just now
        if view.failure:
            return fail(view.failure)
    plant.waits = True  # a first reading that goes on may still fail
    try:
        listening = stack.enter_context(serving.listen(place))
    except ConfigError as err:
        return fail(f"serve: {err}")
    stack.enter_context(faces(plant, _wanted(arguments), say))
    server = serving.make_server(application(plant, site), place)
    stack.enter_context(_ended_by_ctrl_c(server))
    where = serving.address(place, listening)
    known = f"{len(view.rows)} valves" if view.whole else "valves still to be assessed"
    say(f"{plant.where}: {known} at {where} (Ctrl-C ends it)")
    return partial(server.run, sockets=[listening])


def _site(arguments: argparse.Namespace, *, secure: bool) -> Site:
    """Return what is served beside the history."""
    from valve_twin.gateway.page.accounts import Accounts
    from valve_twin.gateway.page.marking import HistoryMarker
    from valve_twin.gateway.page.samples import Samples
    from valve_twin.gateway.web import Site

    samples = Samples(arguments.bag)
    if not arguments.users:
        return Site(samples=samples, secure=secure)
    accounts = Accounts(arguments.users, say)
    marker = HistoryMarker(arguments.url)
    return Site(samples=samples, accounts=accounts, marker=marker, secure=secure)


def _wanted(arguments: argparse.Namespace) -> FaceParameters:
    """Return which faces are asked for."""
    from valve_twin.gateway.mqtt.names import checked_id
    from valve_twin.io.config.gateway_parameters import FaceParameters

    return FaceParameters(
        host=arguments.host,
        foxglove=-1 if arguments.foxglove is None else arguments.foxglove,
        opcua=arguments.opcua or "",
        opcua_users=arguments.opcua_users or "",
        opcua_pki=arguments.opcua_pki,
        opcua_anonymous=arguments.anonymous,
        mqtt=arguments.mqtt or "",
        mqtt_format=arguments.mqtt_format,
        mqtt_group=arguments.mqtt_group,
        mqtt_node=checked_id("--mqtt-node", arguments.mqtt_node) if arguments.mqtt else "",
        mqtt_state=arguments.mqtt_state,
        mqtt_user=arguments.mqtt_user,
        mqtt_ca=arguments.mqtt_ca,
        mqtt_cert=arguments.mqtt_cert,
        mqtt_key=arguments.mqtt_key,
    )


def _add_user(option: str, path: str | None, name: str) -> int:
    from valve_twin.gateway.passwords import read_users, user_line

    adding = option.replace("users", "add-user")
    if not path:
        return fail(f"serve: {adding} needs {option} FILE to write to", USAGE)
    file = Path(path)
    if file.exists() and name in read_users(file, adding):
        return fail(f"{file}: there is a user {name} already: remove the line first")
    line = user_line(name, _password(name))
    try:
        with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600), "a") as out:
            out.write(f"{line}\n")
    except OSError as err:
        return fail(unwritable(file, err))
    say(f"{file}: user {name} may {'look' if 'opcua' in option else 'mark and acknowledge'}")
    return OK


def _password(name: str) -> str:
    """Return a password from the terminal, else the first line of stdin; never of an argument."""
    if sys.stdin is not None and not sys.stdin.isatty():
        return sys.stdin.readline().rstrip("\r\n")
    return getpass(f"Password of {name}: ")
