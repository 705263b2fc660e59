# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A small disk of its own that becomes full or read-only, as root may mount it."""

from __future__ import annotations

import os
import subprocess
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PAGE_B = 4096
"""What a file takes at least of such a disk [B]."""


class SmallDisk:
    """A `tmpfs`.

    Parameters
    ----------
    place : Path
        Where it is mounted.
    """

    def __init__(self, place: Path) -> None:
        self.place = place

    def fill(self, left_b: int = 0) -> None:
        """Fill it but for so many bytes."""
        free_b = os.statvfs(self.place).f_bavail * PAGE_B
        (self.place / "filler").write_bytes(bytes(free_b - left_b))

    def empty(self) -> None:
        """Take away what fills it."""
        (self.place / "filler").unlink()

    def mount(self, options: str) -> None:
        """Mount it anew, as `remount,ro` says."""
        subprocess.run(["mount", "-o", options, str(self.place)], check=True)


@contextmanager
def small_disk(place: Path, size: str = "4m") -> Iterator[SmallDisk]:
    """Mount a small disk; the test is skipped where there is no right to."""
    place.mkdir(exist_ok=True)
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "none", str(place)]
    if os.geteuid() or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("no right to mount a small file system")
    try:
        yield SmallDisk(place)
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)
