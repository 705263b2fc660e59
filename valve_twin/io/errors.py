# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Errors of files and databases: one line that says what, where, which value and what to do.

ValveTwinError
  ConfigError   a configuration key or value cannot be used
  BagError      a bag or CSV file cannot be read or written
    IndexLiesError  a bag states wrong times: read once more, it is read another way
  StoreError    the history database cannot be used
  FmuError      a Functional Mock-up Unit cannot be made, read or run
"""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


class ValveTwinError(Exception):
    """Base of all errors that a user can cause and repair."""


class ConfigError(ValveTwinError):
    """A configuration key or value cannot be used."""


class BagError(ValveTwinError):
    """A bag or CSV file cannot be read or written."""


class IndexLiesError(BagError):
    """A bag states wrong times; opened anew it is read by its data section."""


class StoreError(ValveTwinError):
    """The history database cannot be used."""


class FmuError(ValveTwinError):
    """A Functional Mock-up Unit cannot be made, read or run."""


def suggest(name: str, known: Iterable[str], *, shown: int = 12) -> str:
    """Say which known name is nearest to a wrong one, or which there are.

    Parameters
    ----------
    name : str
        The name that is not known.
    known : iterable of str
        Valid names.
    shown : int
        How many names are listed at most where none is near.

    Returns
    -------
    str
        "did you mean 'x'?", "there are a, b, c" or "there are none".
    """
    names = list(dict.fromkeys(known))
    near = get_close_matches(name, names, n=1)
    if near:
        return f"did you mean '{near[0]}'?"
    if not names:
        return "there are none"
    more = f" and {len(names) - shown} more" if len(names) > shown else ""
    return f"there are {', '.join(names[:shown])}{more}"
