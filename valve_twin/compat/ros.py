# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What rclpy and the message types keep private."""

from __future__ import annotations

import ctypes
import sys
from contextlib import suppress
from functools import partial
from importlib import import_module
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.executors import Executor
    from rclpy.lifecycle import LifecycleNode
    from rclpy.node import Node


_SURE = 16
"""Spins in turn that kept the record of a function: from then on it is sure that all do [1]."""


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


def log_without_sources() -> None:
    """Let rclpy find the line that logs without reading sources: 40 ms of CPU of a twin's start.

    It uses the name of a frame's file alone and asks `inspect` for the lines around it, too, which
    reads each file on the way and seeks it among all modules that are loaded; no issue is known.
    Goes when `rclpy.impl.rcutils_logger` asks with `context=0`.
    """
    ours = dict(vars(import_module("inspect")))
    ours["getframeinfo"] = partial(ours["getframeinfo"], context=0)
    import_module("rclpy.impl.rcutils_logger").inspect = SimpleNamespace(**ours)  # type: ignore[attr-defined]


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


class Recess:
    """Lets a spin of the events executor end early, and takes back what each spin would keep.

    `spin_until_future_complete` makes a function of C++ for the future that it is given. pybind11
    3.0 destroys the record of such a function, but gives neither its memory nor its reference to
    the type back (pybind/pybind11#6010): 33 bytes a turn of a loop, 50 MB a day at 10 kHz.
    That is done here, once some spins have shown that it is kept; of a record that still lives, or
    where pybind11 keeps none, nothing is touched. Goes when no supported release keeps any.
    """

    def __init__(self) -> None:
        self._stop: Any = None
        self._kind: Any = None
        self._record = 0
        self._kept: int | None = 0  # spins in turn that kept their record; None = one did not

    def add_done_callback(self, stop: Any) -> None:
        """Take what ends the spin that begins."""
        record = stop.__self__
        self._stop, self._kind, self._record = stop, type(record), id(record)

    def remove_done_callback(self, _stop: Any) -> None:
        """Forget it."""
        self._stop = None

    def end(self) -> None:
        """End the spin that runs, on its own thread; without one nothing happens."""
        if self._stop is not None:
            self._stop(None)

    def spin(self, executor: Executor, wait_s: float) -> None:
        """Run callbacks until `end` or for so long.

        Parameters
        ----------
        executor : EventsExecutor
            That of the node.
        wait_s : float
            Time [s].
        """
        kind, self._record = self._kind, 0
        before = sys.getrefcount(kind)
        try:
            executor.spin_until_future_complete(self, timeout_sec=wait_s)  # type: ignore[arg-type]
        finally:
            self._stop = None
        if kind is None or self._kept is None or kind is not self._kind or not self._record:
            return
        if self._kept < _SURE:  # memory that was given back is not looked at
            grown = sys.getrefcount(kind) - before
            self._kept = None if grown == 0 else self._kept + 1 if grown == 1 else 0
        elif ctypes.c_ssize_t.from_address(self._record).value == 0:
            ctypes.pythonapi.PyObject_Free(ctypes.c_void_p(self._record))
            ctypes.pythonapi.Py_DecRef(ctypes.py_object(kind))
