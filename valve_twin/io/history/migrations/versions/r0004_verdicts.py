# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Keep the verdicts on a valve."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"

_ID = sa.BigInteger().with_variant(sa.Integer, "sqlite")


def upgrade() -> None:
    """Add the table `verdict`."""
    op.create_table(
        "verdict",
        sa.Column("id", _ID, primary_key=True, autoincrement=True),
        sa.Column("valve_id", _ID, sa.ForeignKey("valve.id"), nullable=False, index=True),
        sa.Column("stamp_ns", sa.BigInteger, nullable=False),
        sa.Column("cycle", sa.BigInteger, nullable=False),
        sa.Column("verdict", sa.Integer, nullable=False),
        sa.Column("evidence", sa.Text, nullable=False),
    )
