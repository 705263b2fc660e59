# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""CSV and JSON lines: import, export, reading with the line of every mistake."""
