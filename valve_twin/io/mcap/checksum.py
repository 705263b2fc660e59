# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""CRC-32 of bags: by ISA-L where it is installed, five times faster than zlib, else by zlib."""

from __future__ import annotations

try:
    from isal.isal_zlib import crc32
except ImportError:
    from zlib import crc32

__all__ = ["crc32"]
