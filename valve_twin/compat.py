# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Every use of what rclpy, numba, asyncua and Python keep private or global, in one place.

Each function says why it is needed, what is known of it upstream and when it can go. Nothing heavy
is imported here: the first of them run before the slow imports of a node. Only what `kernels`
takes of numba stands there: a kernel is compiled anew with each change of a file behind it.
"""

from __future__ import annotations

import math
import os
import re
import sys
from contextlib import suppress
from functools import cache, partial
from importlib import import_module
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from collections.abc import Callable, MutableMapping, MutableSequence
    from concurrent.futures import ProcessPoolExecutor

    from rclpy.lifecycle import LifecycleNode
    from rclpy.node import Node

SWITCH_S = 2e-4
"""Longest time for which threads that compute keep the interpreter from the data path; 5 ms by
default, once or more a cycle [s]."""

MOST_ELEMENTS = 200_000
"""Elements of all arrays of a message of OPC UA: twice what ten full queues send at once [1]."""


def spare_imports() -> None:
    """Keep libraries from importing OpenSSL, which no prediction needs.

    asyncio (of rclpy) and hashlib load it wherever Python has it and do without where not;
    whatever imports ssl later gets it. Upstream no switches are known. Goes when they import it
    where they use it.
    """
    spared = {"ssl", "_hashlib"} - set(sys.modules)
    sys.modules.update(dict.fromkeys(spared))  # type: ignore[arg-type]
    for user in ("asyncio", "hashlib", "hmac"):
        import_module(user)
    for name in spared:
        del sys.modules[name]


def load_types_alone() -> None:
    """Let message types find their library without what generates them: 15 ms of CPU of a start.

    The package of the one function that they need imports its generator with two parsers, too, and
    does without where these are not installed; no issue is known. Goes when it does not.
    """
    generator = "rosidl_generator_py.generate_py_impl"
    if generator in sys.modules:
        return
    sys.modules[generator] = None  # type: ignore[assignment]
    try:
        with suppress(ImportError):  # the types say what is missing
            import_module("rosidl_generator_py")
    finally:
        del sys.modules[generator]


@cache
def load_kernels_alone(*, of_arrays: bool = False) -> None:
    """Let numba load a compiled kernel without being made ready to compile one: 0.15 s of CPU.

    Before it looks into a cache it declares all that it knows of Python and numpy, reads the entry
    points of every installed package for extensions, and imports scipy.linalg only to learn that
    BLAS is there, which the code it makes looks up by itself when it is called for the first time.
    A kernel that no cache holds gets all but the last: numba refreshes before it compiles, too. It
    imports coverage where there is. No issue is known. Goes when `load_overload` does not refresh.
    Kernels that estimate take numba's functions of arrays, which look for that BLAS as they are
    imported; with `of_arrays` these, too, do without scipy.linalg. Those that predict take none.
    """
    sys.modules.setdefault("coverage", None)  # type: ignore[arg-type]
    every = import_module("importlib.metadata").distributions()
    if not any("numba_extensions" in (d.read_text("entry_points.txt") or "") for d in every):
        import_module("numba.core.entrypoints")._already_initialized = True  # type: ignore[attr-defined]
    runtime = import_module("numba.core.runtime").rtsys
    caches = import_module("numba.core.caching").Cache
    if not all(
        hasattr(caches, name) for name in ("_guard_against_spurious_io_errors", "_load_overload")
    ):
        return  # a numba that loads otherwise makes itself ready as it likes

    def load_overload(cache: Any, signature: Any, context: Any) -> Any:
        runtime.initialize(context)
        with cache._guard_against_spurious_io_errors():
            found = cache._load_overload(signature, context)
        if found is None:
            _spare_blas()
        return found

    caches.load_overload = load_overload
    if of_arrays:
        _spare_blas()


def _spare_blas() -> None:
    vars(import_module("numba.np.linalg"))["ensure_blas"] = lambda: None


def log_without_sources() -> None:
    """Let rclpy find the line that logs without reading sources: 40 ms of CPU of a twin's start.

    It uses the name of a frame's file alone and asks `inspect` for the lines around it, too, which
    reads each file on the way and seeks it among all modules that are loaded; no issue is known.
    Goes when `rclpy.impl.rcutils_logger` asks with `context=0`.
    """
    ours = dict(vars(import_module("inspect")))
    ours["getframeinfo"] = partial(ours["getframeinfo"], context=0)
    import_module("rclpy.impl.rcutils_logger").inspect = SimpleNamespace(**ours)  # type: ignore[attr-defined]


def share_interpreter() -> None:
    """Let the data path have the interpreter soon while other threads of the process compute.

    The setting is of the whole process. Goes with an interpreter without a global lock.
    """
    sys.setswitchinterval(SWITCH_S)


def take_with_info(subscription: Any) -> Any:
    """Make a subscription call back with message and info, whatever executor drives it.

    rclpy counts the callback's parameters (ros2/rclpy#922): a callback with `*arguments`, which
    both executors need, see `message_and_info`, counts as one without info. Goes when a
    subscription can be asked for the info by an argument.
    """
    subscription._callback_type = subscription.CallbackType.WithMessageInfo
    return subscription


def take_waiting(subscription: Any, most: int) -> list[bytes]:
    """Return the serialized messages that wait at a raw subscription which no executor drives.

    rclpy takes messages in its executors only, with a callback each (its C++ sister has
    `Subscription::take`); no issue is known. Goes when a subscription of rclpy can be asked for
    what waits.

    Parameters
    ----------
    subscription : Subscription
        Made with `raw=True`, of a node that belongs to no executor.
    most : int
        At most so many are taken [1].
    """
    found: list[bytes] = []
    handle, kind = subscription.handle, subscription.msg_type
    with handle:
        while len(found) < most:
            taken = handle.take_message(kind, True)
            if taken is None:
                break
            found.append(taken[0])
    return found


def message_and_info(arguments: tuple[Any, ...]) -> tuple[Any, Any]:
    """Return message and info of a callback.

    SingleThreadedExecutor passes two arguments, the experimental EventsExecutor of Jazzy one tuple
    of both; no issue is known. Goes when both do the same.
    """
    return arguments if len(arguments) == 2 else arguments[0]


def overrides_of(node: Node) -> dict[str, Any]:
    """Return the values that command line and files give a node's parameters, by name.

    rclpy shows an override only when its parameter is declared, so that nobody could name those
    that no one declares (a typing error) or take 1 for 1.0. Goes with a public list of them.
    """
    return {name: parameter.value for name, parameter in node._parameter_overrides.items()}


def lifecycle_state(node: LifecycleNode) -> str:
    """Return the state: unconfigured, inactive, active, finalized or the name of a transition.

    rclpy tells it by service only. Goes when a lifecycle node has it as an attribute.
    """
    return str(node._state_machine.current_state[1])


def answer_refused_transitions(node: LifecycleNode, tell: Callable[[str], None]) -> None:
    """Answer a transition that the state does not know; `tell` gets the reason.

    rclpy of Jazzy raises and does not answer (ros2/rclpy#1209, mended by ros2/rclpy#1319 in later
    releases). Goes when Jazzy has that, too, or is not supported any more.
    """
    service: Any = node._service_change_state
    inner = service.callback
    refused = import_module("rclpy.impl.implementation_singleton").rclpy_implementation.RCLError

    def change_state(request: Any, response: Any) -> Any:
        try:
            return inner(request, response)
        except refused as err:
            tell(without_place(err))
            response.success = False
            return response

    service.callback = change_state


def answer_unknown_types(node: Node, tell: Callable[[str], None]) -> None:
    """Answer who sets a parameter to a value of a type that there is not; `tell` gets the reason.

    rclpy raises `ValueError` in its own callback and does not answer, so that each such call of a
    stranger leaves a trace in the log and a client that waits; no issue is known. Goes when
    `Parameter.from_parameter_msg` is guarded there.
    """
    results = import_module("rcl_interfaces.msg").SetParametersResult
    known = {kind.value for kind in import_module("rclpy.parameter").Parameter.Type}

    def guarded(inner: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        def answer(request: Any, response: Any) -> Any:
            wrong = [p for p in request.parameters if p.value.type not in known]
            if not wrong:
                return inner(request, response)
            reason = f"a value of type {wrong[0].value.type}, which is no type of a parameter"
            tell(reason)
            refused = results(successful=False, reason=reason)
            if hasattr(response, "results"):
                response.results = [refused] * len(request.parameters)
            else:
                response.result = refused
            return response

        return answer

    for service in node.services:
        if service.srv_name.endswith(("/set_parameters", "/set_parameters_atomically")):
            service.callback = guarded(service.callback)


def without_place(error: Exception) -> str:
    """Return what rcl says of an error, without the file and line of its source that follow.

    rclpy hands the error of rcl on as one text, "REASON, at FILE:LINE" once a level; no issue is
    known. Goes when the exception has the reason as an attribute.
    """
    return str(error).split(", at ", maxsplit=1)[0]


def intercept_responses(service: Any, on_response: Callable[[Any, Any], None]) -> Any:
    """Let `on_response(response, header)` decide when a service answers; return what sends.

    The events executor of Jazzy knows no coroutine services (ros2/rclpy#1473, mended by
    ros2/rclpy#1478), and rclpy has no response that is sent later. Goes when the oldest release
    that is supported has the first: the services are coroutines then.
    """
    send = service.send_response
    service.send_response = on_response
    return send


def destroy_state_machine(node: LifecycleNode) -> None:
    """Free what `destroy_node` of a lifecycle node leaves, so that the participant can go.

    The state machine holds the node's handle; no issue is known. Goes when `destroy_node` does it.
    """
    node._state_machine.destroy_when_not_in_use()


def take_exponents(parser: Any) -> None:
    """Let a parser of arguments take -5e-4 for a number, as it does -0.0005, not for an option.

    argparse knows none there (3.13.0 looked at); no issue is known. Goes when it does.
    """
    parser._negative_number_matcher = re.compile(r"-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")


def end_processes(pool: ProcessPoolExecutor) -> None:
    """End the processes of a pool now, whatever they do.

    Before Python 3.14 an executor only waits for them (python/cpython#128041). Goes with 3.13:
    `terminate_workers` is it.
    """
    for process in list((getattr(pool, "_processes", None) or {}).values()):
        process.terminate()


def policies_of(server: Any) -> MutableSequence[Any]:
    """Return the security policies that an OPC UA server offers, to add one with its own rules.

    asyncua knows one set of permissions for all that `set_security_policy` names; no issue is
    known. Goes when it takes one a policy.
    """
    policies: MutableSequence[Any] = server._policies
    return policies


def nodes_of(server: Any) -> MutableMapping[Any, Any]:
    """Return the nodes of the inner part of an OPC UA server by their ids.

    asyncua writes them all to one file and reads them all, which takes half as long as making
    them, or to a shelf that lists only those that were used; no issue is known. Goes when it can
    be given a mapping.
    """
    nodes: MutableMapping[Any, Any] = server.aspace._nodes
    return nodes


def set_nodes(server: Any, nodes: MutableMapping[Any, Any]) -> None:
    """Give the inner part of an OPC UA server its nodes, as `nodes_of` returns them."""
    server.aspace._nodes = nodes


def sessions_of(server: Any) -> dict[Any, Any]:
    """Return the sessions that clients opened at an OPC UA server, by their tokens.

    asyncua keeps any number that is made and never used, and shows none; no issue is known. Goes
    when the server takes a greatest number.
    """
    sessions: dict[Any, Any] = server.iserver._external_sessions
    return sessions


def publishing_of(client: Any) -> Any:
    """Return the task by which an OPC UA client asks for what is published, None where none does.

    asyncua lets it end without a word where the server ends the subscription; no issue is known.
    Goes when it tells.
    """
    return client.uaclient._publish_task


def subscribing_of(subscription: Any) -> Any:
    """Return what adds nodes to an OPC UA subscription under a filter.

    asyncua's `subscribe_data_change` does the same without one; no issue is known. Goes when it
    takes a filter.
    """
    return subscription._subscribe


def bound_arrays(most: int = MOST_ELEMENTS) -> None:
    """Let the arrays of a message of OPC UA hold so many elements together, and none more than it.

    asyncua makes the list that four bytes of a message claim before it looks at what follows, and
    elements of the type Null take none: 9 bytes took 16 GB. Dimensions beyond the elements it
    fills with empty lists, a million for each value. No issue is known. Goes when it has a limit.
    """
    codec: Any = import_module("asyncua.ua.ua_binary")
    if getattr(codec._reshape, "most", None) == most:
        return  # a client that connects again keeps what is made of the types
    message, spent = b"", 0

    def spend(data: Any) -> None:
        nonlocal message, spent
        if data._data is not message:
            message, spent = data._data, 0
        elements = codec.Primitives.Int32.unpack(data.copy(4))
        spent += max(elements, 0)
        if elements > len(data) or spent > most:
            msg = f"an array of {elements} elements in a message of {len(message)} bytes"
            raise codec.UaError(msg)

    def bounded(make: Any) -> Any:
        def made(*kind: Any) -> Any:
            read = make(*kind)

            def deserialize(data: Any) -> Any:
                if isinstance(data, codec.Buffer):
                    spend(data)
                return read(data)

            return deserialize

        made.unbounded = make  # type: ignore[attr-defined]
        return cache(made)

    shape = getattr(codec._reshape, "unbounded", codec._reshape)

    def reshape(flat: list[Any], dimensions: list[int]) -> list[Any]:
        if 0 in dimensions and not flat:
            return flat
        made = len(dimensions) * len(flat)  # lists within lists, at most
        if min(dimensions) < 1 or math.prod(dimensions) > len(flat) or made > most:
            msg = f"an array of {len(flat)} elements with dimensions {str(dimensions)[:80]}"
            raise codec.UaError(msg)
        shaped: list[Any] = shape(flat, dimensions)
        return shaped

    reshape.unbounded, reshape.most = shape, most  # type: ignore[attr-defined]
    codec._reshape = reshape
    for name in ("_create_uatype_array_deserializer", "_create_list_deserializer"):
        make = getattr(codec, name)
        setattr(codec, name, bounded(getattr(make, "unbounded", make)))
    codec._create_type_deserializer.cache_clear()
    codec._create_dataclass_deserializer.cache_clear()


def bound_messages(client: Any, most: int, tell: Callable[[str], None]) -> None:
    """Let an OPC UA client keep so much of a message of its server, and end where that is more.

    asyncua waits for what a header says, up to 4 GB, and for parts of a message as long as they
    come; a server sets the limits of its client. No issue is known. Goes when a client has limits
    of its own.

    Parameters
    ----------
    client : asyncua.Client
        Not connected yet.
    most : int
        Bytes of a message; a part of it has as many as the client asks for, 64 kB.
    tell : callable
        Gets one line where a connection ends for it.
    """
    make = client.uaclient._make_protocol

    def bounded() -> Any:
        protocol = make()
        limits, receive = protocol._connection._limits, protocol.data_received
        grant, part = limits.update_client_limits, limits.max_recv_buffer

        def granted(message: Any) -> None:
            grant(message)
            limits.max_recv_buffer = part  # as asked for; asyncua takes what the server receives
            limits.max_message_size = min(limits.max_message_size or most, most)

        def received(data: bytes) -> None:
            receive(data)
            if len(protocol.receive_buffer or b"") > most and protocol.transport is not None:
                tell(f"the server sends a message of more than {most} bytes")
                protocol.receive_buffer = None
                protocol.transport.abort()

        limits.max_message_size = most
        limits.update_client_limits, protocol.data_received = granted, received
        return protocol

    client.uaclient._make_protocol = bounded


def leave(code: int) -> NoReturn:
    """End the process here, without the destructors of the interpreter and the middleware.

    They may hang or crash after the context was shut down, and take up to a second; everything
    that matters was closed and written before. Goes when `rclpy.shutdown` leaves no thread behind.
    """
    os._exit(code)
