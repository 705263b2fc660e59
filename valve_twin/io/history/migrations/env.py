# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Entry point of alembic: runs the revisions on the connection that the history hands over."""

from alembic import context

from valve_twin.io.history.tables import METADATA, SCHEMA_TABLE

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=METADATA,
    version_table=SCHEMA_TABLE,
    transactional_ddl=True,
)
with context.begin_transaction():
    context.run_migrations()
