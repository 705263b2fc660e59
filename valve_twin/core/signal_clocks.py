# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Notice that the signals of a valve are stamped by clocks that run apart.

By how much a clock is ahead is the stamp of a sample less the time at which it was received; what
two signals differ in that is the offset between their clocks, and beyond the time by which the
twin waits for a signal nothing of them fits together.
"""

from __future__ import annotations

from dataclasses import dataclass

LOOKS = 3
"""So many looks one after another have to find the same offset [1]."""

SAME, SAME_S = 0.2, 1.0
"""Offsets that differ by no more than this share, or time, are the same [1], [s]."""

FORGOTTEN = 30
"""An offset is forgotten after so many looks without a sample to tell it by [1]."""

LATENESS_S = 60.0
"""A signal that is behind by less may only be late [s]."""


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """The clock of one signal against that of the position.

    Attributes
    ----------
    signal, output : str
        The signal and the position.
    offset_s : float
        By how much the signal's stamps are ahead [s].
    unstamped : str
        Which of both carries no stamps and is given the time at which it is received; empty =
        none, or both.
    """

    signal: str
    output: str
    offset_s: float
    unstamped: str = ""

    def __str__(self) -> str:
        """Return in one line what is wrong and what to do."""
        where = "ahead of" if self.offset_s > 0.0 else "behind"
        what = f"signal {self.signal} is stamped {abs(self.offset_s):.4g} s {where} {self.output}"
        if self.unstamped:
            return (
                f"{what}: {self.unstamped} carries no stamps and is given the time at which it is "
                "received: publish it with a header, synchronise the clocks, or set use_sim_time "
                "to true where the other's stamps come from a simulation or a bag"
            )
        late = (
            f", or raise hold_back_s above {-self.offset_s:.3g} if it only arrives late"
            if -LATENESS_S < self.offset_s < 0.0
            else ""
        )
        return (
            f"{what}: their clocks differ: synchronise them (chrony) or stamp both on one "
            f"computer{late}"
        )


class SignalClocks:
    """Offsets between the clocks of a valve's signals.

    Parameters
    ----------
    output : str
        The position, with which the others are compared.
    limit_s : float
        Offset that does no harm [s].
    looks : int
        So many looks one after another have to find the same offset [1].
    """

    def __init__(self, output: str, limit_s: float, looks: int = LOOKS) -> None:
        self._output, self._limit_s, self._looks = output, limit_s, looks
        self._fresh: dict[str, tuple[float, bool]] = {}
        self._found: dict[str, tuple[int, ClockOffset]] = {}
        self._since: dict[str, int] = {}

    def note(self, signal: str, ahead_ns: float, *, has_header: bool) -> None:
        """Note a sample.

        Parameters
        ----------
        signal : str
            Its signal.
        ahead_ns : float
            Its stamp less the time at which it was received [ns].
        has_header : bool
            Whether the stamp is its own.
        """
        self._fresh[signal] = (1e-9 * ahead_ns, has_header)

    def look(self) -> list[ClockOffset]:
        """Return the offsets that stand, by what was noted since the last look.

        Of a signal that fell silent nothing is known any more.
        """
        fresh, self._fresh = self._fresh, {}
        for signal in tuple(self._found):
            self._since[signal] += 1
            if self._since[signal] > FORGOTTEN:
                del self._found[signal]
        if self._output in fresh:
            reference_s, stamped = fresh.pop(self._output)
            for signal, (ahead_s, has_header) in fresh.items():
                unstamped = "" if has_header == stamped else self._output if has_header else signal
                offset = ClockOffset(signal, self._output, ahead_s - reference_s, unstamped)
                self._judge(offset)
        return [offset for count, offset in self._found.values() if count >= self._looks]

    def _judge(self, offset: ClockOffset) -> None:
        count, before = self._found.get(offset.signal, (0, offset))
        if abs(offset.offset_s) <= self._limit_s:
            self._found.pop(offset.signal, None)
            return
        same_s = max(SAME * abs(before.offset_s), SAME_S)
        same = abs(offset.offset_s - before.offset_s) <= same_s
        self._since[offset.signal] = 0
        self._found[offset.signal] = (count + 1 if same else 1, offset)
