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

import errno

_OF_DISKS = {
    *(errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.ENODEV, errno.ENXIO),
    *(errno.ENOENT, errno.EACCES, errno.ENOTCONN, errno.ETIMEDOUT),
    *(getattr(errno, name, errno.EIO) for name in ("EHOSTDOWN", "ESTALE")),
}
_REMEDIES = {
    errno.ENOSPC: "free some space",
    errno.EDQUOT: "free some space",
    errno.EFBIG: "free some space, or allow larger files",
    errno.EROFS: "make the disk writable again",
    errno.EACCES: "give this user the right to it",
    errno.EPERM: "give this user the right to it",
}
"""What to do by what the system says of a file that cannot be read or written."""

_SAID_OF_DISKS = ("disk is full", "readonly database", "unable to open", "disk i/o error")
"""What the system and SQLite say of a disk that is full, read-only, broken or not there: a folder
that nothing is mounted on has no such file, or belongs to root."""


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


def unwritable(path: object, err: OSError) -> str:
    """Return what is said of a file or folder that cannot be written: why, and what to do.

    Parameters
    ----------
    path : object
        It, as the user knows it.
    err : OSError
        What the system says.
    """
    return unusable(f"{path}: cannot be written", err)


def unusable(path: object, err: OSError) -> str:
    """Return what is said of a file or folder that cannot be used: why, and what to do.

    Parameters
    ----------
    path : object
        It, as the user knows it.
    err : OSError
        What the system says.
    """
    remedy = _REMEDIES.get(err.errno or 0, "check the folder, its access rights and free space")
    return f"{path}: {err.strerror or err}: {remedy}"


def may_pass(err: BaseException | None) -> bool:
    """Return whether an error comes from a disk, so that to try again later is of use.

    Parameters
    ----------
    err : BaseException or None
        The error; None = there is none.
    """
    while err is not None:
        if isinstance(err, PermissionError) and err.filename is None:  # a port that root has
            return False
        if isinstance(err, OSError) and err.errno in _OF_DISKS:
            return True
        if any(sign in str(err).lower() for sign in _SAID_OF_DISKS):
            return True
        err = err.__cause__
    return False
