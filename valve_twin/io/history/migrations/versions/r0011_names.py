# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Keep a check sum of every valve's name."""

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"


def upgrade() -> None:
    """Add `valve.check_sum`; 0 = not sealed yet."""
    op.add_column(
        "valve", sa.Column("check_sum", sa.BigInteger, nullable=False, server_default="0")
    )
