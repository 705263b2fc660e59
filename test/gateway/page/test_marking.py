# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Marks and acknowledgements where the history is full or gone."""

from __future__ import annotations

import pytest

from test.gateway.test_web import store
from test.small_disk import small_disk
from valve_twin.gateway.page.marking import HistoryMarker, Seen, Work
from valve_twin.io.errors import StoreError


def test_a_history_that_is_gone_is_not_made_anew_by_a_mark(tmp_path):
    """An empty one took its place, and the page showed no valve and no failure."""
    marker, path = HistoryMarker(str(tmp_path / "history.sqlite")), tmp_path / "history.sqlite"
    with pytest.raises(StoreError, match="there is no such file"):
        marker.mark(Work("/v", "oiled", "anna"))
    with pytest.raises(StoreError, match="there is no such file"):
        marker.acknowledge(Seen("/v", 1, "", "anna"))
    assert not path.exists()


def test_a_full_disk_is_told_as_such_and_not_as_a_twin_that_runs(tmp_path):
    with small_disk(tmp_path / "disk", "2m") as disk:
        path = disk.place / "history.sqlite"
        store(path, "/v", range(1, 4), 0.0)
        disk.fill()
        marker = HistoryMarker(str(path))
        with pytest.raises(
            StoreError, match=r"No space left|disk is full|the free space"
        ) as caught:
            marker.mark(Work("/v", "oiled", "anna"))
        assert "its twin runs" not in str(caught.value)
        disk.empty()
        assert "maintenance noted from cycle 4 on" in marker.mark(Work("/v", "oiled", "anna"))
