# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Content of a file that carries a check sum: a line that seals it, a line of words, arrays."""

from __future__ import annotations

import errno
import hashlib
import json
from typing import TYPE_CHECKING, Any

from valve_twin.io.whole import placed, sync_file, sync_folder

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

    import numpy as np

_CANNOT = (errno.EINVAL, errno.ENOTSUP)
"""What a file system says that flushes no folder."""

_DAMAGED = "it is damaged"


def framed(head: object, arrays: Iterable[np.ndarray[Any, Any]]) -> bytes:
    """Return the bytes of arrays behind a line that says what they are.

    Parameters
    ----------
    head : object
        Whatever JSON holds.
    arrays : iterable of arrays
        Their shapes and types are for the head to tell.
    """
    text = json.dumps(head).encode() + b"\n"
    return b"".join([text, *(a.tobytes() for a in arrays)])


def seal(magic: bytes, content: bytes) -> bytes:
    """Return the line that goes before the content of a file of a kind: its check sum."""
    return magic + hashlib.sha256(content).hexdigest().encode() + b"\n"


def write_sealed(path: Path, part: Path, magic: bytes, content: bytes) -> None:
    """Put a sealed file in the place of the one before, at once or not at all.

    The disk is not waited for: what a power cut leaves of it is told by its check sum.

    Parameters
    ----------
    path : Path
        The file.
    part : Path
        Beside it, where it is written first; nothing of it is left.
    magic : bytes
        The kind of file.
    content : bytes
        All behind the line that seals it.

    Raises
    ------
    OSError
        If the disk does not take it.
    """
    with placed(path, part):
        part.write_bytes(seal(magic, content) + content)


def flush(paths: Iterable[Path]) -> set[Path]:
    """Have the disk keep files and their names over a power cut; return which it keeps.

    Parameters
    ----------
    paths : iterable of Path
        The files; one that is gone by now counts as kept.
    """
    kept = {path for path in paths if _is_flushed(path)}
    failed = {folder for folder in {path.parent for path in kept} if not flush_folder(folder)}
    return {path for path in kept if path.parent not in failed}


def flush_folder(folder: Path) -> bool:
    """Have the disk keep the names in a folder; return whether it does, or the folder is gone.

    Some network file systems cannot be asked for a folder: they keep its names in their own way.
    """
    try:
        sync_folder(folder)
    except FileNotFoundError:
        return True
    except OSError as err:
        return err.errno in _CANNOT
    return True


def _is_flushed(path: Path) -> bool:
    try:
        sync_file(path)
    except FileNotFoundError:
        return True
    except OSError:
        return False
    return True


def unsealed_bytes(magic: bytes, whole: bytes) -> bytes | None:
    """Return the content of a sealed file, None where it is damaged or of another kind.

    Parameters
    ----------
    magic : bytes
        The kind of file.
    whole : bytes
        All of the file.
    """
    line, _, content = whole.partition(b"\n")
    return content if line + b"\n" == seal(magic, content) else None


def unsealed(magic: bytes, whole: bytes) -> tuple[Any, bytes] | None:
    """Return the head and the bytes of the arrays of a sealed file, None where it is damaged.

    Parameters
    ----------
    magic : bytes
        The kind of file.
    whole : bytes
        All of the file.
    """
    content = unsealed_bytes(magic, whole)
    if content is None:
        return None
    text, _, data = content.partition(b"\n")
    return json.loads(text), data


def read_sealed(
    path: Path, magic: bytes, refused: Callable[[str], Exception], stranger: str = _DAMAGED
) -> tuple[Any, bytes] | None:
    """Return the head and the bytes of the arrays of a sealed file, None where there is none.

    Parameters
    ----------
    path : Path
        The file.
    magic : bytes
        The kind of file.
    refused : callable
        Makes what is raised where it cannot be used, from one line that says why.
    stranger : str
        Why one of another kind cannot.
    """
    try:
        whole = path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as err:
        why = f"it cannot be read: {err.strerror}"
        raise refused(why) from err
    if not whole.startswith(magic):
        raise refused(stranger)
    content = unsealed(magic, whole)
    if content is None:
        raise refused(_DAMAGED)
    return content
