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
