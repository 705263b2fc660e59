# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Nonlinear magnetic field of an axisymmetric section: static, and with eddy currents."""

from valve_twin.design.field.excitation import Trapezoid
from valve_twin.design.field.model import FieldModel, make_model
from valve_twin.design.field.picture import draw_field
from valve_twin.design.field.solve import Field, solve_field
from valve_twin.design.field.transient import Transient, run_transient, static_force

__all__ = [
    "Field",
    "FieldModel",
    "Transient",
    "Trapezoid",
    "draw_field",
    "make_model",
    "run_transient",
    "solve_field",
    "static_force",
]
