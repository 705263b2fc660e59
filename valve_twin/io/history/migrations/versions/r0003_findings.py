# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Keep what was checked of an estimate and how far the estimators lie apart."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    """Add `estimate.findings` (empty = not recorded)."""
    op.add_column("estimate", sa.Column("findings", sa.Text, nullable=False, server_default=""))
