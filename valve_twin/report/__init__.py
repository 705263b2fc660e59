# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The report page and the layouts for viewers."""

from valve_twin.report.data import ReportData
from valve_twin.report.page import render_report, write_report

__all__ = ["ReportData", "render_report", "write_report"]
