# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The bytes of a text file, plain or packed, and their encoding."""

from __future__ import annotations

import re
import zlib
from typing import TYPE_CHECKING

from valve_twin.io.errors import BagError
from valve_twin.io.instruments.table import check_size
from valve_twin.io.limits import unpack_gzip

if TYPE_CHECKING:
    from pathlib import Path

_ENCODINGS = ["cp1252", "cp1251", "cp1250", "cp850", "cp932", "gb18030", "euc_kr"]
_LETTERS = 65_536  # bytes by which the encoding is found
_WESTERN = ("cp1252", "cp850", "cp1250")
_HIGH = re.compile(rb"([A-Za-z]?)([\x80-\xff]+)(?=([A-Za-z]?))")
_NOT_WESTERN = re.compile(
    "[^\x00-\x7f\xa0-\xffŒœŠšŽžŸ€–—‘’“”…‰ĄąĆćĘęŁłŃńŚśŹźŻżČčĎďĚěŇňŘřŤťŮůŐőŰű˝]"  # not written there
    "|[A-Za-zÀ-ÿ][¡-¿×÷“”]+[a-zß-ÿ]"  # a sign inside a word
    "|œ[^uid]"  # which no word of French has
    "|(?<![A-Za-zÀ-ÿ])(?:ø[CFK]|æ[mslAVgF])(?![A-Za-zÀ-ÿ])"  # degree and micro of DOS
)
_CYRILLIC = re.compile("[А-ЯЁ]?[а-яё]{2,}|[А-ЯЁ]{3,}")
_IDEOGRAPH = re.compile("[\u4e00-\u9fff]")


def unpacked(path: Path) -> bytes:
    """Return what a file holds, unpacked where it is gzip.

    Raises
    ------
    BagError
        If it cannot be read, or is larger than allowed.
    """
    try:
        check_size(path, path.stat().st_size)
        data = path.read_bytes()
        return unpack_gzip(data) if data.startswith(b"\x1f\x8b") else data
    except FileNotFoundError:
        msg = f"{path}: there is no such file; give one that is there"
        raise BagError(msg) from None
    except (OSError, EOFError, zlib.error) as err:
        msg = f"{path}: cannot be read ({err}); give a whole file, plain or gzip"
        raise BagError(msg) from err


def decode(path: Path, data: bytes, whole: bytes = b"") -> str:
    """Return bytes as text: by byte-order mark, UTF-8, UTF-16 without mark, else the likeliest.

    Parameters
    ----------
    path : Path
        The file, for messages.
    data : bytes
        What of it is decoded.
    whole : bytes
        All that it holds, if that is more.

    Raises
    ------
    BagError
        If it is no text.
    """
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", errors="replace").lstrip("\ufeff")
    even, odd = data[:4096:2].count(0), data[1:4096:2].count(0)
    if even + odd:
        half = len(data[:4096]) // 4
        if max(even, odd) < half or min(even, odd) > 0:
            msg = f"{path}: is no text and of no kind that is read; save the table as CSV"
            raise BagError(msg)
        return data.decode("utf-16-le" if odd > even else "utf-16-be", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        pass
    return data.decode(_likeliest((whole or data)[:_LETTERS]), errors="replace")


def _likeliest(sample: bytes) -> str:
    """Return the encoding of bytes that are no UTF.

    A few letters with accents and signs of units among ASCII are Western: what counts how often
    characters follow each other takes a degree sign and its C for one of Chinese.
    """
    runs = _HIGH.findall(sample)
    if all(len(high) <= 2 for _, high, _ in runs) and any(
        len(high) == 1 or (before and behind) for before, high, behind in runs
    ):
        for name in _WESTERN:
            text = sample.decode(name, errors="replace")
            if not _NOT_WESTERN.search(text):
                return name
    if all(_CYRILLIC.fullmatch(high.decode("cp1251", errors="replace")) for _, high, _ in runs):
        return "cp1251"
    try:
        from charset_normalizer import from_bytes
    except ImportError:
        return "cp1252"
    best = from_bytes(sample, cp_isolation=_ENCODINGS).best()
    name = best.encoding if best else "cp1252"
    if name == "euc_kr" and _IDEOGRAPH.search(sample.decode(name, errors="replace")):
        return "gb18030"  # which Korean is no more written with
    return name
