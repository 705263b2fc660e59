# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Say in lines what of a page's origin, configuration and versions is no longer the same."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.core.quantity import example
from valve_twin.report.provenance.inputs import rows_part
from valve_twin.report.provenance.record import BAG, versions

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.report.provenance.record import Origin, Part, Provenance

_NONE = "not given"


def input_differences(
    then: Origin, now: Origin, rows: Mapping[str, Sequence[Mapping[str, object]]] | None = None
) -> list[str]:
    """Return a line for each signal or kind of rows that changed.

    Parameters
    ----------
    then, now : Origin
        What the page was made from, and what is there now.
    rows : mapping, optional
        The rows of a history by kind: tells rows that were added from rows that were changed.
    """
    lines = []
    what = "samples of signal '{}'" if then.kind == BAG else "{}"
    for name in dict.fromkeys([*then.parts, *now.parts]):
        old, new = then.parts.get(name), now.parts.get(name)
        if old == new:
            continue
        head = f"input: {what.format(name)}: "
        kept = rows[name][: old.count] if rows and old and name in rows else ()
        if old and new and new.count > old.count > 0 and rows_part(kept) == old:
            added = new.count - old.count
            lines.append(f"{head}{added} were added, the {old.count} of the report are unchanged")
        else:
            lines.append(f"{head}{_part(old)} in the report, {_part(new)} in {now.where}")
    return lines


def key_differences(then: Mapping[str, object], now: Mapping[str, object]) -> list[str]:
    """Return a line for each key of the configuration that changed.

    Parameters
    ----------
    then, now : mapping
        What was configured and what is, by dotted name.
    """
    return [
        f"configuration: {key}: {_value(then, key)} in the report, {_value(now, key)} now"
        for key in dict.fromkeys([*then, *now])
        if _value(then, key) != _value(now, key)
    ]


def version_differences(then: Provenance) -> list[str]:
    """Return a line for each program whose version is another than when the page was made."""
    here = versions()
    return [
        f"version: {name}: {then.versions.get(name, _NONE)} in the report, "
        f"{here.get(name, _NONE)} here"
        for name in dict.fromkeys([*then.versions, *here])
        if then.versions.get(name) != here.get(name)
    ]


def _part(part: Part | None) -> str:
    return "none" if part is None else f"{part.count} with sha256 {part.sha256[:16]}"


def _value(values: Mapping[str, object], key: str) -> str:
    return example(values[key]) if key in values else _NONE
