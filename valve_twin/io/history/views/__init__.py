# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Views of the history on PostgreSQL for Grafana and other programs that speak SQL."""
