# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Valves, cycles, estimates and maintenance events."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None

_ID = sa.BigInteger().with_variant(sa.Integer, "sqlite")


def upgrade() -> None:
    """Create the tables."""
    meta = op.create_table(
        "meta",
        sa.Column("name", sa.String(64), primary_key=True),
        sa.Column("value", sa.Text, nullable=False),
    )
    op.bulk_insert(meta, [{"name": "content", "value": "valve_twin history"}])
    op.create_table(
        "valve",
        sa.Column("id", _ID, primary_key=True, autoincrement=True),
        sa.Column("name", sa.String(255), nullable=False, unique=True),
    )
    op.create_table(
        "cycle",
        sa.Column(
            "valve_id", _ID, sa.ForeignKey("valve.id"), primary_key=True, autoincrement=False
        ),
        sa.Column("cycle", sa.BigInteger, primary_key=True, autoincrement=False),
        sa.Column("start_ns", sa.BigInteger, nullable=False),
        sa.Column("end_ns", sa.BigInteger, nullable=False),
        sa.Column("samples", sa.BigInteger, nullable=False),
        sa.Column("lost", sa.BigInteger, nullable=False),
        sa.Column("missed_cycles", sa.BigInteger, nullable=False),
        sa.Column("accepted", sa.Boolean, nullable=False),
        sa.Column("reason", sa.Text, nullable=False),
        sa.Column("reproducible", sa.Boolean, nullable=False),
    )
    op.create_table(
        "estimate",
        sa.Column("id", _ID, primary_key=True, autoincrement=True),
        sa.Column("valve_id", _ID, sa.ForeignKey("valve.id"), nullable=False),
        sa.Column("cycle", sa.BigInteger, nullable=False),
        sa.Column("position", sa.Integer, nullable=False),
        sa.Column("estimator", sa.String(64), nullable=False),
        sa.Column("model", sa.Text, nullable=False),
        sa.Column("start_ns", sa.BigInteger, nullable=False),
        sa.Column("end_ns", sa.BigInteger, nullable=False),
        sa.Column("status", sa.Integer, nullable=False),
        sa.Column("reason", sa.Text, nullable=False),
        sa.Column("parameters", sa.Text, nullable=False),
        sa.Column("mse_test", sa.Double),
        sa.Column("mse_train", sa.Double),
        sa.Column("fit_test", sa.Double),
        sa.Column("fit_train", sa.Double),
        sa.Column("condition_number", sa.Double),
        sa.Column("lag", sa.BigInteger, nullable=False),
        sa.Column("noise_sigma", sa.Double),
        sa.Column("samples_used", sa.BigInteger, nullable=False),
        sa.Column("samples_masked", sa.Text, nullable=False),
        sa.Column("missed_cycles", sa.BigInteger, nullable=False),
        sa.Column("used_by_trend", sa.Boolean, nullable=False),
        sa.Column("reproducible", sa.Boolean, nullable=False),
        sa.UniqueConstraint("valve_id", "cycle", "estimator", name="uq_estimate_cycle"),
    )
    op.create_table(
        "maintenance",
        sa.Column("id", _ID, primary_key=True, autoincrement=True),
        sa.Column("valve_id", _ID, sa.ForeignKey("valve.id"), nullable=False, index=True),
        sa.Column("stamp_ns", sa.BigInteger, nullable=False),
        sa.Column("cycle", sa.BigInteger, nullable=False),
        sa.Column("note", sa.Text, nullable=False),
        sa.Column("new_reference", sa.Boolean, nullable=False),
    )
