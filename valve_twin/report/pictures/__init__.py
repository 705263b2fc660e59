# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Pictures that stand beside a file: SVG documents of their own."""
