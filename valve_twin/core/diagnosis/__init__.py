# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Tell a fault from aging: what a cycle shows, how faults change it, which fault it is."""

from valve_twin.core.diagnosis.changes.finding import Diagnosis, Finding
from valve_twin.core.diagnosis.config import DetectionConfig
from valve_twin.core.diagnosis.detection import detect
from valve_twin.core.diagnosis.table import FaultType, Signature, SignatureTable

__all__ = [
    "DetectionConfig",
    "Diagnosis",
    "FaultType",
    "Finding",
    "Signature",
    "SignatureTable",
    "detect",
]
