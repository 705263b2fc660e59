# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The water hydraulic two-stage cartridge valve of a press (paper 002)."""

from valve_twin.core.valves.press_cartridge.model import MODEL

__all__ = ["MODEL"]
