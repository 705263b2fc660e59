# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read a written page, and say where another one departs from it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.io.errors import ValveTwinError
from valve_twin.report.provenance.record import META, parse_provenance

if TYPE_CHECKING:
    from valve_twin.report.provenance.record import Provenance

_AROUND = 40  # characters shown on either side of a difference
_HEADING = re.compile(r"(?=<h2>)")
_FIGURE = re.compile(r"<h3>(.*?)(?:<small>.*?)?</h3>")
_TITLE = re.compile(r"<h2>(.*?)</h2>")
_TAG = re.compile(r"<[^>]*>?")
_CUT = re.compile(r"^[^<]*>")  # what is left of a tag at the beginning of a piece


@dataclass(frozen=True, slots=True)
class WrittenPage:
    """A page as it was found.

    Attributes
    ----------
    where : str
        The file.
    html : str
        All of it.
    carried : str
        The provenance as it stands there.
    provenance : Provenance
        What that says.
    """

    where: str
    html: str
    carried: str
    provenance: Provenance


class _Finder(HTMLParser):
    """Takes the content of our element."""

    found: str | None = None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Look at one element."""
        values = dict(attrs)
        if tag == "meta" and values.get("name") == META and self.found is None:
            self.found = values.get("content") or ""


def read_page(path: str | Path) -> WrittenPage:
    """Read a report page with its provenance.

    Parameters
    ----------
    path : path
        HTML file.

    Raises
    ------
    ValveTwinError
        If it cannot be read or carries none.
    """
    try:
        html = Path(path).read_bytes().decode("utf-8")
    except FileNotFoundError:
        msg = f"{path}: there is no such file; give a page that valve-twin report wrote"
        raise ValveTwinError(msg) from None
    except (OSError, UnicodeDecodeError) as err:
        reason = getattr(err, "strerror", None) or "is no text in UTF-8"
        msg = f"{path}: cannot be read ({reason}); give a page that valve-twin report wrote"
        raise ValveTwinError(msg) from err
    finder = _Finder()
    finder.feed(html.partition("<body")[0])
    if finder.found is None:
        msg = (
            f"{path}: carries no provenance: it is no page of valve-twin report, or one of a "
            "version before provenance; make it again"
        )
        raise ValveTwinError(msg)
    return WrittenPage(str(path), html, finder.found, parse_provenance(finder.found, str(path)))


def page_differences(written: str, again: str) -> list[str]:
    """Return where a page that was made again departs from the written one, a line a section.

    Parameters
    ----------
    written, again : str
        HTML.

    Returns
    -------
    list of str
        Empty = equal in every byte; of the first section what stands in either.
    """
    if written == again:
        return []
    ours, theirs = _sections(written), _sections(again)
    lines = []
    for name in dict.fromkeys([*ours, *theirs]):
        one, other = ours.get(name), theirs.get(name)
        if one is None or other is None:
            lines.append(f"page: {name}: only {'in the report' if one else 'made again'}")
        elif one != other:
            lines.append(f"page: {name}{_place(one, other) if not lines else ''}")
    return lines or ["page: its sections stand in another order"]


def _sections(html: str) -> dict[str, str]:
    """Return the parts of a page by name, what precedes the first heading as its head."""
    found: dict[str, str] = {}
    for part in _HEADING.split(html):
        heading = _TITLE.match(part)
        name = f"section '{_text(heading[1])}'" if heading else "head and verdict"
        while name in found:
            name += ", again"
        found[name] = part
    return found


def _place(one: str, other: str) -> str:
    """Return the figure in which two sections depart first, and what stands there."""
    pairs = enumerate(zip(one, other, strict=False))
    at = next((i for i, (a, b) in pairs if a != b), min(len(one), len(other)))
    figures = _FIGURE.findall(one[:at])
    figure = f", figure '{_text(figures[-1])}'" if figures else ""
    pieces = [text[max(at - _AROUND, 0) : at + _AROUND] for text in (one, other)]
    read = [_text(_CUT.sub("", piece)) for piece in pieces]
    shown = read if read[0] != read[1] else [" ".join(piece.split()) for piece in pieces]
    return f"{figure}: '{shown[0]}' in the report, '{shown[1]}' made again"


def _text(html: str) -> str:
    """Return what a reader sees of a piece of HTML, on one line."""
    return " ".join(unescape(_TAG.sub(" ", html)).split())
