# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a Windows DLL says of itself: machine, what it exports, what it needs of whom."""

from __future__ import annotations

import struct
from dataclasses import dataclass

AMD64 = 0x8664
_DLL, _PLUS = 0x2000, 0x20B  # flag of a DLL; magic number of 64-bit images


@dataclass(frozen=True)
class Image:
    """A 64-bit image: exported names, and imported names by library in lower case."""

    machine: int
    is_dll: bool
    exports: frozenset[str]
    imports: dict[str, frozenset[str]]


class _Reader:
    """Reads a file by the addresses that it has when it is loaded."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        (begin,) = struct.unpack_from("<I", data, 0x3C)
        assert data[:2] == b"MZ"
        assert data[begin : begin + 4] == b"PE\0\0"
        head = struct.unpack_from("<HHIIIHH", data, begin + 4)
        self.machine, sections, size, self.flags = head[0], head[1], head[5], head[6]
        optional = begin + 24
        assert struct.unpack_from("<H", data, optional) == (_PLUS,)
        self.directories = [
            struct.unpack_from("<II", data, optional + 112 + 8 * k)[0] for k in (0, 1, 13)
        ]
        table = optional + size
        self.sections = [
            struct.unpack_from("<IIII", data, table + 40 * k + 8) for k in range(sections)
        ]

    def at(self, address: int) -> int:
        for size, begin, stored, place in self.sections:
            if begin <= address < begin + max(size, stored):
                return int(address - begin + place)
        raise AssertionError(hex(address))

    def numbers(self, form: str, address: int) -> tuple[int, ...]:
        return struct.unpack_from(form, self.data, self.at(address))

    def text(self, address: int) -> str:
        begin = self.at(address)
        return self.data[begin : self.data.index(b"\0", begin)].decode("ascii")


def read_image(data: bytes) -> Image:
    """Return what a DLL says of itself."""
    file = _Reader(data)
    exported, imported, delayed = file.directories
    assert not delayed
    count, _, names = file.numbers("<III", exported + 24)
    exports = {file.text(a) for a in file.numbers(f"<{count}I", names)}
    imports: dict[str, frozenset[str]] = {}
    while imported:
        wanted, _, _, library, bound = file.numbers("<IIIII", imported)
        if not library:
            break
        found, place = set(), wanted or bound
        while True:
            (entry,) = file.numbers("<Q", place)
            if not entry:
                break
            found.add(f"#{entry & 0xFFFF}" if entry >> 63 else file.text(entry + 2))
            place += 8
        imports[file.text(library).lower()] = frozenset(found)
        imported += 20
    return Image(file.machine, bool(file.flags & _DLL), frozenset(exports), imports)
