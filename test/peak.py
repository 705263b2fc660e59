# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The most memory that a process has held.

`ru_maxrss` of a process that another one started begins with what that one held at the time.
"""

from pathlib import Path

STATUS, FORGET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def peak_mb() -> float:
    """Return it of this process, since it began or `forget_peak` [MB]."""
    lines = STATUS.read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))


def forget_peak() -> None:
    """Begin anew with what it holds now."""
    FORGET.write_text("5", encoding="ascii")
