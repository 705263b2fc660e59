# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What of a record could be used, and whether its results may be relied on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.core.aging.verdict import VerdictKind
from valve_twin.core.diagnosis.checks import failed_checks
from valve_twin.core.types import EstimateStatus

if TYPE_CHECKING:
    from valve_twin.core.aging import Assessment
    from valve_twin.io.offline.run import Record

MOST_LOST = 0.05
"""Share of lost samples above which a record is doubtful [1], as of one cycle."""


def describe_use(record: Record) -> str:
    """Return how much of a record could be used, in one clause: cycles, refused, lost samples.

    Parameters
    ----------
    record : Record
        What an offline run found.
    """
    refused = sum(e.status is EstimateStatus.REFUSED for e in record.estimates if e.used_by_trend)
    samples, lost = sum(c.samples for c in record.cycles), sum(c.lost for c in record.cycles)
    text = f"{len(record.cycles)} cycles"
    text += f", {refused} refused" if refused else ""
    return f"{text}, {lost} of {samples + lost} samples lost" if lost else text


def is_doubtful(record: Record, assessment: Assessment) -> bool:
    """Return whether what was found must not be relied on.

    It is where no cycle gave an estimate, the recording is unusable, checks fail in half of the
    newest cycles, or more than `MOST_LOST` of the samples are lost.

    Parameters
    ----------
    record : Record
        What an offline run found.
    assessment : Assessment
        Its trends and verdict.
    """
    given = [e for e in record.estimates if e.used_by_trend]
    if all(e.status is EstimateStatus.REFUSED for e in given):
        return True
    samples, lost = sum(c.samples for c in record.cycles), sum(c.lost for c in record.cycles)
    unusable = assessment.verdict.kind is VerdictKind.RECORDING_UNUSABLE
    return unusable or bool(failed_checks(given)) or lost > MOST_LOST * (samples + lost)
