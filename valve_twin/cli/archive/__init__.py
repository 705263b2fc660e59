# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Verbs about many bags or a history: batch, fleet, history, backtest."""
