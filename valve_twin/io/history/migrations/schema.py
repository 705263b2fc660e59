# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Schema of the history database: made at once where it is new, else revision by revision."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import sqlalchemy as sa

from valve_twin.io.history.tables import METADATA, SCHEMA_TABLE, SCHEMA_VERSION

if TYPE_CHECKING:
    from sqlalchemy.engine import Connection

_HERE = Path(__file__).parent


def create(connection: Connection) -> None:
    """Make the tables of an empty database inside the running transaction.

    They are those that all revisions lead to; alembic, 12 MB of it, is loaded for old ones only.

    Parameters
    ----------
    connection : Connection
        Connection with an open write transaction.
    """
    METADATA.create_all(connection)
    revision = sa.Column("version_num", sa.String(32), nullable=False)
    key = sa.PrimaryKeyConstraint("version_num", name=f"{SCHEMA_TABLE}_pkc")  # as alembic's
    schema = sa.Table(SCHEMA_TABLE, sa.MetaData(), revision, key)
    schema.create(connection)
    connection.execute(schema.insert().values(version_num=SCHEMA_VERSION))


def migrate(connection: Connection, revision: str = "head") -> None:
    """Bring the schema to a revision inside the running transaction.

    Parameters
    ----------
    connection : Connection
        Connection with an open write transaction.
    revision : str
        Revision to reach, "head" = the newest.
    """
    from alembic import command
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", str(_HERE).replace("%", "%%"))
    config.attributes["connection"] = connection
    command.upgrade(config, revision)
