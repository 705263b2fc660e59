# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Keep old cycles as hours and days."""

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"

_ID = sa.BigInteger().with_variant(sa.Integer, "sqlite")
_NUMBERS = ("minimum", "maximum", "mean", "quantile_05", "quantile_25", "median")
_COUNTS = ("cycles", "accepted", "reproducible", "samples", "lost", "missed", "gaps", "estimates")


def _whole(*names: str) -> list[sa.Column[int]]:
    return [sa.Column(name, sa.BigInteger, nullable=False) for name in names]


def _real(*names: str) -> list[sa.Column[float]]:
    return [sa.Column(name, sa.Double, nullable=True) for name in names]


def _text(*names: str) -> list[sa.Column[str]]:
    return [sa.Column(name, sa.Text, nullable=False) for name in names]


def _sum() -> sa.Column[int]:
    return sa.Column("check_sum", sa.BigInteger, nullable=False, server_default="0")


def upgrade() -> None:
    """Add the tables `condensate` and `condensed`."""
    op.create_table(
        "condensate",
        sa.Column("id", _ID, primary_key=True, autoincrement=True),
        sa.Column("valve_id", _ID, sa.ForeignKey("valve.id"), nullable=False),
        *_whole("span_s", "start_ns", "end_ns", "cycle", "last_cycle"),
        *_text("estimator", "parameter"),
        *_whole("count", "usable"),
        *_real(*_NUMBERS, "quantile_75", "quantile_95"),
        _sum(),
    )
    columns = ["valve_id", "estimator", "parameter", "span_s", "cycle"]
    op.create_index("ix_condensate", "condensate", columns)
    op.create_table(
        "condensed",
        sa.Column("valve_id", _ID, sa.ForeignKey("valve.id"), primary_key=True),
        *_whole("cycle", "first_cycle", "start_ns", "end_ns", *_COUNTS),
        *_text("state"),
        _sum(),
    )
