# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What others, or the disk, do to the files and the folder of a bag while it is written."""

from __future__ import annotations

import errno
import os
from enum import Enum
from typing import TYPE_CHECKING

from valve_twin.io.bags.metadata import FILE_NAME
from valve_twin.io.errors import BagError, unwritable

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


class LostFileError(BagError):
    """Somebody deleted, cut or moved away the running file; the next one can be begun."""


class TakenFolderError(BagError):
    """Another bag took the place of the folder."""


class Gone(Enum):
    """What somebody did to a file while it was written."""

    DELETED = "somebody deleted the file"
    CUT = "somebody cut the file"
    MOVED = "the file was moved away, or another one has its name"

    def told(self, count: int) -> str:
        """Return what is said of a file with so many messages [1]."""
        what = "it is finished where it is now" if self is Gone.MOVED else "they count as lost"
        return f"{self.value} while {count} messages were in it: {what}"


class GoneError(OSError):
    """A file is not what it was; `gone` says how."""

    def __init__(self, gone: Gone) -> None:
        super().__init__(errno.ENOENT, gone.value)
        self.gone = gone


def what_became(path: Path, number: int, size: int) -> Gone | None:
    """Return what somebody did to an open file; None where it stands as it was written.

    Parameters
    ----------
    path : Path
        Its name.
    number : int
        The number that the system has given it.
    size : int
        What was written [B].
    """
    status = os.fstat(number)
    if status.st_nlink == 0:
        return Gone.DELETED
    if status.st_size < size:
        return Gone.CUT
    try:
        named = os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return Gone.MOVED
    except OSError:  # nobody can tell
        return None
    return None if _alike(named, status) or os.path.samestat(named, status) else Gone.MOVED


def _alike(one: os.stat_result, other: os.stat_result) -> bool:
    """Return whether two may be one: some network file systems number a file anew."""
    return one.st_size == other.st_size and one.st_mtime_ns == other.st_mtime_ns


def stands(path: Path, status: os.stat_result | None) -> bool:
    """Return whether a name leads to a file that was closed so; its number may be used anew.

    Parameters
    ----------
    path : Path
        Its name.
    status : os.stat_result, optional
        What the system said of it when it was closed; None = nothing.
    """
    try:
        return status is not None and _alike(os.stat(path), status)
    except OSError:
        return False


class OwnFolder:
    """The folder of one bag that is written.

    Parameters
    ----------
    path : Path
        Folder to make; it must not exist.

    Raises
    ------
    BagError
        If it exists or cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            path.mkdir(parents=True)
            self._status = os.stat(path)
        except FileExistsError:
            msg = f"{path}: exists already; give a new folder or remove it"
            raise BagError(msg) from None
        except OSError as err:
            raise BagError(unwritable(path, err)) from err

    def is_own(self) -> bool:
        """Return whether its name leads to it still."""
        try:
            return os.path.samestat(self._status, os.stat(self.path))
        except OSError:
            return False

    def adopt(self, is_known: Callable[[Path], bool]) -> bool:
        """Make it where it is gone; take another for it that holds nothing else, as a disk's.

        Return whether it is another one than before.

        Parameters
        ----------
        is_known : callable
            Gets the path of a file; returns whether it is one of the bag, not only named so.

        Raises
        ------
        TakenFolderError
            If there is another one with files that are not of this bag.
        OSError
            If it cannot be made.
        """
        self.path.mkdir(parents=True, exist_ok=True)
        if self.is_own():
            return False
        found = list(self.path.glob("*.mcap"))
        if not all(map(is_known, found)) or (not found and (self.path / FILE_NAME).exists()):
            msg = f"{self.path}: another bag took its place"
            raise TakenFolderError(msg)
        self._status = os.stat(self.path)
        return True


def full(path: Path, err: OSError) -> BagError:
    """Return what is said where the disk takes no more.

    Parameters
    ----------
    path, err : Path, OSError
        What cannot be written, and why.
    """
    return BagError(f"{unwritable(path, err)}; what is written stays readable")
