# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Schema of the history database, revision by revision (alembic)."""
