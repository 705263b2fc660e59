# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Notice that a reliable subscription hears nothing where a best-effort one does.

A reliable reader of Fast DDS hands on nothing behind a message of 0 bytes: its receiver drops the
message ("Serialized Payload value invalid", MessageReceiver.cpp, `payload_size > 0`; so in 2.14
and on the main branch of August 2026) without marking it as received, asks for it for ever and
is sent it for ever, until it has left the publisher's history; with a deep one it never does. No
executor and no callback is asked. Only that publisher's messages are concerned; a best-effort
reader goes on. So where a topic falls silent that was not, a best-effort reader is put beside the
reliable one until that is heard again. Hears it something, the reliable one is told to pass over
what is missing (`transport/pass_over.py`): what came behind lies there, and nothing is lost. Where
it cannot be told, it is made anew.

The same where a reader hears nothing from its start on. One that follows a killed process on the
port of the dead one is matched and may get nothing for seconds, because the publisher owes the
dead one's memory first: of 70 readers started so under load 13 heard nothing for more than a
second, up to 9 s; a best-effort reader beside them heard at once, a reliable one that was made
anew a second later within 0.2 s.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any, ClassVar
from weakref import WeakSet

from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible

if TYPE_CHECKING:
    from collections.abc import Callable

LOOK_S = 0.1
"""How often silence is looked at [s]."""

QUIET_S = 0.3
"""A topic that was never quiet for longer is silent after this [s]."""

START_S = 1.0
"""A reader whose publisher is there and that never heard anything is doubted after this [s]."""

PATIENCE_S = 0.2
"""So much later than the second reader the first one may hear [s]."""

PASSED_S = 0.3
"""A reader that was told to pass over what is missing is heard within this, or deaf [s]."""

RESENT_S = 7.0
"""The same where nothing may be lost: what was lost on the way is asked for every 3 s, and once
may be lost, too [s]."""

RUSH_S = 1.0
"""Data time beyond twice the time that passed which tells of a rush [s]."""

STALL_S = 5.0
"""Data time that was owed so may come at once: what waited while this process had no core [s]."""

LATE_S = 0.75
"""A look that comes so much late tells that this process is behind: what came meanwhile may have
found no room on the way [s]."""

CALM_S = 30.0
"""A rush is over so long after its last sign. So long, too, a process that was behind waits where
several of its readers hear nothing: some of 150 were sent after 16 s what they lacked [s]."""

SMOOTHING = 0.1
"""Weight of the last pause in the usual one [1]; of the first ones that of their mean: a topic of
a message a second had a second reader made and destroyed after each of its first seven."""

MOST_KEPT = 10_000
"""Messages of the second reader that are kept until it is clear that the first is deaf [1]."""


_POLICIES = {
    "durability": "DURABILITY",
    "deadline": "DEADLINE",
    "liveliness": "LIVELINESS",
    "liveliness_lease_duration": "LIVELINESS",
    "reliability": "RELIABILITY",
}


def refused_policy(offered: QoSProfile, asked: QoSProfile) -> str:
    """Return the policy in which a publisher offers less than is asked for, empty if in none.

    Parameters
    ----------
    offered, asked : QoSProfile
        Of the publisher and of the subscription, which hears nothing of it then.
    """
    refused = ""
    for name, policy in _POLICIES.items():
        pair = [QoSProfile(depth=1, **{name: getattr(qos, name)}) for qos in (offered, asked)]
        if qos_check_compatible(*pair)[0] == QoSCompatibility.ERROR:
            refused = policy
    return refused


class Pace:
    """Whether data come faster than a plant gives or than this process takes them.

    Then losses on the way are usual: a reliable reader hears late what is sent again, and one that
    is made anew never does.
    """

    def __init__(self) -> None:
        self._newest_ns: int | None = None
        self._looked_s, self._behind_s = float("inf"), -float("inf")
        self._at_s = self._ahead_s = 0.0
        self._rush_s = -float("inf")

    def note(self, newest_ns: int, now_s: float) -> None:
        """Note samples that came.

        Parameters
        ----------
        newest_ns : int
            Their last stamp [ns].
        now_s : float
            The steady clock [s].
        """
        if self._newest_ns is not None:
            data_s = 1e-9 * (newest_ns - self._newest_ns)
            self._ahead_s = max(-STALL_S, self._ahead_s + data_s - 2.0 * (now_s - self._at_s))
        if self._ahead_s > RUSH_S:
            self._ahead_s, self._rush_s = 0.0, now_s
        self._newest_ns, self._at_s = newest_ns, now_s

    def look(self, now_s: float) -> None:
        """Note a look, which is due every `LOOK_S` [s]."""
        if now_s - self._looked_s > LOOK_S + LATE_S:
            self._behind_s = now_s
        self._looked_s = now_s

    def is_rush(self, now_s: float) -> bool:
        """Return whether they did a short while ago [s]."""
        return now_s - self._rush_s < CALM_S

    def patience_s(self, now_s: float, *, alone: bool = True) -> float:
        """Return how long a reader that hears nothing is waited for [s].

        Parameters
        ----------
        now_s : float
            The steady clock [s].
        alone : bool
            Whether it is the only one of this process: a message of 0 bytes concerns one.
        """
        if not alone and now_s - self._behind_s < CALM_S:
            return CALM_S
        return RESENT_S if self.is_rush(now_s) else PATIENCE_S


class SecondReader:
    """What watches one reliable subscription; looked after every `LOOK_S`.

    Parameters
    ----------
    subscribe : callable
        Makes a best-effort subscription of the same topic that calls back what it is given.
    destroy : callable
        Destroys it.
    deliver : callable
        Takes a message of a second reader whose first is deaf, as the first's callback does.
    start_s : float
        A first reader that never heard anything is doubted after this [s].
    pass_over : callable, optional
        Gets the last message of the second and tells the first that what is missing before it
        will not come; returns whether it could.
    most_kept : int
        So many messages of the second are kept for `deliver` [1].

    Attributes
    ----------
    heard : bool
        To be set when the first reader has heard something.
    stands_in : bool
        Whether the second reader delivers in place of the first.
    """

    _doubted: ClassVar[WeakSet[SecondReader]] = WeakSet()  # whose second hears something

    def __init__(
        self,
        subscribe: Callable[[Callable[..., None]], Any],
        destroy: Callable[[Any], object],
        deliver: Callable[..., None],
        start_s: float = START_S,
        *,
        pass_over: Callable[[tuple[Any, ...]], bool] | None = None,
        most_kept: int = MOST_KEPT,
    ) -> None:
        self._subscribe, self._destroy, self._deliver = subscribe, destroy, deliver
        self._start_s, self._pass_over = start_s, pass_over
        self._reader: Any = None
        self._kept: deque[tuple[Any, ...]] = deque(maxlen=most_kept)
        self._passed_s: float | None = None
        self._since_s: float | None = None
        self._last_s: float | None = None
        self._expected_s: float | None = None
        self._usual_s, self._pauses = 0.0, 0
        self.stands_in = False
        self.heard = False

    @property
    def never_heard(self) -> bool:
        """Whether the first reader has not heard anything yet."""
        return self._last_s is None

    @property
    def is_open(self) -> bool:
        """Whether the second reader listens."""
        return self._reader is not None

    @property
    def passed(self) -> bool:
        """Whether the first reader was told to pass over what is missing and is not heard yet."""
        return self._passed_s is not None

    def expect(self, now_s: float) -> None:
        """Note that a publisher is there, so that something is to be heard [s]."""
        if self._expected_s is None:
            self._expected_s = now_s

    def is_due(self, now_s: float) -> bool:
        """Return whether a look could change something; told of most silent topics at once [s]."""
        if self.heard:
            return True
        if self._reader is not None:
            return bool(self._kept)
        return self._last_s is None or self._is_silent(now_s)

    @property
    def is_alone(self) -> bool:
        """Whether no other reader of this process hears nothing where its second does."""
        return not any(other is not self for other in self._doubted)

    def look(self, now_s: float, patience_s: float = PATIENCE_S) -> bool:
        """Look after the silence.

        Parameters
        ----------
        now_s : float
            The steady clock [s].
        patience_s : float
            So much later than the second the first may hear [s].

        Returns
        -------
        bool
            True once the first reader is deaf and could not be helped: to be made anew. Until
            that one is heard, the second stands in for it.
        """
        if self.heard:
            if self._last_s is not None:
                self._pauses += 1
                weight = max(SMOOTHING, 1.0 / self._pauses)
                self._usual_s += weight * (now_s - self._last_s - self._usual_s)
            self._last_s, self.heard = now_s, False
            self.close()
        elif self._reader is not None:
            return self._is_deaf(now_s, patience_s)
        elif self._is_silent(now_s):
            self._reader = self._subscribe(self._on_message)
        return False

    @property
    def newest(self) -> tuple[Any, ...]:
        """The last message that is kept, as its callback got it; empty where none is."""
        return self._kept[-1] if self._kept else ()

    def hand_over(self) -> None:
        """Deliver what the second reader kept and the first has not heard."""
        while self._kept:
            self._deliver(*self._kept.popleft())

    def close(self) -> None:
        """Take the second reader down; what it kept the first has heard."""
        reader, self._reader = self._reader, None
        self._since_s, self._passed_s, self.stands_in = None, None, False
        self._doubted.discard(self)
        self._kept.clear()
        if reader is not None:
            self._destroy(reader)

    def _is_silent(self, now_s: float) -> bool:
        if self._last_s is not None:
            return now_s - self._last_s >= max(QUIET_S, 2.0 * self._usual_s)
        return self._expected_s is not None and now_s - self._expected_s >= self._start_s

    def _is_deaf(self, now_s: float, patience_s: float) -> bool:
        if self.stands_in or not self._kept:
            return False
        if self._since_s is None:
            self._since_s = now_s
            self._doubted.add(self)
        if now_s - self._since_s < patience_s:
            return False
        if self._passed_s is None and self._pass_over and self._pass_over(self.newest):
            self._passed_s = now_s
        if self._passed_s is not None and now_s - self._passed_s < PASSED_S:
            return False
        self.stands_in = True
        self._doubted.discard(self)
        self.hand_over()
        return True

    def _on_message(self, *arguments: Any) -> None:
        if self.stands_in:
            self._deliver(*arguments)
        else:
            self._kept.append(arguments)
