# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""From the drawing of a solenoid to its curves: geometry, field computation, characteristic map.

Offline, needs the packages of `valve_twin[design]`, imports the core only. A description that
cannot be computed is a `ValueError` of one line: dimension, value, allowed range.
"""
