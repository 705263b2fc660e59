# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How much memory and depth a file of foreign origin may take."""

from __future__ import annotations

import gzip
import io
import os
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

if TYPE_CHECKING:
    from collections.abc import Iterator

VARIABLE = "VALVE_TWIN_UNPACK_MB"
"""Environment variable with the most megabytes that one chunk or one packed file may unpack to."""

_DEFAULT_MB = 256
_MEGABYTE = 1 << 20
_MODEST = 64 * _MEGABYTE
_MOST_RATIO = 1000
_FORMULA = frozenset("=+-@")
_TIMES_UNPACKED = 4  # memory to read what unpacks to so much: raw, as numbers, and a copy of those
_MAX_DEPTH = 32
_MAX_ALIASES = 100
_MAX_NODES = 1_000_000
_MAX_TEXT = 16 * _MEGABYTE
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

TOO_MUCH = (
    f"takes far more memory than a file may unpack to; if that is right set {VARIABLE}, "
    f"{_DEFAULT_MB} by default"
)
"""Of a file whose reader met `bounded_memory`."""

CONSTRUCTORS_MEET = (
    ValueError,
    OverflowError,
    RecursionError,
    AttributeError,
    TypeError,
    KeyError,
    IndexError,
)
"""What PyYAML and json raise where a text is not what it stands for, and who takes apart what they
read."""


class BoundError(yaml.YAMLError):
    """A text is nested, repeated or long beyond what a file of ours can be."""


def unpack_limit() -> int:
    """Return how many bytes one chunk or packed file may unpack to [B]."""
    try:
        given = int(os.environ.get(VARIABLE, _DEFAULT_MB))
    except ValueError:
        given = _DEFAULT_MB
    return max(1, given) * _MEGABYTE


def too_large(size: int, packed: int) -> str:
    """Return why so much may not be unpacked, empty = it may.

    Parameters
    ----------
    size, packed : int
        Bytes unpacked, as claimed, and packed [B].
    """
    limit = unpack_limit()
    if size > limit:
        return (
            f"unpacks to {size / _MEGABYTE:.0f} MB, allowed are {limit // _MEGABYTE}; set "
            f"{VARIABLE} if that is right"
        )
    if size > _MODEST and size > _MOST_RATIO * packed:
        return f"unpacks {packed} bytes to {size / _MEGABYTE:.0f} MB, which no measurement does"
    return ""


@contextmanager
def bounded_memory(most: int | None = None) -> Iterator[None]:
    """Read by another's code: where it wants far more than may be unpacked it gets none.

    What a file claims can be a lie that only its reader meets. On Linux; elsewhere nothing holds.

    Parameters
    ----------
    most : int, optional
        So much beyond what is held now [B], default what reading takes.

    Raises
    ------
    MemoryError
        By the code inside, or what it makes of that.
    """
    if sys.platform != "linux":
        yield
        return
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    status = Path("/proc/self/status").read_text(encoding="ascii")
    own = next(int(row.split()[1]) for row in status.splitlines() if row.startswith("VmData:"))
    more = _TIMES_UNPACKED * unpack_limit() if most is None else most
    limits = [
        limit for limit in (soft, hard, own * 1024 + more) if limit != resource.RLIM_INFINITY
    ]
    resource.setrlimit(resource.RLIMIT_DATA, (min(limits), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def unpack_gzip(data: bytes) -> bytes:
    """Return what gzip has packed.

    Raises
    ------
    OSError, EOFError, zlib.error
        If it cannot be unpacked, or is larger than allowed.
    """
    parts, size = [], 0
    with gzip.GzipFile(fileobj=io.BytesIO(data)) as stream:
        while part := stream.read(_MEGABYTE):
            parts.append(part)
            size += len(part)
            problem = too_large(size, len(data))
            if problem:
                raise OSError(problem)
    return b"".join(parts)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return text.strip() in {"-", "+"}
    return True


def no_formula(cell: object) -> object:
    """Return a cell of a CSV file; a text that a spreadsheet would calculate stands behind '."""
    if isinstance(cell, str) and cell.lstrip()[:1] in _FORMULA and not _is_number(cell):
        return f"'{cell}"
    return cell


def load_yaml(text: str) -> Any:  # noqa: ANN401  whatever the text holds
    """Return what a YAML text holds; nothing but plain values, within bounds.

    Raises
    ------
    yaml.YAMLError
        If it is no YAML, or too deep, too long, or repeats itself by aliases.
    """
    check_yaml(text)
    try:
        return yaml.load(text, Loader=_LOADER)  # a safe loader, the fast one
    except CONSTRUCTORS_MEET as err:
        raise BoundError(str(err)) from err


def check_yaml(text: str) -> None:
    """Refuse a YAML text that nobody can have written by hand or by a recorder.

    Raises
    ------
    yaml.YAMLError
        If it is no YAML, or too deep, too long, or repeats itself by aliases.
    """
    if len(text) > _MAX_TEXT:
        msg = f"it is longer than {_MAX_TEXT // _MEGABYTE} MB"
        raise BoundError(msg)
    weights: dict[str, int] = {}
    open_nodes: list[tuple[str | None, int]] = []
    total = aliases = 0
    for event in _events(text):
        weight = 1
        if isinstance(event, yaml.AliasEvent):
            aliases += 1
            weight = weights.get(event.anchor or "", _MAX_NODES)
        elif isinstance(event, yaml.CollectionStartEvent):
            open_nodes.append((event.anchor, total))
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = open_nodes.pop()
            if anchor is not None:
                weights[anchor] = total - before
            continue
        elif isinstance(event, yaml.ScalarEvent) and event.anchor is not None:
            weights[event.anchor] = 1
        total += weight
        if len(open_nodes) > _MAX_DEPTH:
            msg = f"line {event.start_mark.line + 1}: it is nested deeper than {_MAX_DEPTH} levels"
            raise BoundError(msg)
        if aliases > _MAX_ALIASES or total > _MAX_NODES:
            msg = f"line {event.start_mark.line + 1}: aliases or values without end"
            raise BoundError(msg)


def _events(text: str) -> Iterator[Any]:
    """Yield the events of a text; the parser keeps no tree and does not call itself."""
    try:
        yield from yaml.parse(text, Loader=_LOADER)
    except CONSTRUCTORS_MEET as err:
        raise BoundError(str(err)) from err
