# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is said of files that cannot be used."""

from __future__ import annotations

import errno
import os

import pytest

from valve_twin.io.errors import StoreError, may_pass
from valve_twin.io.history.database import Database
from valve_twin.io.history.store import History


@pytest.mark.parametrize("number", [errno.EACCES, errno.EPERM])
def test_who_may_not_read_a_history_is_not_sent_to_write_it(number, monkeypatch, tmp_path):
    path = tmp_path / "history.sqlite"
    History(path).close()

    def refuse(*_: object) -> None:
        raise OSError(number, os.strerror(number), str(path))

    monkeypatch.setattr(Database, "_check_content", refuse)
    with pytest.raises(StoreError) as caught:
        History(path, read_only=True)
    said = f"{path}: cannot be opened: {os.strerror(number)}: give this user the right to it"
    assert str(caught.value) == said


def test_a_port_that_nobody_but_root_may_take_is_no_disk_that_comes_back():
    why = os.strerror(errno.EACCES)
    assert may_pass(PermissionError(errno.EACCES, why, "/var/lib/history.sqlite"))
    assert not may_pass(PermissionError(errno.EACCES, why))
