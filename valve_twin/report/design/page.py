# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The page of a search: front, chosen design against the reference, sensitivities."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import TYPE_CHECKING

from markupsafe import Markup

from valve_twin.report.text import render

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.report.tables import Table


@dataclass(frozen=True, slots=True)
class Side:
    """Pictures of one design as SVG documents.

    Attributes
    ----------
    name : str
        What it is.
    section, field, curves, steps : str
        Half section, flux density, force and flux linkage, steps of the loop.
    """

    name: str
    section: str
    field: str
    curves: str
    steps: str


@dataclass(frozen=True, slots=True)
class DesignPage:
    """What stands on the page.

    Attributes
    ----------
    title, summary : str
        Heading and what was reached, in words.
    front : str
        Picture of the search, an SVG document.
    figures, numbers : Table
        Figures of reference and front; numbers of reference and chosen design.
    sides : tuple of Side
        Reference and chosen design.
    effects : tuple
        Heading, picture (SVG document or empty), table and remark of each kind of sensitivity.
    files : tuple
        Name and what it is of each file that was written beside the page.
    notes : tuple of str
        What is assumed, and of which versions.
    """

    title: str
    summary: str
    front: str
    figures: Table
    numbers: Table
    sides: tuple[Side, ...]
    effects: tuple[tuple[str, str, Table, str], ...]
    files: tuple[tuple[str, str], ...]
    notes: Sequence[str]


def render_design(page: DesignPage) -> str:
    """Return the page as HTML with everything in it."""
    return str(render("design.html", page=page, picture=picture))


def picture(svg: str, alt: str) -> Markup:
    """Return a picture that stands alone, with its own style sheet.

    Parameters
    ----------
    svg : str
        SVG document.
    alt : str
        What a screen reader says.
    """
    data = base64.b64encode(svg.encode("utf-8")).decode("ascii")
    return Markup('<img alt="{}" src="data:image/svg+xml;base64,{}">').format(alt, data)
