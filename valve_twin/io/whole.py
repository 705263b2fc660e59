# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A file that is there as a whole or as it was before, whatever the disk does meanwhile."""

from __future__ import annotations

import errno
import os
import shutil
import stat
import zlib
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

P = TypeVar("P", str, Path, "str | Path")

_DESCRIPTORS = ("/dev/std", "/dev/fd/", "/proc/")
"""What is named so is open in some process, as standard output: nothing can take its place."""

_KEPT = (errno.EBUSY, errno.EPERM, errno.EACCES)
"""What is said where a file is mounted by itself, another's in a common folder, or held open."""

_SHOWN = 50
"""Letters of a name that its part has, too: a name may have 255 bytes at most [1]."""


def write_whole(
    path: str | Path, content: str | bytes, sync: Callable[[int], object] | None = None
) -> None:
    """Write a file beside its place and put it there once it is complete.

    What is no plain file, such as a pipe, and a file that cannot be replaced, as in a folder that
    takes no other, are written in place; a link is followed.

    Parameters
    ----------
    path : str or Path
        File; one that exists is replaced and keeps its access rights.
    content : str or bytes
        Text is written as UTF-8.
    sync : callable, optional
        Called with the file number to put it on disk before it gets its name; default `os.fsync`.

    Raises
    ------
    OSError
        If it cannot be written; it names the file that was asked for.
    """
    write_all({path: content}, sync)


def write_all(
    contents: Mapping[P, str | bytes], sync: Callable[[int], object] | None = None
) -> None:
    """Write files that belong together: each gets its place once all of them are complete.

    A disk that fills up, or an end while they are written, leaves all as they were.

    Parameters
    ----------
    contents : mapping
        Content by file, as of `write_whole`.
    sync : callable, optional
        As of `write_whole`.

    Raises
    ------
    OSError
        If one cannot be written; it names the file that was asked for.
    """
    put, ready, path = sync or os.fsync, [], None
    parts: list[Path] = []
    try:
        for k, (path, content) in enumerate(contents.items()):
            data = content.encode("utf-8") if isinstance(content, str) else content
            target = Path(os.path.realpath(path))
            part = part_of(target, k)
            parts.append(part)
            beside = _can_replace(path, target) and _written(part, target, data, put)
            ready.append((path, target, part if beside else None, data))
        ready.sort(key=lambda one: one[2] is not None)  # first what may still fail in its place
        for path, target, beside_it, data in ready:
            if beside_it is None or not _put(beside_it, target, put):
                Path(path).write_bytes(data)
    except OSError as err:
        raise OSError(err.errno, err.strerror or str(err), str(path)) from err
    finally:
        for part in parts:
            with suppress(OSError):
                part.unlink(missing_ok=True)


def _can_replace(path: str | Path, target: Path) -> bool:
    """Return whether there is nothing yet, or a plain file that may be written and replaced."""
    if str(path).startswith(_DESCRIPTORS):
        return False
    if not target.exists():
        return True
    return target.is_file() and os.access(target, os.W_OK) and os.access(target.parent, os.W_OK)


def part_of(path: Path, number: int = 0) -> Path:
    """Return where this process writes a file first: beside its place, hidden.

    Files of one folder differ in the check sum of their whole names, and two that are written
    at the same time to one place in their `number`: processes of two containers may have one id.
    """
    whole = zlib.crc32(os.fsencode(path.name))
    return path.with_name(f".{path.name[:_SHOWN]}.{whole:08x}.{os.getpid()}.{number}.part")


@contextmanager
def placed(path: Path, part: Path) -> Iterator[Path]:
    """Have others write a file beside its place, and put it there once it is complete.

    Nothing of it is left where that fails: on a full disk others need its room. Whether the disk
    must keep it before it gets its name, by `sync_file`, is for the caller to say.

    Parameters
    ----------
    path : Path
        The file; one that exists is replaced.
    part : Path
        Beside it, such as `part_of` it: where it is to be written.
    """
    try:
        yield part
        os.replace(part, path)
    except BaseException:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise


def sync_file(path: Path) -> None:
    """Put what a file holds on disk: else a power cut may leave its name with nothing behind."""
    file: IO[bytes]
    try:
        file = path.open("r+b")  # Windows flushes none that is only read
    except OSError as err:
        if err.errno not in (errno.EACCES, errno.EPERM, errno.EROFS):
            raise
        file = path.open("rb")
    with file:
        os.fsync(file.fileno())


def sync_folder(folder: Path, sync: Callable[[int], object] | None = None) -> None:
    """Put the names in a folder on disk: a new file is found after a power cut."""
    if not hasattr(os, "O_DIRECTORY"):
        return  # Windows keeps its names without being asked, and opens no folder
    number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        (sync or os.fsync)(number)
    finally:
        os.close(number)


def _written(part: Path, target: Path, data: bytes, sync: Callable[[int], object]) -> bool:
    """Write what is to take a file's place beside it; return whether the system let it."""
    try:
        known = target.exists()
        rights = stat.S_IMODE(target.stat().st_mode) if known else 0o666
        with open(
            part, "wb", opener=partial(os.open, mode=rights)
        ) as file:  # private from the first
            file.write(data)
            file.flush()
            sync(file.fileno())  # else a power cut may leave the name with nothing behind it
        if known:
            shutil.copymode(target, part)
    except OSError as err:
        if err.errno in _KEPT and target.exists():
            return False
        raise
    return True


def _put(part: Path, target: Path, sync: Callable[[int], object]) -> bool:
    """Put a file in its place; return whether the system let it."""
    try:
        os.replace(part, target)
    except OSError as err:
        if err.errno in _KEPT and target.exists():
            return False
        raise
    with suppress(OSError):  # some network file systems keep their names in their own way
        sync_folder(target.parent, sync)
    return True
