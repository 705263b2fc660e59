# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The profile of the middleware: there for the first node only, never in place of a user's own."""

import os
from pathlib import Path
from xml.etree import ElementTree

import pytest

from valve_twin.nodes.player import transport

VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"


@pytest.fixture(autouse=True)
def fresh(monkeypatch):
    """No profile is set before and none is left behind."""
    for name in (VARIABLE, "FASTDDS_DEFAULT_PROFILES_FILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(transport, "_made", [])
    yield
    transport.tidy()


def test_the_profile_stands_until_the_first_node_has_read_it():
    transport.quicken()
    path = Path(os.environ[VARIABLE])
    (period,) = ElementTree.parse(path).findall(".//{*}heartbeatPeriod")
    assert [part.text for part in period] == ["0", "10000000"]
    assert transport.is_quick()
    transport.tidy()
    assert not path.exists()
    assert VARIABLE not in os.environ
    assert transport.is_quick()


@pytest.mark.parametrize("name", [VARIABLE, "FASTDDS_DEFAULT_PROFILES_FILE"])
def test_a_user_s_profile_is_left_alone(monkeypatch, tmp_path, name):
    monkeypatch.setenv(name, str(tmp_path / "mine.xml"))
    transport.quicken()
    transport.tidy()
    assert os.environ[name] == str(tmp_path / "mine.xml")
    assert not transport.is_quick()
