# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Keep the counters of every valve, and its event log."""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"

_ID = sa.BigInteger().with_variant(sa.Integer, "sqlite")
_WHOLE = ("cycle", "since_ns", "end_ns", "cycles", "reversals", "starts")
_TIMES = ("length_ns", "open_ns", "closed_ns", "near_ns")


def _whole(*names: str) -> list[sa.Column[int]]:
    return [sa.Column(name, sa.BigInteger, nullable=False) for name in names]


def _real(*names: str) -> list[sa.Column[float]]:
    return [sa.Column(name, sa.Double, nullable=True) for name in names]


def _text(*names: str) -> list[sa.Column[str]]:
    return [sa.Column(name, sa.Text, nullable=False) for name in names]


def _sum() -> sa.Column[int]:
    return sa.Column("check_sum", sa.BigInteger, nullable=False, server_default="0")


def upgrade() -> None:
    """Add the tables `counters` and `event`."""
    op.create_table(
        "counters",
        sa.Column("valve_id", _ID, sa.ForeignKey("valve.id"), primary_key=True),
        *_whole(*_WHOLE, *_TIMES),
        *_real("done", "closed", "stroke"),
        *_text("spans"),
        *_whole("direction"),
        *_real("begin", "level"),
        sa.Column("rests", sa.Boolean, nullable=False),
        _sum(),
    )
    op.create_table(
        "event",
        sa.Column("id", _ID, primary_key=True, autoincrement=True),
        sa.Column("valve_id", _ID, sa.ForeignKey("valve.id"), nullable=False, index=True),
        *_whole("stamp_ns", "cycle"),
        *_text("code", "status", "text"),
        sa.Column("acknowledged", sa.Boolean, nullable=False),
        *_text("acknowledged_by", "acknowledged_note"),
        *_whole("acknowledged_at_ns"),
        _sum(),
    )
