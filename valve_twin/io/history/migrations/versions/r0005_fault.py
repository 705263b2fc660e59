# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Keep the name of the fault beside a verdict, so that no text is read for it."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"


def upgrade() -> None:
    """Add `verdict.fault` (empty = none, or not recorded)."""
    column = sa.Column("fault", sa.Text, nullable=False, server_default="")
    op.add_column("verdict", column)
