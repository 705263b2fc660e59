# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a page carries comes back as it was, holds no secret, and cannot be changed unseen."""

import json

import pytest

from valve_twin.io.config.valve import load_config
from valve_twin.io.errors import ValveTwinError
from valve_twin.report.provenance.record import (
    HISTORY,
    Origin,
    Part,
    Provenance,
    configuration_text,
    parse_provenance,
    versions,
)

SECRET = """\
/**:
  ros__parameters:
    model: positioner
    valves: [hall/one, hall/two]
    history_url: postgresql://me:secret@host/db
    period_s: 1e-2
    rate: 3.0
    signals.position: {lower: -.inf, upper: 1.5, scale: 1.0e-5}
    hall/two: {aging: {label: "2 < 3 & load"}}
"""


@pytest.fixture
def configs(tmp_path):
    path = tmp_path / "valves.yaml"
    path.write_text(SECRET, encoding="utf-8")
    return load_config(path)


def provenance(config):
    origin = Origin(HISTORY, "postgresql://me:***@host/db", 0, {"cycles": Part(3, "ab")})
    text = configuration_text(config)
    return Provenance(config.name, origin, text, "by load", False, versions(), 17)


@pytest.mark.parametrize("which", [0, 1])
def test_the_configuration_of_a_valve_comes_back(configs, which):
    made = provenance(configs[which])
    back = parse_provenance(made.text, "page.html")
    assert back == made
    again = back.config("page.html")
    assert again.name == configs[which].name
    for field in ("model", "period_s", "signals", "cycles", "options", "aging", "csv"):
        assert getattr(again, field) == getattr(configs[which], field)


def test_it_holds_no_password_and_no_key_of_a_node(configs):
    text = provenance(configs[0]).text
    assert "secret" not in text
    assert "rate" not in configs[0].given
    assert "valves" not in configs[0].given


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("configuration",), "/**: {ros__parameters: {model: positioner}}"),
        (("written_ns",), "now"),
        (("written_ns",), -1),
        (("budget",), 1),
        (("label",), None),
        (("versions",), []),
        (("origin", "kind"), "guess"),
        (("origin", "parts"), [1]),
        (("origin", "parts", "cycles"), {"count": 3}),
        (("origin", "parts", "cycles", "count"), True),
        (("more",), 1),
    ],
)
def test_what_was_changed_is_refused(configs, path, value):
    found = json.loads(provenance(configs[0]).text)
    at = found
    for name in path[:-1]:
        at = at[name]
    at[path[-1]] = value
    with pytest.raises(ValveTwinError, match=r"page.html: its provenance is damaged or was chan"):
        parse_provenance(json.dumps(found), "page.html")
