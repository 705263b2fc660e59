# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The words of the pages in other languages: gettext with the .po files themselves."""

from __future__ import annotations

import ast
import gettext
import math
import re
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

if TYPE_CHECKING:
    from collections.abc import Mapping

LANGUAGES = {"en": "English", "de": "Deutsch"}
"""Names of the languages by code; the first is that of the templates."""

COOKIE = "valve_twin_language"

_LINE = re.compile(r'(?:(msgid|msgstr)\s+)?(".*")')


class Words(gettext.NullTranslations):
    """The words of one language; what it lacks stays as it is."""

    def __init__(self, catalogue: dict[str, str]) -> None:
        super().__init__()
        self.catalogue = catalogue

    def gettext(self, message: str) -> str:
        """Return a text of the templates in this language."""
        return self.catalogue.get(message) or message


def read_catalogue(text: str) -> dict[str, str]:
    """Return the texts of a .po file without plurals and contexts by their original."""
    pairs: list[list[str]] = []
    part = 0
    for line in text.splitlines():
        found = _LINE.fullmatch(line.strip())
        if found is None:
            continue
        word, quoted = found.groups()
        if word == "msgid":
            pairs.append(["", ""])
        part = {"msgid": 0, "msgstr": 1}.get(word, part)
        pairs[-1][part] += ast.literal_eval(quoted)
    return {message: told for message, told in pairs if message}


def drawn(picture: str, told: Words) -> Markup:
    """Return a picture (SVG) with its words in another language; what is not known stays.

    Parameters
    ----------
    picture : str
        SVG, escaped.
    told : Words
        The words; a text with {} stands for all that differ in that place.
    """
    if not told.catalogue:
        return Markup(picture)
    patterns = _patterns(tuple(m for m in told.catalogue if "{}" in m))

    def replaced(found: re.Match[str]) -> str:
        before, text, after = found.groups()
        return f"{before}{escape(_translated(Markup(text).unescape(), told, patterns))}{after}"

    return Markup(_IN_PICTURE.sub(replaced, picture))


def cell(text: object, told: Words) -> Markup:
    """Return a cell of a table, text or HTML, with its words in another language."""
    found = str(escape(text))
    if not told.catalogue:
        return Markup(found)
    patterns = _patterns(tuple(m for m in told.catalogue if "{}" in m))
    parts = re.split("(<[^>]*>)", found)
    return Markup("").join(
        Markup(part)
        if part.startswith("<")
        else _translated(Markup(part).unescape(), told, patterns)
        for part in parts
    )


_IN_PICTURE = re.compile(r'(<text [^>]*>|aria-label=")([^<"]+)(</text>|")')


@cache
def _patterns(messages: tuple[str, ...]) -> dict[str, re.Pattern[str]]:
    return {m: re.compile("(.+?)".join(map(re.escape, m.split("{}")))) for m in messages}


def _translated(text: str, told: Words, patterns: Mapping[str, re.Pattern[str]]) -> str:
    if text in told.catalogue:
        return told.gettext(text)
    for message, pattern in patterns.items():
        found = pattern.fullmatch(text)
        if found:
            parts = [told.gettext(part) for part in found.groups()]
            return told.gettext(message).format(*parts)
    return text


@cache
def words(language: str) -> Words:
    """Return the words of a language."""
    if language == next(iter(LANGUAGES)):
        return Words({})
    path = files("valve_twin.gateway") / "locale" / f"{language}.po"
    return Words(read_catalogue(path.read_text(encoding="utf-8")))


def chosen(asked: str, kept: str, accepted: str) -> str:
    """Return the code of the language that somebody gets.

    Parameters
    ----------
    asked, kept : str
        What he asks for now, and what he asked for before; empty or unknown = nothing.
    accepted : str
        Header Accept-Language of his browser.
    """
    ranked = []
    for place, part in enumerate(accepted[:500].split(",")):
        code, _, weight = part.strip().partition(";q=")
        try:
            rank = float(weight or 1.0)
        except ValueError:
            continue
        if math.isfinite(rank):
            ranked.append((-rank, place, code.partition("-")[0].strip().lower()))
    wanted = [asked, kept, *(code for _, _, code in sorted(ranked))]
    return next((code for code in wanted if code in LANGUAGES), next(iter(LANGUAGES)))
