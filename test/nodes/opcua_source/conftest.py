# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the tests of sources share."""

import pytest

from valve_twin.nodes.opcua_source import subscription


@pytest.fixture
def patience(monkeypatch):
    """Take no PLC for gone where the machine has no core for it."""
    monkeypatch.setattr(subscription, "TIMEOUT_S", 30.0)
