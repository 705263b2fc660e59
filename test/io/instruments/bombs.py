# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Small files of other programs that unpack to much, nest deeply or claim to be full."""

from __future__ import annotations

import struct
import zipfile
import zlib

import numpy as np
import pytest

BYTES, DOUBLES = 1, 9  # how the numbers of a MAT file are stored
DOUBLE, CELL, STRUCTURE = 6, 1, 2  # what a MAT matrix is
_SHEET = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
_OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
_PACKAGE = "http://schemas.openxmlformats.org/package/2006"
_KINDS = "application/vnd.openxmlformats-officedocument.spreadsheetml"


def _matrix(kind: int, columns: int, name: str, inside: int) -> bytes:
    """Return the head of a MAT matrix that holds so many bytes."""
    words = name.encode().ljust(-(-len(name) // 8) * 8, b"\0")
    head = struct.pack("<IIII", 6, 8, kind, 0) + struct.pack("<IIii", 5, 8, 1, columns)
    head += struct.pack("<II", 1, len(name)) + words
    return struct.pack("<II", 14, len(head) + inside) + head


def packed(first: bytes, zeros: int) -> bytes:
    """Return bytes and so many zeros behind them as zlib packs them; it packs one MB of these.

    After a full flush each MB becomes the same bytes, and zeros add to one half of Adler's sum.
    """
    packer = zlib.compressobj(6)
    start = packer.compress(first) + packer.flush(zlib.Z_FULL_FLUSH)
    block = packer.compress(bytes(1 << 20)) + packer.flush(zlib.Z_FULL_FLUSH)
    rest = packer.compress(bytes(zeros % (1 << 20))) + packer.flush()
    high, low = divmod(zlib.adler32(first), 1 << 16)
    total = (high + zeros * low) % 65521 << 16 | low
    return start + block * (zeros >> 20) + rest[:-4] + struct.pack(">I", total)


def _mat(path, content: bytes) -> None:
    start = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H2s", 0x0100, b"IM")
    path.write_bytes(start + struct.pack("<II", 15, len(content)) + content)


def _structure(path, count: int, stored: int, width: int) -> None:
    size = count * width
    numbers = _matrix(DOUBLE, count, "", 8 + size) + struct.pack("<II", stored, size)
    fields = struct.pack("<HHi", 5, 4, 8) + struct.pack("<II", 1, 8) + b"x".ljust(8, b"\0")
    head = _matrix(STRUCTURE, 1, "s", len(fields) + len(numbers) + size)
    _mat(path, packed(head + fields + numbers, size))


def mat_doubles(path, count: int) -> None:
    """Write a structure with one field of zeros."""
    _structure(path, count, DOUBLES, 8)


def mat_bytes(path, count: int) -> None:
    """Write the same stored as bytes, each of which becomes a double."""
    _structure(path, count, BYTES, 1)


def mat_cells(path, count: int) -> None:
    """Write a cell in a cell in a cell."""
    inmost = _matrix(DOUBLE, 1, "", 16) + struct.pack("<IId", DOUBLES, 8, 1.0)
    step = len(_matrix(CELL, 1, "", 0))
    heads = [_matrix(CELL, 1, "", len(inmost) + step * k) for k in reversed(range(count))]
    outmost = _matrix(CELL, 1, "c", len(inmost) + step * count)
    _mat(path, zlib.compress(b"".join((outmost, *heads, inmost)), 6))


def _workbook(path, rows: str, size: str, texts: str = "") -> None:
    xml = '<?xml version="1.0"?>'

    def links(*known: tuple[str, str]) -> str:
        listed = "".join(
            f'<Relationship Id="r{n}" Type="{_OFFICE}/{kind}" Target="{target}"/>'
            for n, (kind, target) in enumerate(known)
        )
        return f'{xml}<Relationships xmlns="{_PACKAGE}/relationships">{listed}</Relationships>'

    parts = {"workbook.xml": "sheet.main", "s.xml": "worksheet", "any.xml": "sharedStrings"}
    kinds = "".join(
        f'<Override PartName="/xl/{name}" ContentType="{_KINDS}.{kind}+xml"/>'
        for name, kind in parts.items()
    )
    rels = "application/vnd.openxmlformats-package.relationships+xml"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr(
            "[Content_Types].xml",
            f'{xml}<Types xmlns="{_PACKAGE}/content-types">'
            f'<Default Extension="rels" ContentType="{rels}"/>{kinds}</Types>',
        )
        file.writestr("_rels/.rels", links(("officeDocument", "xl/workbook.xml")))
        file.writestr(
            "xl/workbook.xml",
            f'{xml}<workbook xmlns="{_SHEET}" xmlns:r="{_OFFICE}"><sheets>'
            '<sheet name="a" sheetId="1" r:id="r0"/></sheets></workbook>',
        )
        file.writestr(
            "xl/_rels/workbook.xml.rels",
            links(("worksheet", "s.xml"), ("sharedStrings", "any.xml")),
        )
        file.writestr(
            "xl/s.xml",
            f'{xml}<worksheet xmlns="{_SHEET}"><dimension ref="A1:{size}"/>'
            f"<sheetData>{rows}</sheetData></worksheet>",
        )
        file.writestr("xl/any.xml", f'{xml}<sst xmlns="{_SHEET}">{texts}</sst>')


def _rows(count: int) -> str:
    cells = '<row r="{0}"><c r="A{0}"><v>{1}</v></c><c r="B{0}"><v>{2}</v></c></row>'
    return "".join(cells.format(r, 0.01 * r, r // 20 % 2) for r in range(1, count + 1))


def excel_texts(path, count: int) -> None:
    """Write a table beside so many texts that no cell needs."""
    _workbook(path, _rows(200), "B200", "".join(f"<si><t>{i}</t></si>" for i in range(count)))


def excel_cells(path, count: int) -> None:
    """Write so many rows of one cell, which is the last one that a row can have."""
    rows = "".join(f'<row r="{r}"><c r="XFD{r}"><v>1</v></c></row>' for r in range(1, count + 1))
    _workbook(path, rows, "XFD1048576")


def excel_full(path, count: int) -> None:
    """Write a table in a sheet that claims to be full, with one more value in the last row."""
    last = '<row r="1048576"><c r="A1048576"><v>99999</v></c></row>'
    _workbook(path, _rows(count) + last, "XFD1048576")


def mdf_block(path, count: int) -> None:
    """Write channels whose packed block claims few bytes and holds so many."""
    asammdf = pytest.importorskip("asammdf")
    seconds = 0.01 * np.arange(1000)
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(np.sin(seconds), seconds, name="p")])
        file.save(path, compression=1, overwrite=True)
    whole = path.read_bytes()
    at = whole.index(b"##DZ")
    form = "<4sIQQ2sBBIQQ"
    head = list(struct.unpack_from(form, whole, at))
    zeros = packed(b"", count)
    head[2], head[9] = struct.calcsize(form) + len(zeros), len(zeros)
    whole += bytes(-len(whole) % 8)
    moved = whole.replace(struct.pack("<Q", at), struct.pack("<Q", len(whole)))
    path.write_bytes(moved + struct.pack(form, *head) + zeros)


def _varint(number: int, width: int = 0) -> bytes:
    """Return a number as Thrift writes it, or longer than it would."""
    rest, parts = number << 1, bytearray()
    while rest >> 7 or len(parts) + 1 < width:
        parts.append(rest & 0x7F | 0x80)
        rest >>= 7
    return bytes([*parts, rest])


def parquet_pages(path, count: int) -> None:
    """Write so many rows in one page, of which the footer tells a thousand."""
    parquet = pytest.importorskip("pyarrow.parquet")
    arrow = pytest.importorskip("pyarrow")
    names = ("time_s", "command", "position")
    parquet.write_table(
        arrow.table({name: np.zeros(count) for name in names}),
        path,
        compression="zstd",
        use_dictionary=False,
        row_group_size=count,
        data_page_size=1 << 30,
        write_statistics=False,
    )
    group = parquet.ParquetFile(path).metadata.row_group(0)
    lies = {count: 1000, group.total_byte_size: 24_000}
    lies |= {group.column(n).total_uncompressed_size: 8000 for n in range(len(names))}
    whole = path.read_bytes()
    (length,) = struct.unpack("<I", whole[-8:-4])
    footer = whole[-8 - length : -8]
    for told, lie in lies.items():
        assert _varint(told) in footer
        footer = footer.replace(_varint(told), _varint(lie, len(_varint(told))))
    path.write_bytes(whole[: -8 - length] + footer + whole[-8:])


def tdms_segments(path, count: int) -> None:
    """Write empty segments behind one of 2000 channels."""

    def text(of: str) -> bytes:
        return struct.pack("<I", len(of)) + of.encode()

    def segment(contents: int, metadata: bytes, data: bytes) -> bytes:
        on = len(metadata) + len(data)
        return b"TDSm" + struct.pack("<IIQQ", contents, 4713, on, len(metadata)) + metadata + data

    channels = 2000
    index = struct.pack("<IIIQI", 20, 10, 1, 1, 0)  # a double each, no property
    metadata = b"".join(text(f"/'g'/'c{k}'") + index for k in range(channels))
    first = segment(2 | 4 | 8, struct.pack("<I", channels) + metadata, bytes(8 * channels))
    path.write_bytes(first + count * segment(8, b"", b""))
