# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A record that nobody has described: which signals follow which, and where cycles begin."""
