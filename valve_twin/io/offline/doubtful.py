# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What of a record could be used, and whether its results may be relied on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.core.aging.verdict import VerdictKind
from valve_twin.core.diagnosis.checks import failed_checks
from valve_twin.core.types import EstimateStatus

if TYPE_CHECKING:
    from valve_twin.core.aging.assess import Assessment
    from valve_twin.io.offline.run import Record

MOST_LOST = 0.05
"""Share of lost samples above which a record is doubtful [1], as of one cycle."""


def describe_use(record: Record) -> str:
    """Return how much of a record could be used, in one clause: cycles, refused, lost samples.

    What is missing in a pause, as between two files, is told apart from what is lost.

    Parameters
    ----------
    record : Record
        What an offline run found.
    """
    refused = sum(e.status is EstimateStatus.REFUSED for e in record.estimates if e.used_by_trend)
    samples, lost = _samples(record)
    text = f"{len(record.cycles)} cycles"
    text += f", {refused} refused" if refused else ""
    text += f", {lost} of {samples + lost} samples lost" if lost else ""
    return f"{text}, {record.paused} more in pauses" if record.paused else text


def is_doubtful(record: Record, assessment: Assessment) -> bool:
    """Return whether what was found must not be relied on.

    It is where no cycle gave an estimate, the recording is unusable, checks fail in half of the
    newest cycles, or more than `MOST_LOST` of the samples are lost, pauses not counted.

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
    samples, lost = _samples(record)
    unusable = assessment.verdict.kind is VerdictKind.RECORDING_UNUSABLE
    return unusable or bool(failed_checks(given)) or lost > MOST_LOST * (samples + lost)


def _samples(record: Record) -> tuple[int, int]:
    """Return how many samples the cycles have, and how many they lost outside pauses."""
    lost = sum(c.lost for c in record.cycles) - record.paused
    return sum(c.samples for c in record.cycles), lost
