# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A table of signatures as the JSON file that a valve package ships."""

from __future__ import annotations

import json
from pkgutil import get_data
from typing import TYPE_CHECKING

from valve_twin.core.diagnosis.generic.features import GAINS
from valve_twin.core.diagnosis.table import Signature, SignatureTable

if TYPE_CHECKING:
    from collections.abc import Iterable


def table_source(table: SignatureTable) -> str:
    """Return the text of a file from which `read_table` makes a table that equals `table`."""
    signatures = ((s.fault, s.severity, s.change, s.scatter) for s in table.signatures)
    parts = {
        "features": json.dumps(table.features),
        "covariance": _rows(table.covariance),
        "floor": json.dumps(table.floor),
        "levels": json.dumps(table.levels),
        "gains": json.dumps(table.gains),
        "slopes": json.dumps(table.slopes),
        "signatures": _rows(signatures),
    }
    return "{\n" + ",\n".join(f'"{name}": {text}' for name, text in parts.items()) + "\n}\n"


def read_table(package: str) -> SignatureTable:
    """Return the table of the file `signatures.json` that a package ships.

    Parameters
    ----------
    package : str
        `__package__` of its module `signatures`; `valve-twin campaign --derive` writes the file.
    """
    given = json.loads(get_data(package, "signatures.json") or b"")
    covariance, levels = (tuple(map(tuple, given[part])) for part in ("covariance", "levels"))
    signatures = tuple(
        Signature(fault, size, tuple(change), tuple(scatter))
        for fault, size, change, scatter in given["signatures"]
    )
    features, floor = tuple(given["features"]), tuple(given["floor"])
    of_any_valve = [name for name in GAINS if name in features]  # older files do not say
    gains, slopes = tuple(given.get("gains", of_any_valve)), tuple(given.get("slopes", ()))
    return SignatureTable(features, covariance, floor, signatures, levels, gains, slopes)


def _rows(rows: Iterable[object]) -> str:
    """Return an array with a line a row."""
    return "[\n" + ",\n".join(f" {json.dumps(row, allow_nan=False)}" for row in rows) + "\n]"
