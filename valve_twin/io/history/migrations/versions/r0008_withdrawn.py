# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Keep of a maintenance event whether it was withdrawn, and why."""

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"


def upgrade() -> None:
    """Add `maintenance.withdrawn` (false) and `maintenance.withdrawn_note` (empty)."""
    for column in (
        sa.Column("withdrawn", sa.Boolean, nullable=False, server_default=sa.false()),
        sa.Column("withdrawn_note", sa.Text, nullable=False, server_default=""),
    ):
        op.add_column("maintenance", column)
