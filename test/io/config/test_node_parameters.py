# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a stranger in the domain may not set: places, passwords, ports, how much is kept."""

import re

import pytest

from valve_twin.io.config.node_parameters import NODE_PARAMETERS

GUARDED = re.compile(
    r"folder|path|_url|^bags?$|keep|kept|_bytes$|^max_bag|budget|unsaved|^port$|foxglove|host|"
    r"user|pki|key$|cert|prefix|allow_|disk"
)


@pytest.mark.parametrize("node", NODE_PARAMETERS)
def test_places_and_bounds_of_what_is_kept_are_not_set_from_afar(node):
    found = {s.name: s.local for s in NODE_PARAMETERS[node] if GUARDED.search(s.name)}
    assert "allow_remote_configuration" in found
    assert [name for name, local in found.items() if not local] == []
