# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A new field of an estimate or of one of its parts needs nothing here: all is derived."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ADDED = """
import importlib.util, sys, types

spec = importlib.util.find_spec("valve_twin.core.types")
text = open(spec.origin, encoding="utf-8").read()
for after, line in {
    "    reproducible: bool = True\\n\\n    def value": "    humidity: float = 0.25\\n",
    '    reason: Annotated[str, "guard_reasons"]\\n':
        '    weight: Annotated[float, "guard_weights"] = 0.5\\n',
    "    upper_95: float = np.nan\\n": "    spread: float = 0.125\\n",
}.items():
    assert text.count(after) == 1, after
    first = after.split("\\n", 1)[0] + "\\n"
    text = text.replace(after, after.replace(first, first + line))
module = importlib.util.module_from_spec(spec)
sys.modules["valve_twin.core.types"] = module
exec(compile(text, spec.origin, "exec"), module.__dict__)
"""
"""What somebody adds to `core.types`, of which nothing else knows."""

STORED = """
import dataclasses, pathlib
import sqlalchemy as sa
sys.path.insert(0, sys.argv[1])
from test_store import VALVE, bits, estimate, record
from valve_twin.io.history.migrations.schema import migrate
from valve_twin.io.history.store import History
from valve_twin.io.tables.json_lines import estimate_fields

found = estimate(2)
first, *rest = found.parameters
found = dataclasses.replace(
    found,
    humidity=0.75,
    parameters=(dataclasses.replace(first, spread=3.5), *rest),
    guards=tuple(dataclasses.replace(g, weight=0.1) for g in found.guards),
)
line = estimate_fields(dataclasses.replace(found, parameters=found.parameters[:1]), "/v")
assert (line["humidity"], line["guard_weights"], line["spread"]) == (0.75, [0.1, 0.1], [3.5])

folder = pathlib.Path(sys.argv[2])
engine = sa.create_engine(f"sqlite:///{folder / 'h.db'}")
with engine.begin() as connection:
    migrate(connection)
    # the migration that comes with the field
    connection.exec_driver_sql("ALTER TABLE estimate ADD COLUMN humidity DOUBLE")
engine.dispose()
with History(folder / "h.db") as history:
    history.store(VALVE, record(2), [found])
    assert [bits(e) for e in history.estimates(VALVE)] == [bits(found)]
    _, table, *_, lines = history.export(folder)
head, row = table.read_text(encoding="utf-8").splitlines()[:2]
assert head.endswith(",reproducible,humidity"), head
assert row.endswith(",0.75"), row
assert ",upper_95,spread,parameter_status," in head, head
assert '"weight": 0.1' in lines.read_text(encoding="utf-8")
"""

TOLD = """
try:
    import valve_twin.nodes.runtime.messages
except TypeError as err:
    print(err)
"""


def run(program: str, *arguments: str, root: Path) -> str:
    done = subprocess.run(
        [sys.executable, "-c", ADDED + program, *arguments],
        cwd=root,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_new_fields_are_stored_read_exported_and_written_as_json(
    tmp_path: Path, root: Path
) -> None:
    run(STORED, str(Path(__file__).parent), str(tmp_path), root=root)


def test_a_new_field_that_its_message_lacks_is_named(root: Path) -> None:
    assert run(TOLD, root=root) == (
        "Estimate.msg: field 'spread' is missing, but 'parameters.spread' of Estimate needs"
        " sequence<double>:"
        " write it in msg_defs/msg/Estimate.msg and build the messages anew\n"
    )
