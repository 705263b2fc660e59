# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A table of signatures as the Python module that a valve package ships."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.diagnosis.table import SignatureTable

_HEAD = '''# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How faults change the features of a cycle; written by `valve-twin campaign --derive`."""

# ruff: noqa: E501
from valve_twin.core.diagnosis.table import Signature, SignatureTable

'''


def table_source(table: SignatureTable) -> str:
    """Return the source of a module whose `TABLE` equals `table`."""
    lines = [f"TABLE = SignatureTable(\n    features={table.features!r},\n    covariance=("]
    lines += [f"        {_numbers(row)}," for row in table.covariance]
    lines += ["    ),", f"    floor={_numbers(table.floor)},", "    signatures=("]
    for s in table.signatures:
        lines += [
            f'        Signature("{s.fault}", {s.severity!r},',
            f"            {_numbers(s.change)},",
            f"            {_numbers(s.scatter)}),",
        ]
    lines.append("    ),")
    if table.levels:
        lines.append(f"    levels={table.levels!r},")
    return f"{_HEAD}# fmt: off\n" + "\n".join([*lines, ")", ""])


def _numbers(values: Sequence[float]) -> str:
    return "(" + ", ".join(repr(float(v)) for v in values) + ")"
