# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Nonlinear magnetostatic field of an axisymmetric section, its force and inductances."""

from valve_twin.design.field.model import FieldModel, make_model
from valve_twin.design.field.picture import draw_field
from valve_twin.design.field.solve import Field, solve_field

__all__ = ["Field", "FieldModel", "draw_field", "make_model", "solve_field"]
