# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A file that is there as a whole or as it was before, whatever the disk does meanwhile."""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from pathlib import Path


def write_whole(path: str | Path, content: str | bytes) -> None:
    """Write a file beside its place and put it there once it is complete.

    What is no plain file, such as a pipe, and a file in a folder that takes no other is written in
    place; a link is followed.

    Parameters
    ----------
    path : str or Path
        File; one that exists is replaced and keeps its access rights.
    content : str or bytes
        Text is written as UTF-8.

    Raises
    ------
    OSError
        If it cannot be written; it names the file that was asked for.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    target = Path(os.path.realpath(path))
    part = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        if Path(path).exists() and not _can_replace(target):
            Path(path).write_bytes(data)  # the pipe behind /dev/stdout has no path of its own
            return
        try:
            part.write_bytes(data)
            if target.exists():
                shutil.copymode(target, part)
            os.replace(part, target)
        except BaseException:
            with suppress(OSError):
                part.unlink(missing_ok=True)
            raise
    except OSError as err:
        raise OSError(err.errno, err.strerror or str(err), str(path)) from err


def _can_replace(target: Path) -> bool:
    """Return whether a plain file can be put in its place."""
    return target.is_file() and os.access(target.parent, os.W_OK)
