# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A live table of one valve's twin and aging monitor in the terminal."""

from __future__ import annotations

import math
import signal
import time
from collections import deque
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING, Any

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from valve_twin_msgs.msg import Estimate, Trend, Verdict

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

ROWS = 12
"""Cycles in the table."""

BESIDE = 32
"""Letters of a row of the table beside the parameters' columns."""

EVERY = 10
"""Without a terminal, one line is printed every so many cycles."""

STATUS = {Estimate.ACCEPTED: "accepted", Estimate.PARTIAL: "in part", Estimate.REFUSED: "refused"}

_LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Watcher(Node):
    """Subscriber of estimates, trends and the verdict of one valve."""

    def __init__(self, namespace: str) -> None:
        super().__init__("watch", start_parameter_services=False)
        self.estimates: deque[Any] = deque(maxlen=ROWS)
        self.cycles: set[int] = set()
        self.trends: dict[str, Any] = {}
        self.verdict: Any = None
        here = namespace.rstrip("/")
        self.create_subscription(Estimate, f"{here}/twin/estimate", self._take, _LATCHED)
        self.create_subscription(Verdict, f"{here}/aging_monitor/verdict", self._judge, _LATCHED)
        self._trend_topics = f"{here}/aging_monitor/trend/"

    def follow_trends(self) -> None:
        """Subscribe to the trends that have appeared."""
        for topic, _ in self.get_topic_names_and_types():
            name = topic.removeprefix(self._trend_topics)
            if topic.startswith(self._trend_topics) and name not in self.trends:
                self.trends[name] = None
                self.create_subscription(Trend, topic, self._trend, _LATCHED)

    def _take(self, message: Any) -> None:
        if message.used_by_trend:
            self.estimates.append(message)
            self.cycles.add(int(message.cycle))

    def _trend(self, message: Any) -> None:
        self.trends[message.parameter] = message

    def _judge(self, message: Any) -> None:
        self.verdict = message


def watch(
    namespace: str,
    cycles: int,
    *,
    limit_s: float,
    alive: Callable[[], bool] = lambda: True,
    first: str = "",
) -> int:
    """Show a valve until enough cycles are estimated.

    Parameters
    ----------
    namespace : str
        The valve.
    cycles : int
        How many cycles to wait for.
    limit_s : float
        Longest time to wait [s].
    alive : callable
        Says whether waiting still makes sense.
    first : str
        Parameter that is shown before the others.

    Returns
    -------
    int
        Cycles seen.

    Raises
    ------
    KeyboardInterrupt
        If it is stopped by Ctrl-C or SIGTERM.
    """
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = Watcher(namespace)
    console = Console()
    live = Live(console=console, auto_refresh=False) if console.is_terminal else nullcontext()
    end = time.monotonic() + limit_s
    shown = 0
    try:
        with _signals_between_spins() as check, live as table:
            while len(node.cycles) < cycles and time.monotonic() < end and alive():
                check()
                rclpy.spin_once(node, timeout_sec=0.2)
                node.follow_trends()
                if table is not None:
                    table.update(render(node, cycles, first, console.width), refresh=True)
                elif len(node.cycles) >= shown + EVERY:
                    shown = len(node.cycles)
                    console.print(_line(node, cycles, first, console.width), highlight=False)
        if table is None:
            console.print(render(node, cycles, first, console.width))
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return len(node.cycles)


@contextmanager
def _signals_between_spins() -> Iterator[Callable[[], None]]:
    """Hold back Ctrl-C and SIGTERM; yield what raises KeyboardInterrupt once one has come.

    Where it is raised while rclpy makes a message, pybind11 turns it into a RuntimeError.
    """
    came: list[int] = []

    def check() -> None:
        if came:
            raise KeyboardInterrupt

    before = {
        number: signal.signal(number, lambda number, _frame: came.append(number))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield check
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    check()


def render(node: Watcher, cycles: int, first: str = "", width: int = 80) -> Group:
    """Return the present table with trends and verdict below, for a terminal of that width.

    Parameters
    ----------
    node : Watcher
        What has come so far.
    cycles : int
        Cycles that the demo waits for.
    first : str
        Parameter of the first column; empty = as followed.
    width : int
        Columns of the terminal [characters].
    """
    names = _shown(node, first, width - BESIDE)
    table = Table(title=f"{len(node.cycles)} of {cycles} cycles", expand=False)
    for title in ("cycle", *names, "fit %"):
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column("status", no_wrap=True)
    for e in node.estimates:
        values = dict(zip(e.names, e.values, strict=True))
        cells = [_number(values.get(n, math.nan)) for n in names]
        fit = "-" if math.isnan(e.fit_test) else f"{e.fit_test:.1f}"
        table.add_row(str(e.cycle), *cells, fit, STATUS[e.status])
    lines = [_trend_line(t) for t in node.trends.values() if t is not None and _known(t)]
    if node.verdict is not None:
        lines.append(f"verdict: {node.verdict.text}: {node.verdict.evidence}")
    return Group(table, *lines)


def _shown(node: Watcher, first: str, room: int) -> list[str]:
    """Return the followed parameters that have room, in letters; any before there are trends."""
    if not node.estimates:
        return []
    published = list(node.estimates[-1].names)
    names = [n for n in published if n in node.trends] or published
    names.sort(key=lambda name: name != first)
    widths = np.cumsum([max(len(n), 7) + 3 for n in names])
    return names[: max(1, int(np.searchsorted(widths, room, side="right")))]


def _known(trend: Any) -> bool:
    return not math.isnan(trend.drift_reference)


def _line(node: Watcher, cycles: int, first: str, width: int) -> str:
    last = node.estimates[-1]
    found = dict(zip(last.names, last.values, strict=True))
    values = ", ".join(f"{n} {_number(found[n])}" for n in _shown(node, first, width - BESIDE))
    return f"cycle {len(node.cycles)} of {cycles}: {values}"


def _trend_line(trend: Any) -> str:
    interval = f"{trend.drift_reference_lower_95:.1f} .. {trend.drift_reference_upper_95:.1f}"
    life = "unbounded" if trend.unbounded else f"{trend.remaining_high:.0f}"
    left = f"{trend.remaining_low:.0f} .. {life} {trend.axis} left"
    return f"{trend.parameter}: {trend.drift_reference:+.1f} % of new (95 %: {interval}); {left}"


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.4g}"
