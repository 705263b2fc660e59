# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Why a cycle gives no estimate: a line to read, and a code to count, compare and act on.

The line holds the numbers of the cycle and may be worded anew; the code is stable. Messages, the
history and files of results keep both: `reason` and `reason_code` of an estimate.
"""

from __future__ import annotations

from enum import Enum


class RefusalCode(str, Enum):
    """Kinds of refusals; none is ever renamed, as histories hold them."""

    CYCLE_TOO_SHORT = "cycle_too_short"
    """The cycle ended before it had enough samples, or the record ended inside it."""

    WRONG_PERIOD = "wrong_period"
    """The stamps are not `period_s` apart, or that is too long for the equations."""

    FEW_SAMPLES = "few_samples"
    """Too few samples that can be used."""

    GAPS = "gaps"
    """Samples are missing where the equations need them without a gap."""

    LATE = "late_signals"
    """Samples of a signal that cuts the cycles came too late: begin and end are guessed."""

    IMPLAUSIBLE = "implausible_signals"
    """Signals that cannot be what is configured: swapped, inverted, in another unit."""

    OPTIONS = "options"
    """Options that contradict each other or the signals."""

    NO_MOTION = "no_motion"
    """The valve moved less than an estimate needs."""

    NOT_EXCITED = "not_excited"
    """The commands do not show what is asked for: constant, or of one level only."""

    LAG_UNKNOWN = "lag_unknown"
    """The delay from command to position is not known."""

    NO_CONVERGENCE = "no_convergence"
    """The solver found no minimum."""

    MISFIT = "misfit"
    """The equations do not explain what was measured."""

    FAILED = "failed"
    """The model's own code raised an error: a defect of it."""

    OTHER = "other"
    """What only the line says."""


class Refusal(str):
    """A line that says why a cycle gives no estimate, with its code.

    Parameters
    ----------
    code : RefusalCode
        Which kind.
    text : str
        The line.
    """

    __slots__ = ("code",)
    code: RefusalCode

    def __new__(cls, code: RefusalCode, text: str) -> Refusal:
        """Make the line."""
        made = super().__new__(cls, text)
        made.code = code
        return made

    def __getnewargs__(self) -> tuple[RefusalCode, str]:  # type: ignore[override]
        """Return what a copy or another process makes it from."""
        return self.code, str(self)


def code_of(reason: str) -> str:
    """Return the code of a refusal; of a plain line that of `RefusalCode.OTHER`."""
    return reason.code.value if isinstance(reason, Refusal) else RefusalCode.OTHER.value
