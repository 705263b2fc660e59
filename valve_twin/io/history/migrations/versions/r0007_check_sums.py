# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Keep a check sum of every row; `check_sums.seal_all` fills it when the upgrade ends."""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"


def upgrade() -> None:
    """Add `check_sum` to the tables of cycles, estimates, maintenance and verdicts."""
    for table in ("cycle", "estimate", "maintenance", "verdict"):
        column = sa.Column("check_sum", sa.BigInteger, nullable=False, server_default="0")
        op.add_column(table, column)
