# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design STEP`: from the drawing of a solenoid to its curves, one module a step."""
