# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The words of the pages in other languages: gettext with the .po files themselves."""

from __future__ import annotations

import ast
import gettext
import math
import re
from functools import cache, lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from valve_twin.report.text import MINUS

if TYPE_CHECKING:
    from collections.abc import Mapping

LANGUAGES = {"en": "English", "de": "Deutsch"}
"""Names of the languages by code; the first is that of the templates."""

DECIMAL = {"de": ","}
"""Decimal signs by code, where it is no point."""

COOKIE = "valve_twin_language"

LONGEST = 600
"""A longer clause stays as it is: what is stored may come from anybody [characters]."""

DEEPEST = 5
"""Templates within each other [1]."""

_LINE = re.compile(r'(?:(msgid|msgstr)\s+)?(".*")')


class Words(gettext.NullTranslations):
    """The words of one language; what it lacks stays as it is.

    Parameters
    ----------
    catalogue : dict
        Texts of pages and pictures by their original.
    sentences : dict, optional
        Texts of the core by their original, {} for what differs: evidence, advice, descriptions.
    """

    def __init__(self, catalogue: dict[str, str], sentences: dict[str, str] | None = None) -> None:
        super().__init__()
        self.catalogue, self.sentences = catalogue, sentences or {}

    def gettext(self, message: str) -> str:
        """Return a text of the templates in this language."""
        return self.catalogue.get(message) or self.sentences.get(message) or message


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


def sentence(text: object, told: Words, *, begins: bool = False) -> Markup:
    """Return what the core says, for a page: in another language, else marked as English.

    Parameters
    ----------
    text : object
        Clauses between semicolons, each of which is translated by its template.
    told : Words
        The words.
    begins : bool
        Whether an English one begins with a capital letter.
    """
    said = str(text)
    if not said or not told.sentences:
        return escape(said[:1].upper() + said[1:] if begins else said)
    if said in told.sentences:
        return escape(told.gettext(said))
    return Markup("; ").join(_clause(part, told) for part in said.split("; "))


_NOT_OURS = re.compile(
    r"(<style>.*?</style>|<script.*?</script>|"
    r'<(?:h1|td|span) translate="no">.*?</(?:h1|td|span)>|<[^>]*>)',
    re.DOTALL,
)
"""Tags, and what is not to be told in another language: names and notes of users."""


def whole_page(page: str, language: str) -> str:
    """Return a page (HTML) in another language; what is not known stays as it is.

    Parameters
    ----------
    page : str
        The page in the language of the templates.
    language : str
        Code of the other one.
    """
    told = words(language, "_report")
    if not told.catalogue:
        return page
    page = str(page)  # markup would escape what it is given
    page = page.replace(f'lang="{next(iter(LANGUAGES))}"', f'lang="{language}"', 1)
    parts = _NOT_OURS.split(drawn(page, told))
    return "".join(part if part.startswith("<") else _told_part(part, told) for part in parts)


_FIGURES = re.compile(
    r"<style>.*?</style>|<script.*?</script>|"
    r'<(?P<name>\w+) (?:[^>]* )?translate="no"[^>]*>.*?</(?P=name)>|<[^>]*>|'
    r"(?<![\w./#)\]+-])(?P<sign>[+-]?)(?P<whole>\d+)(?P<part>\.\d+)?(?P<power>e[+-]?\d+)?"
    r"(?!\w|\.\d|-\d)",
    re.DOTALL,
)
"""Tags, what is no sentence of ours, and numbers: no version, date, address or part of a name."""


def figures(page: str, language: str) -> str:
    """Return a page (HTML) with the minus of typography and the decimal sign of its language.

    A zero has no sign. Attributes and what is marked as not to be translated stay as they are.

    Parameters
    ----------
    page : str
        The page.
    language : str
        Code of its language.
    """
    point = DECIMAL.get(language, ".")

    def written(found: re.Match[str]) -> str:
        whole, part = found["whole"], found["part"] or ""
        if whole is None:
            return found.group()
        sign = found["sign"] if (whole + part).strip("0.") else ""
        power = found["power"] or ""
        return f"{sign}{whole}{part.replace('.', point)}{power}".replace("-", MINUS)

    return _FIGURES.sub(written, page)


def language_of(page: str) -> str:
    """Return the code of the language of a page."""
    found = re.search(r'<html lang="([a-z]+)"', page[:1000])
    return found.group(1) if found and found.group(1) in LANGUAGES else next(iter(LANGUAGES))


def _told_part(part: str, told: Words) -> str:
    """Return the text between two tags in another language, with the space around it."""
    text = " ".join(Markup(part).unescape().split())
    if not _WORD.search(text) and text not in told.catalogue:
        return part
    begin = ": " if text.startswith(": ") else ""
    text = text.removeprefix(begin)
    found = _told_text(text, told)
    if found is None and text.endswith("."):  # a clause that was made a sentence
        found = _told_text(text[0].lower() + text[1:-1], told)
        found = found if found is None else Markup("{}{}.").format(found[:1].upper(), found[1:])
    if found is None:
        return part
    before, after = (" " if end.isspace() else "" for end in (part[0], part[-1]))
    return f"{before if not begin else ''}{begin}{found}{after}"


def _told_text(text: str, told: Words) -> Markup | None:
    """Return a text in another language; None where nothing of it is known."""
    if text in told.catalogue or text in told.sentences:
        return escape(told.gettext(text))
    ranked, short = _ranked(tuple(told.sentences)), len(text) <= LONGEST
    clauses = text.split("; ")
    found = [_said(c, told, ranked, DEEPEST) if short else None for c in clauses]
    known = [said for said in found if said is not None]
    if len(known) == len(found) and not any("</span>" in said for said in known):
        return Markup("; ").join(known)
    patterns = _patterns(tuple(m for m in told.catalogue if "{}" in m))
    other = _translated(text, told, patterns)
    if other != text:
        return escape(other)
    if not known:
        return None
    pairs = zip(clauses, found, strict=True)
    return Markup("; ").join(escape(c) if said is None else said for c, said in pairs)


@lru_cache(maxsize=1000)
def _clause(text: str, told: Words) -> Markup:
    patterns = _ranked(tuple(told.sentences))
    found = _said(text, told, patterns, DEEPEST) if len(text) <= LONGEST else None
    return _ENGLISH.format(text) if found is None else found


def _said(
    text: str, told: Words, patterns: Mapping[str, re.Pattern[str]], depth: int
) -> Markup | None:
    """Return a clause by the first template that says all of it, else by the first that fits.

    What stands in it and is neither known nor a name or a figure stays English; a template that
    has no word of its own takes no such part.
    """
    if text in told.sentences or text in told.catalogue:
        return escape(told.gettext(text))
    partly = None
    for message, pattern in patterns.items() if depth else ():
        found = pattern.fullmatch(text)
        if not found:
            continue
        parts = [
            _said(part, told, patterns, depth - 1)
            or (_ENGLISH if _is_said(part) else _PLAIN).format(part)
            for part in found.groups()
        ]
        whole = not any("</span>" in part for part in parts)
        if whole or (partly is None and _WORD.search(message)):
            said = escape(told.sentences[message]).format(*parts)
            if whole:
                return said
            partly = said
    return partly


def _is_said(part: str) -> bool:
    """Return whether a part is a clause of its own, and no name or figure with its unit."""
    return " " in part and len(_WORD.findall(part)) > 1


_ENGLISH, _PLAIN = Markup('<span lang="en">{}</span>'), Markup("{}")
_WORD = re.compile(r"(?<![\w/])(?!inf\b|nan\b)[A-Za-z_]{3,}")


_IN_PICTURE = re.compile(r'(<text [^>]*>|aria-label=")([^<"]+)(</text>|")')


@cache
def _patterns(messages: tuple[str, ...]) -> dict[str, re.Pattern[str]]:
    return {m: re.compile("(.+?)".join(map(re.escape, m.split("{}")))) for m in messages}


@cache
def _ranked(messages: tuple[str, ...]) -> dict[str, re.Pattern[str]]:
    """Return the patterns of templates, those with the longest text of their own first."""
    open_ones = sorted((m for m in messages if "{}" in m), key=lambda m: -len(m.replace("{}", "")))
    return _patterns(tuple(open_ones))


def _translated(text: str, told: Words, patterns: Mapping[str, re.Pattern[str]]) -> str:
    if text in told.catalogue or text in told.sentences:
        return told.gettext(text)
    for message, pattern in patterns.items():
        found = pattern.fullmatch(text)
        if found:
            parts = [told.gettext(part) for part in found.groups()]
            return told.gettext(message).format(*parts)
    return text


@cache
def words(language: str, *more: str) -> Words:
    """Return the words of a language, with those of more files (`_report`)."""
    if language == next(iter(LANGUAGES)):
        return Words({})
    folder = files("valve_twin.report.language") / "locale"
    pages, *of_core = (
        read_catalogue((folder / f"{language}{part}.po").read_text(encoding="utf-8"))
        for part in ("", "_sentences", "_reasons", "_faults", "_parameters", *more)
    )
    return Words(pages, {message: text for part in of_core for message, text in part.items()})


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
