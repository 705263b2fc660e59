# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The nameplate of a valve comes from its configuration."""

import pytest

from valve_twin.io.config.valve import load_config
from valve_twin.io.errors import ConfigError

FILE = """\
/**:
  ros__parameters:
    model: positioner
    nameplate: {tag: FV-1205, place: "hall 3 <b>", maker: ""}
"""


def test_what_is_given_is_kept_by_name(tmp_path):
    path = tmp_path / "valve.yaml"
    path.write_text(FILE, encoding="utf-8")
    (config,) = load_config(path)
    assert config.nameplate.given == {"tag": "FV-1205", "place": "hall 3 <b>"}


def test_an_unknown_plate_is_refused_with_the_nearest_name(tmp_path):
    path = tmp_path / "valve.yaml"
    path.write_text(FILE.replace("tag:", "tga:"), encoding="utf-8")
    with pytest.raises(ConfigError, match=r"nameplate\.tga.*nameplate\.tag"):
        load_config(path)
