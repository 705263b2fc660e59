# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Record which version computed a cycle; read one estimator over all cycles without a scan."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Add `cycle.software` (empty = not recorded) and the index by estimator."""
    op.add_column("cycle", sa.Column("software", sa.Text, nullable=False, server_default=""))
    op.create_index("ix_estimate_estimator", "estimate", ["valve_id", "estimator", "cycle"])
