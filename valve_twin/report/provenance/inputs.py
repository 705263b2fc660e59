# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Hashes of what a page is made from: the mapped signals of a bag, the rows of a history.

They stand over values and stamps, not over files: a bag that was recovered, converted or packed
otherwise without loss is the same input.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.io.bags.folder import find_files
from valve_twin.io.bags.read import read_signals
from valve_twin.io.history.tables import estimate_row, to_row
from valve_twin.report.provenance.record import BAG, HISTORY, Origin, Part

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from valve_twin.io.cdr.signals import SignalBlock
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.report.data import ReportData


class _SignalHash:
    """Hash of one signal, the same however its samples are divided into blocks."""

    def __init__(self) -> None:
        self.count = 0
        self._streams = [hashlib.sha256() for _ in range(4)]

    def add(self, block: SignalBlock) -> None:
        """Take further samples."""
        self.count += len(block.stamp_ns)
        header = bytes([block.has_header]) * len(block.stamp_ns)
        log = b"" if block.log_ns is None else block.log_ns.astype("<i8").tobytes()
        stamps = block.stamp_ns.astype("<i8").tobytes()
        values = block.values.astype("<f8").tobytes()
        for stream, data in zip(self._streams, (stamps, values, log, header), strict=True):
            stream.update(data)

    @property
    def part(self) -> Part:
        """What was taken."""
        joined = b"".join(stream.digest() for stream in self._streams)
        return Part(self.count, hashlib.sha256(joined).hexdigest())


def bag_origin(config: ValveConfig, bag: str | Path) -> Origin:
    """Return what a bag holds of the signals of a valve.

    Parameters
    ----------
    config : ValveConfig
        The valve's configuration.
    bag : path
        Folder, metadata.yaml or .mcap file.

    Raises
    ------
    BagError
        If it cannot be read.
    """
    hashes = {name: _SignalHash() for name in config.signals}
    for block in read_signals(bag, config.signals.values()):
        hashes[block.signal].add(block)
    size = sum(path.stat().st_size for path in find_files(bag).files if path.is_file())
    return Origin(BAG, str(bag), size, {name: made.part for name, made in hashes.items()})


def history_origin(data: ReportData) -> Origin:
    """Return what of a history stands on a page."""
    parts = {name: rows_part(rows) for name, rows in history_rows(data).items()}
    file = Path(data.source)
    size = file.stat().st_size if file.is_file() else 0
    return Origin(HISTORY, data.source, size, parts)


def history_rows(data: ReportData) -> Mapping[str, list[dict[str, object]]]:
    """Return the rows of a history on a page by kind, as they are stored."""
    counters = [] if data.counters is None else [asdict(data.counters)]
    condensed = {} if data.condensed is None else {"condensed cycles": [to_row(data.condensed, 0)]}
    return {
        "cycles": [to_row(cycle, 0) for cycle in data.cycles],
        "estimates": [estimate_row(0, 0, estimate) for estimate in data.estimates],
        "maintenance": [to_row(event, 0) for event in data.maintenance],
        "counters": counters,
        "events": [to_row(event, 0) for event in data.events],
        **condensed,
    }


def rows_part(rows: Iterable[Mapping[str, object]]) -> Part:
    """Return number and hash of rows."""
    total, count = hashlib.sha256(), 0
    for row in rows:
        count += 1
        total.update(json.dumps(row, sort_keys=True).encode())
    return Part(count, total.hexdigest())
