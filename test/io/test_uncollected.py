# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Garbage is left alone for a while and no longer."""

import gc

import pytest

from valve_twin.io.uncollected import uncollected


def fails():
    with uncollected():
        assert not gc.isenabled()
        with uncollected():
            pass
        assert not gc.isenabled()
        msg = "it goes wrong"
        raise ValueError(msg)


def test_garbage_is_left_alone_until_the_block_ends_whatever_happens():
    assert gc.isenabled()
    with pytest.raises(ValueError, match="it goes wrong"):
        fails()
    assert gc.isenabled()
