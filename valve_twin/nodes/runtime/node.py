# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The one place for the spin loop, the signals and the life of a node."""

from __future__ import annotations

import gc
import sys
import threading
import traceback
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import ParameterNotDeclaredException, ROSInterruptException
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

from valve_twin.compat import interpreter, ros
from valve_twin.io.config.every_node import NodeParameters
from valve_twin.io.config.node_parameters import NODE_PARAMETERS
from valve_twin.io.errors import ValveTwinError, may_pass
from valve_twin.nodes.runtime import termination
from valve_twin.nodes.runtime.fault_reporter import FaultReporter
from valve_twin.nodes.runtime.parameters import Parameters
from valve_twin.nodes.runtime.transport.profile import remove_profile_file

if TYPE_CHECKING:
    from collections.abc import Callable

    from rcl_interfaces.msg import ParameterDescriptor
    from rclpy.parameter import Parameter
    from rclpy.service import Service

RCLError = rclpy_implementation.RCLError
STEADY = Clock(clock_type=ClockType.STEADY_TIME)
"""For liveness, diagnostics and pacing; never for the data."""

REQUESTS = QoSProfile(depth=1000)
"""Of services: the middleware keeps ten by itself, and drops the first where more come at once."""

SPIN_S = 0.1
"""Longest wait of the loop: a signal is noticed within it [s]."""


TYPE_DESCRIPTIONS = "start_type_description_service"
"""Parameter of rclpy for a service that tells message types."""

TOLD_AGAIN_S = 30.0
"""What a stranger can have told as often as he likes is told so seldom [s]."""

RETRY_S, LAST_RETRY_S = 5.0, 60.0
"""Pause before a start that a full or read-only disk held up is tried again; doubled until
the last one [s]."""

FAREWELL_S = 0.5
"""Longest time that the middleware gets to say goodbye [s]."""


class ValveNode(LifecycleNode):
    """Lifecycle node that never dies of its input.

    A subclass implements `configure`, `activate`, `deactivate` and `cleanup`; setting `exit_code`
    ends the process. An error that a user can repair (`ValveTwinError`) in one of the first two is
    one log line; the node stays alive and can be configured again.
    """

    works_in_callbacks = False
    """Whether callbacks do all that is to be done at once, so that `work` may wait."""

    def __init__(self, name: str, **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        remove_profile_file()
        self.faults = FaultReporter(self, self.later)
        self.parameters = Parameters(self, is_idle=self._is_idle)
        self.parameters.declare(NODE_PARAMETERS[name])
        self.exit_code: int | None = None
        self.recess = ros.Recess()
        self._refusal: Exception | None = None
        self._retry: Any = None
        self._refusal_told, self._pause_s = ("", ""), RETRY_S
        self._inbox: deque[Callable[[], None]] = deque()
        ros.answer_refused_transitions(self, self._tell_refused)
        ros.answer_unknown_types(self, self._tell_unknown_type)

    def create_service(self, *args: Any, **given: Any) -> Service:
        """Make a service as rclpy does, of which many may ask at once."""
        given.setdefault("qos_profile", REQUESTS)
        return super().create_service(*args, **given)

    # -- to be implemented

    def configure(self) -> None:
        """Read the parameters and make what the node needs."""

    def activate(self) -> None:
        """Begin to take and give data."""

    def deactivate(self) -> None:
        """Stop taking and giving data."""

    def cleanup(self) -> None:
        """Free what `configure` made; callable at any time, also after a half configuration."""

    # -- lifecycle

    @property
    def state(self) -> str:
        """Lifecycle state: unconfigured, inactive, active or finalized."""
        return ros.lifecycle_state(self)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure; a failure frees what was made."""
        del state
        done = self._guarded(self.configure, "configure")
        if done:
            self._refusal = None
            self._end_retry()
        else:
            self._guarded(self.cleanup, "clean up")
        return _SUCCESS if done else _FAILURE

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate; a failure undoes what was begun."""
        super().on_activate(state)
        done = self._guarded(self.activate, "activate")
        if done:
            self._refusal = None
            self._end_retry()
            self.get_logger().info("is active")
        else:
            self._guarded(self.deactivate, "deactivate")
        return _SUCCESS if done else _FAILURE

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate."""
        self._guarded(self.deactivate, "deactivate")
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Clean up."""
        del state
        self._end_retry()
        self._guarded(self.cleanup, "clean up")
        return _SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop and clean up from any state."""
        if state.label == "active":
            self._guarded(self.deactivate, "deactivate")
        self._guarded(self.cleanup, "clean up")
        return _SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go back to unconfigured, so that a better configuration can be tried."""
        del state
        self._guarded(self.cleanup, "clean up")
        return _SUCCESS

    def start(self) -> None:
        """Configure and activate where `autostart` says so."""
        if self.parameters.read(NodeParameters).autostart:
            self._begin()

    def _begin(self) -> None:
        """Configure and activate; what a disk keeps from it is tried again until it can be."""
        before, begun = self._refusal, self.state == "inactive"
        try:
            with termination.breaking_off():
                begun = begun or self.trigger_configure() == _SUCCESS
        except KeyboardInterrupt:
            return
        if begun:
            if before is not None and self._refusal is None:
                self.get_logger().info("is configured: what kept it from that is over")
            begun = self.trigger_activate() == _SUCCESS
        if not begun and may_pass(self._refusal):
            self._retry = self.create_timer(self._pause_s, self._begin_again, clock=STEADY)
            self._pause_s = min(2.0 * self._pause_s, LAST_RETRY_S)

    def _end_retry(self) -> None:
        """Leave the node to whoever configured it."""
        if self._retry is not None:
            self.destroy_timer(self._retry)
        self._retry = None

    def _begin_again(self) -> None:
        self._end_retry()
        if self.state not in {"unconfigured", "inactive"}:  # as where it was shut down
            return
        self._refusal_told = type(self._refusal).__name__, str(self._refusal)
        self._begin()
        self._refusal_told = "", ""

    def stop(self) -> None:
        """End in good order, whatever the state, also in the middle of a configuration."""
        if self.state == "configuring":
            self._guarded(self.cleanup, "clean up")
        elif self.state != "finalized":  # else it was shut down by its service
            self._guarded(self.trigger_shutdown, "shut down")
        self._guarded(self.faults.tell, "tell the last faults")

    def declare_parameter(self, name: str, *arguments: Any, **options: Any) -> Parameter:
        """Declare a parameter; rclpy's service of type descriptions is off unless it is given.

        No part of ROS 2 as it is used asks for it, and rcl logs the whole of a question that it
        cannot answer: a stranger's 3 MB make up to 12 MB of log a call.
        """
        if name == TYPE_DESCRIPTIONS:
            arguments = (False, *arguments[1:])
        return super().declare_parameter(name, *arguments, **options)

    def get_parameter(self, name: str) -> Parameter:
        """Return a parameter; one that is declared on its use is there from now on."""
        if hasattr(self, "parameters"):  # rclpy reads some before
            self.parameters.declare_offered((name,))
        return super().get_parameter(name)

    def describe_parameter(self, name: str) -> ParameterDescriptor:
        """Describe a parameter; one that is declared on its use is there from now on."""
        self.parameters.declare_offered((name,))
        return super().describe_parameter(name)

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set all or none; a refusal says why and is filed as a fault, too."""
        self.parameters.declare_offered(p.name for p in parameter_list)
        try:
            result = super().set_parameters_atomically(parameter_list)
        except ParameterNotDeclaredException:
            reason = self.parameters.unknown(p.name for p in parameter_list)
            result = SetParametersResult(successful=False, reason=reason)
        if not result.successful:
            self.faults.report("parameter.refused", f"parameter refused: {result.reason}")
        return result

    def _is_idle(self) -> bool:
        return self.state == "unconfigured"

    def _guarded(self, action: Callable[[], object], what: str) -> bool:
        try:
            action()
        except Exception as err:
            if termination.was_broken_off(err):
                raise KeyboardInterrupt from err
            said = str(err)
            if not isinstance(err, ValveTwinError):
                said = f"{type(err).__name__}: {err}\n{traceback.format_exc()}"
            begins = what in {"configure", "activate"}
            if not begins or (type(err).__name__, str(err)) != self._refusal_told:
                self.get_logger().error(f"cannot {what}: {said}")
            if begins:
                self._refusal = err
        else:
            return True
        return False

    def _tell_unknown_type(self, reason: str) -> None:
        self.get_logger().warning(
            f"parameter refused: {reason}", throttle_duration_sec=TOLD_AGAIN_S
        )

    def _tell_refused(self, reason: str) -> None:
        self.get_logger().warning(f"transition refused in state '{self.state}': {reason}")

    # -- work of other threads

    def post(self, action: Callable[[], None]) -> None:
        """Run `action` on the node's own thread soon; callable from any thread."""
        self._inbox.append(action)
        executor = self.executor
        if executor is not None:
            executor.create_task(self._break_off)

    def later(self, action: Callable[[], None]) -> None:
        """Run `action` after the callbacks that wait now; on the node's own thread only."""
        executor = self.executor
        if executor is None:
            self._inbox.append(action)
        else:
            executor.create_task(self._guarded, action, "work")

    def _break_off(self) -> None:
        """Wake the loop."""
        self.recess.end()

    def drain(self) -> None:
        """Run what other threads posted, then what the node has to do between callbacks."""
        while self._inbox:
            self._guarded(self._inbox.popleft(), "take a result")
        self._guarded(self.work, "work")

    def work(self) -> None:
        """Do what callbacks left to do; called after every callback."""

    def due_s(self) -> float:
        """Return after which time `work` wants to be called without a callback [s]."""
        return SPIN_S


_SUCCESS = TransitionCallbackReturn.SUCCESS
_FAILURE = TransitionCallbackReturn.FAILURE


def make_executor(kind: str) -> Executor:
    """Return the executor of that name."""
    return EventsExecutor() if kind == "events" else SingleThreadedExecutor()


def spin(node: ValveNode, executor: Executor) -> None:
    """Drive the node until a signal or the end of the context; no callback error ends it."""
    while rclpy.ok() and not termination.stop_requested() and node.exit_code is None:
        try:
            _spin(node, executor, min(node.due_s(), SPIN_S))
        except (ExternalShutdownException, ROSInterruptException, KeyboardInterrupt):
            return
        except Exception as err:
            if not rclpy.ok():
                return
            node.get_logger().error(f"{type(err).__name__}: {err}\n{traceback.format_exc()}")
        node.drain()


def _spin(node: ValveNode, executor: Executor, wait_s: float) -> None:
    """Run one callback; where they work by themselves, all that come until something is due.

    Every return of the events executor costs as much as a message.
    """
    if not node.works_in_callbacks or isinstance(executor, SingleThreadedExecutor):
        executor.spin_once(timeout_sec=wait_s)
        return
    node.recess.spin(executor, wait_s)


def _collect_garbage() -> None:
    """Collect what the start left, once; what it made stays, so later collections are short."""
    gc.collect()
    gc.freeze()
    gc.enable()


def run(make: Callable[[], ValveNode], args: list[str] | None = None) -> int:
    """Make a node and run it until SIGTERM or SIGINT.

    Parameters
    ----------
    make : callable
        Makes the node.
    args : list of str, optional
        Command line, default `sys.argv`.

    Returns
    -------
    int
        Exit code: 0, or 1 where the node could not be made.
    """
    termination.install()
    ros.log_without_sources()
    with termination.put_off():
        try:
            rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
            node = make()
        except Exception as err:
            reason = ros.without_place(err)
            rclpy.logging.get_logger("valve_twin").error(f"cannot start: {reason}")
            return _leave(1, [])
        executor = make_executor(node.parameters.read(NodeParameters).executor)
        executor.add_node(node)
        node.post(node.start)
        node.post(_collect_garbage)
        termination.looping()
        termination.install()
    spin(node, executor)
    termination.ignore()
    node.stop()
    code, held = node.exit_code or 0, [node, executor]
    del node, executor
    return _leave(code, held)


def _leave(code: int, held: list[Any]) -> int:
    """Say goodbye and end the process here.

    Peers keep a participant that goes without a word until its lease ends, 20 s later, and a
    lossless publisher waits for it; so node and executor are destroyed, in `held` the last
    references to them. Should that hang, as destructors of the middleware may, a timer ends the
    process. What weak references of libraries complain of while all goes tells nobody anything.
    """
    sys.unraisablehook = _say_nothing
    end = threading.Timer(FAREWELL_S, interpreter.leave, (code,))
    end.daemon = True
    end.start()
    try:
        if held:
            _destroy(held)
        rclpy.try_shutdown()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        interpreter.leave(code)


def _say_nothing(_: object) -> None:
    pass


def _destroy(held: list[Any]) -> None:
    """Destroy node and executor; the participant goes with the last thing that refers to it."""
    node, executor = held
    held.clear()
    with suppress(Exception):
        executor.remove_node(node)
        node.destroy_node()
        ros.destroy_state_machine(node)
    del node, executor
    gc.collect()
