# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Verbs about a bag: info, recover, cut, convert, import, replay."""
