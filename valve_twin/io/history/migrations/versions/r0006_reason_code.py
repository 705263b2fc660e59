# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Keep the code of a refusal beside its reason, so that no text is read for it."""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"


def upgrade() -> None:
    """Add `estimate.reason_code` (empty = not refused, or not recorded)."""
    column = sa.Column("reason_code", sa.Text, nullable=False, server_default="")
    op.add_column("estimate", column)
