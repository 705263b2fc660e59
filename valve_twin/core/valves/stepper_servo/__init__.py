# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A servo-valve driven by a stepper and a lead screw, after paper 004."""

from valve_twin.core.valves.stepper_servo.model import MODEL

__all__ = ["MODEL"]
