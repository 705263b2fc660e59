# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What SQLite keeps beside its database until it is taken in: the write-ahead log."""
