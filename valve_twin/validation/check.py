# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One published number beside the number that we obtain, and what that is evidence of."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


class Verdict(Enum):
    """What a comparison says."""

    PASS = "pass"
    FAIL = "FAIL"
    CANNOT = "cannot be reproduced"


class Kind(Enum):
    """What a comparison is evidence of."""

    PUBLISHED = "published"
    """A printed number or statement beside what our model computes."""
    DERIVED = "derived"
    """What follows from the paper's own numbers and equations: its consistency, not our model."""
    REGRESSION = "regression"
    """Our number beside an earlier or independent one of ours: says nothing about the paper."""


@dataclass(frozen=True, slots=True)
class Check:
    """A published number, ours, and whether the two agree.

    Attributes
    ----------
    item : str
        Where it is published, e.g. "Table 1".
    quantity : str
        What it is.
    published : float or str
        The published value, or statement [unit of the quantity].
    obtained : float
        Ours [unit of the quantity]; NaN where nothing can be computed.
    lower, upper : float
        Limits within which ours agrees [unit of the quantity]; NaN where it cannot be tested.
    tolerance : str
        Where the limits come from, in words.
    note : str
        The reading or the regime; why it cannot be reproduced.
    kind : Kind
        What it is evidence of.
    """

    item: str
    quantity: str
    published: float | str
    obtained: float
    lower: float = math.nan
    upper: float = math.nan
    tolerance: str = "-"
    note: str = ""
    kind: Kind = Kind.PUBLISHED

    @property
    def verdict(self) -> Verdict:
        """Pass inside the limits, fail outside or not finite; cannot without limits."""
        if math.isnan(self.lower) or math.isnan(self.upper):
            return Verdict.CANNOT
        return Verdict.PASS if self.lower <= self.obtained <= self.upper else Verdict.FAIL


def within_share(item: str, quantity: str, published: float, obtained: float, share: float,
                 note: str = "", kind: Kind = Kind.PUBLISHED) -> Check:  # fmt: skip
    """Agree within a relative tolerance `share` [1] of the published value.

    Parameters
    ----------
    item, quantity : str
        Where it is published and what it is.
    published, obtained : float
        Both numbers [unit in `quantity`].
    share : float
        Relative tolerance [1].
    note : str
        Remark.
    kind : Kind
        What it is evidence of.
    """
    half = abs(published) * share
    return Check(
        item,
        quantity,
        published,
        obtained,
        published - half,
        published + half,
        f"{100.0 * share:g} %" if share > 1e-6 else "exact",
        note,
        kind,
    )


def within_factor(item: str, quantity: str, published: float, obtained: float, factor: float,
                  note: str = "", kind: Kind = Kind.PUBLISHED) -> Check:  # fmt: skip
    """Agree within a factor [1], the sign included.

    Parameters
    ----------
    item, quantity : str
        Where it is published and what it is.
    published, obtained : float
        Both numbers [unit in `quantity`].
    factor : float
        Largest ratio of both [1].
    note : str
        Remark.
    kind : Kind
        What it is evidence of.
    """
    ends = sorted((published / factor, published * factor))
    tolerance = f"factor {factor:g}"
    return Check(item, quantity, published, obtained, ends[0], ends[1], tolerance, note, kind)


def within_range(
    item: str,
    quantity: str,
    published: float | str,
    obtained: float,
    *,
    lower: float = -math.inf,
    upper: float = math.inf,
    note: str = "",
    kind: Kind = Kind.PUBLISHED,
) -> Check:
    """Agree between two limits; an infinite one does not bind.

    Parameters
    ----------
    item, quantity : str
        Where it is published and what it is.
    published : float or str
        What is published [unit in `quantity`].
    obtained : float
        Our number [unit in `quantity`].
    lower, upper : float
        Limits [unit in `quantity`].
    note : str
        Remark.
    kind : Kind
        What it is evidence of.
    """
    if math.isinf(lower):
        words = f"at most {upper:.3g}"
    elif math.isinf(upper):
        words = f"at least {lower:.3g}"
    else:
        words = f"{lower:.3g} .. {upper:.3g}"
    return Check(item, quantity, published, obtained, lower, upper, words, note, kind)


def cannot(item: str, quantity: str, published: float | str, obtained: float, why: str) -> Check:
    """Say that a published number cannot be reproduced, and why.

    Parameters
    ----------
    item, quantity : str
        Where it is published and what it is.
    published : float or str
        What is published [unit in `quantity`].
    obtained : float
        Our number [unit in `quantity`].
    why : str
        Reason.
    """
    return Check(item, quantity, published, obtained, note=why)


def counted(checks: Sequence[Check]) -> str:
    """Return in one line how many comparisons of each kind agree, fail, and cannot be made."""
    parts = []
    for kind in Kind:
        found = [c.verdict for c in checks if c.kind is kind and c.verdict is not Verdict.CANNOT]
        failed = found.count(Verdict.FAIL)
        parts.append(f"{kind.value}: {len(found) - failed} agree, {failed} do not")
    missing = sum(c.verdict is Verdict.CANNOT for c in checks)
    return f"{'; '.join(parts)}; {missing} cannot be reproduced"
