# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Make a page again from its bag or its history and say what departs from it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from valve_twin.report.language.words import language_of
from valve_twin.report.page import render_report
from valve_twin.report.provenance.compare import (
    input_differences,
    key_differences,
    version_differences,
)
from valve_twin.report.provenance.inputs import bag_origin, history_origin, history_rows
from valve_twin.report.provenance.page import page_differences
from valve_twin.report.provenance.record import BAG

if TYPE_CHECKING:
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.report.data import ReportData
    from valve_twin.report.provenance.page import WrittenPage


@dataclass(frozen=True, slots=True)
class Comparison:
    """What departs from a page, lines by what they are about; empty lists = nothing.

    Attributes
    ----------
    changed : list of str
        Inputs, keys of the configuration and sections of the page.
    versions : list of str
        Programs of another version; no difference where the page is the same.
    """

    changed: list[str] = field(default_factory=list)
    versions: list[str] = field(default_factory=list)


def compare_report(
    report: WrittenPage, config: ValveConfig, data: ReportData, where: str
) -> Comparison:
    """Hold a page against what its input gives now.

    Parameters
    ----------
    report : WrittenPage
        The page.
    config : ValveConfig
        The configuration that counts now.
    data : ReportData
        What the input gives now.
    where : str
        That input.

    Returns
    -------
    Comparison
        What is no longer the same.
    """
    then = report.provenance
    if then.origin.kind == BAG:
        inputs = input_differences(then.origin, bag_origin(config, where))
    else:
        inputs = input_differences(then.origin, history_origin(data), history_rows(data))
    keys = key_differences(then.keys(report.where), config.given)
    if config.name != then.valve:
        keys.insert(0, f"configuration: valve {then.valve} in the report, {config.name} now")
    same = replace(
        data,
        source=then.origin.where,
        written_ns=then.written_ns,
        provenance=report.carried,
        language=language_of(report.html),
    )
    pages = page_differences(report.html, render_report(same))
    return Comparison([*inputs, *keys, *pages], version_differences(then))
