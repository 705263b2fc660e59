# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""An index of a namespace means what it meant at the first connection."""

from __future__ import annotations

from valve_twin.nodes.opcua_source.namespaces import Namespaces
from valve_twin.report.language.words import sentence, words

STANDARD, OWN, A, B, C = "http://opcfoundation.org/UA/", "urn:plc", "urn:a", "urn:b", "urn:c"


def seen(*lists: list[str | None]) -> Namespaces:
    """Return what has seen some lists, and asked for the index 2 of the first."""
    found = Namespaces()
    for uris in lists:
        found.see(uris)
        found.index(2)
    return found


def test_a_namespace_is_found_at_its_new_index_and_that_is_said():
    found = seen([STANDARD, OWN, A, B], [STANDARD, OWN, B, A])
    assert found.index(2) == 3
    assert (
        found.moved(2)
        == "the namespace urn:a has moved from ns=2 to ns=3, where its tags are taken"
    )


def test_a_namespace_that_is_gone_has_no_index_whoever_has_it_now():
    for now, who in (([STANDARD, OWN, B], B), ([STANDARD, OWN], "nothing")):
        found = seen([STANDARD, OWN, A], [*now])
        assert found.index(2) is None
        assert found.moved(2) == f"the namespace urn:a is gone, ns=2 is {who} now"
        filed = f"/press/x: the server has no tag ns=2;i=7 ({found.moved(2)})"
        gone = f"den Namensraum urn:a gibt es nicht mehr, ns=2 ist nun {who}"
        told = f"/press/x: der Server hat keinen Tag ns=2;i=7 ({gone})"
        assert sentence(filed, words("de")) == told.replace("nothing", "nichts")
    found.see([STANDARD, OWN, C, A])
    assert found.index(2) == 3
    found.see([STANDARD, OWN, A])
    assert (found.index(2), found.moved(2)) == (2, "")


def test_the_name_of_the_server_itself_may_change_and_a_list_that_is_none_says_nothing():
    found = seen([STANDARD, OWN, A], [STANDARD, "urn:renamed", A])
    assert (found.index(0), found.index(1), found.index(2)) == (0, 1, 2)
    for uris in ([], [None] * 3, [STANDARD, OWN, None]):
        assert seen([*uris]).index(2) == 2
    found.see([])
    assert found.index(2) == 2
