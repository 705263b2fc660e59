#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Write docs/validation.md from what `validate` computes: tools/run python tools/validation.py."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.validation import Verdict, counted, get_paper, paper_numbers

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.validation import Check

TARGET = Path(__file__).resolve().parents[1] / "docs" / "validation.md"

_HEAD = """# The papers' numbers, recomputed

Written from what `valve-twin validate` computes by `tools/validation.py`; do not edit.

    valve-twin validate            # every paper
    valve-twin validate 002        # one
    valve-twin validate 002 --json # one object a comparison

Each row says what is expected, what we obtain, the tolerance, and the verdict: `pass`, `FAIL`,
or `cannot be reproduced` with the reason. The exit code is 1 if one row that can be reproduced
does not agree, else 0. What a row is evidence of:

- **published**: a number or statement that the paper prints, beside what our model computes;
- **derived**: what follows from the paper's own numbers and equations: whether it agrees with
  itself;
- **regression**: our number beside an earlier or independent one of ours: it notices a change
  and says nothing about the paper. No row compares a typed number with itself.

A further paper is one module under `valve_twin/validation/` that exports `PAPER`, and one line
in its registry.
"""

_ABOUT = {
    "000": "The paper prints no parameter and no axis in units: its statements are tested on an "
    "assumed valve, with the model itself in the place of the field computation.",
    "001": "Forces, currents and flights follow from the printed parameters; the static table "
    "and one finite-element current contradict the rest of the text.",
    "002": "The measured data are not public. Tables 3 to 5 and the pole follow from the paper's"
    " own numbers; Table 1 and Figs. 4 to 6 are recomputed on the simulated reference "
    "experiment: 105 aging cycles (429 to 533, filling pilot area -15 %), random refresh "
    "phase and noise in each, mean over all cycles, nothing picked. Two measurement "
    "layers make least squares err as published: a sensor refreshed every third or every "
    "fourth sample, with 0.4 % noise. That the real sensor did so is a plausible reading,"
    " not a known cause.\n\n![Mean spectrum of the residuals of both "
    "layers](images/paper_002_spectrum.svg)",
    "003": "The paper prints figures without parameter values. The step response is compared "
    "with an independent integration of the same equations by another program; figures 8 "
    "to 18 of our valve, a step of 10 mm:\n\n![Figures 8 to 18 recomputed: current, valve "
    "position, positions, speeds, force, pressures](images/paper_003_step.svg)",
    "004": "The measured data are not public. The identified model cannot be checked; the gains "
    "and the law of the steps can, and tracking and the velocity sweep are run on the "
    "simulated valve.\n\n![Velocity sweep, steps of 1.8 mm at 1 and 3 Hz, magnitude of the "
    "printed G(z)](images/paper_004_tracking.svg)",
}


def document(checks: Mapping[str, Sequence[Check]]) -> str:
    """Return the document in Markdown.

    Parameters
    ----------
    checks : mapping
        The comparisons by number of the paper.
    """
    parts = [_HEAD]
    for number, found in checks.items():
        parts += [
            f"## Paper {number}, {get_paper(number).title}\n",
            f"{_ABOUT[number]}\n",
            f"{counted(found)[:1].upper()}{counted(found)[1:]}.\n",
            "| where | quantity | expected | obtained | tolerance | kind | verdict, how or why |",
            "| --- | --- | --- | --- | --- | --- | --- |",
            *(_row(check) for check in found),
            "",
        ]
    return "\n".join(parts)


def _row(check: Check) -> str:
    verdict = check.verdict.value
    if check.verdict is Verdict.PASS and check.note:
        verdict = f"{verdict}: {check.note}"
    elif check.note:
        verdict = f"**{verdict}**: {check.note}"
    cells = (
        check.item,
        check.quantity,
        _number(check.published),
        _number(check.obtained),
        check.tolerance,
        check.kind.value if check.verdict is not Verdict.CANNOT else "-",
        verdict,
    )
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def _number(value: float | str) -> str:
    if isinstance(value, str):
        return value
    if not math.isfinite(value):
        return "-"
    return "0" if abs(value) < 1e-15 else f"{value:.3g}"


def main() -> None:
    """Compute everything and write the document."""
    checks = {n: get_paper(n).recompute(lambda: None) for n in paper_numbers()}
    TARGET.write_text(document(checks), encoding="utf-8")
    print(f"{TARGET} written")


if __name__ == "__main__":
    main()
