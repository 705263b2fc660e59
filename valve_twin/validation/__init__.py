# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The papers' published numbers, recomputed: what agrees, what does not, and what cannot."""

from valve_twin.validation.check import Check as Check
from valve_twin.validation.check import Kind as Kind
from valve_twin.validation.check import Verdict as Verdict
from valve_twin.validation.check import counted as counted
from valve_twin.validation.registry import Paper as Paper
from valve_twin.validation.registry import benchmark_names as benchmark_names
from valve_twin.validation.registry import get_benchmark as get_benchmark
from valve_twin.validation.registry import get_paper as get_paper
from valve_twin.validation.registry import paper_numbers as paper_numbers

__all__ = [
    "Check",
    "Kind",
    "Paper",
    "Verdict",
    "benchmark_names",
    "counted",
    "get_benchmark",
    "get_paper",
    "paper_numbers",
]
