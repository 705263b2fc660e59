# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Sudden faults of the valve and of what is around it, on the report page."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from valve_twin.core.diagnosis.detection import UNKNOWN
from valve_twin.core.diagnosis.table import BY_NAME
from valve_twin.report.tables import Table
from valve_twin.report.text import NONE, render

if TYPE_CHECKING:
    from valve_twin.core.aging import Assessment
    from valve_twin.core.diagnosis import Finding


def faults_section(assessment: Assessment | None) -> str:
    """Return the section of sudden faults; empty where none could be found.

    Parameters
    ----------
    assessment : Assessment or None
        What was found; None = not assessed.
    """
    if assessment is None or not (assessment.diagnosis.ready or assessment.diagnosis.findings):
        return ""
    found = assessment.diagnosis
    head = ["Fault", "Part", "Size", "Since cycle", "Alarm at cycle", "Over at cycle", "Or"]
    rows = [_row(f) for f in found.findings]
    return render("faults.html", found=Table(head, rows), cycles=found.cycles)


def _row(finding: Finding) -> list[str]:
    if finding.fault == UNKNOWN:
        name, size = "like no known fault", NONE
    else:
        kind = BY_NAME[finding.fault]
        unit = "" if kind.unit == "1" else f" {kind.unit}"
        name = kind.text
        size = f"{finding.severity:.2g}{unit}" if math.isfinite(finding.severity) else NONE
    others = ", ".join(BY_NAME[r].text for r in finding.rivals)
    return [
        name,
        finding.part,
        size,
        str(finding.onset),
        str(finding.alarm),
        str(finding.end) if finding.end >= 0 else "lasts",
        others or NONE,
    ]
