# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The 44 scenarios of step I of the benchmark, and a healthy day beside them.

Abrupt faults small, medium and big (S, M, B) and incipient ones (I), as the library's generator
sets them; names are ours, such as f13I.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from valve_twin.core.valves.damadics.record import Fault

SET_UP_S = 300.0
"""What comes before counts for no index [s]."""
ONSET_S = 900.0
"""When every fault starts [s]."""
AFTER_S = 600.0
"""How long after the fault has grown the indices go on [s]."""
DAY = "healthy"
"""Name of the healthy day."""

_SIZES = {"S": 0.25, "M": 0.5, "B": 0.75}
_ABRUPT = {
    1: "SMB", 2: "B", 7: "SMB", 8: "SMB", 10: "SMB", 11: "B", 12: "SMB", 13: "SMB", 14: "SMB",
    15: "B", 16: "SMB", 17: "B", 18: "SMB", 19: "SMB",
}  # fmt: skip
_DAY_S, _HOUR_S, _QUARTER_S = 86400.0, 3600.0, 900.0
_INCIPIENT = {
    2: _DAY_S, 3: _DAY_S, 4: _HOUR_S, 5: _DAY_S, 6: _DAY_S, 9: _DAY_S, 11: _DAY_S, 13: _QUARTER_S,
    17: _HOUR_S, 18: _DAY_S,
}  # fmt: skip
_NEGATIVE = (12, 14, 19)
_LONG_HORIZON_S = 84000.0 + AFTER_S  # the horizon takes the long ramp for 84000 s
_CONSISTENT = (4,)  # the library's chamber becomes singular there


@dataclass(frozen=True, slots=True)
class Scenario:
    """One run of the benchmark.

    Attributes
    ----------
    name : str
        Fault and size, such as "f13I".
    faults : tuple of Fault
        None or one.
    horizon_s : float
        End of the indices [s].
    consistent : bool
        Whether the air chamber is the consistent one.
    """

    name: str
    faults: tuple[Fault, ...]
    horizon_s: float
    consistent: bool = False

    @property
    def number(self) -> int:
        """Number of the fault, 0 = none."""
        return self.faults[0].number if self.faults else 0

    @property
    def onset_s(self) -> float:
        """When the fault starts [s]; the end of the run where there is none."""
        return self.faults[0].start_s if self.faults else self.horizon_s

    def later(self, delay_s: float) -> Scenario:
        """Return the scenario with everything after the set-up later [s]."""
        faults = tuple(replace(f, start_s=f.start_s + delay_s) for f in self.faults)
        return replace(self, faults=faults, horizon_s=self.horizon_s + delay_s)


def scenarios() -> tuple[Scenario, ...]:
    """Return the 44 scenarios in the order of their faults."""
    found = []
    for number in range(1, 20):
        sign = -1.0 if number in _NEGATIVE else 1.0
        consistent = number in _CONSISTENT
        for size in _ABRUPT.get(number, ""):
            fault = Fault(number, sign * _SIZES[size], ONSET_S)
            end = ONSET_S + AFTER_S
            found.append(Scenario(f"f{number}{size}", (fault,), end, consistent))
        if number in _INCIPIENT:
            rise = _INCIPIENT[number]
            fault = Fault(number, sign, ONSET_S, rise)
            end = ONSET_S + (_LONG_HORIZON_S if rise == _DAY_S else rise + AFTER_S)
            found.append(Scenario(f"f{number}I", (fault,), end, consistent))
    return tuple(found)


def healthy_day(*, consistent: bool = False) -> Scenario:
    """Return a day without a fault, as long as the longest scenario."""
    return Scenario(DAY, (), ONSET_S + _LONG_HORIZON_S, consistent)


def long_scenarios() -> tuple[Scenario, ...]:
    """Return the scenarios that last a day, with the consistent chamber."""
    day = healthy_day().horizon_s
    return tuple(replace(s, consistent=True) for s in scenarios() if s.horizon_s == day)
