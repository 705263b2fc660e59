# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from __future__ import annotations

import pytest

from valve_twin.io.instruments.units import roles_of, split_name


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("Stellwert Y", "command"),
        ("Stellgröße", "command"),
        ("Stellungssollwert", "command"),
        ("Stellung X", "position"),
        ("Stellung", "position"),
        ("Stellungsregler Ausgang", "command"),
        ("Stellungsrückmeldung", "position"),
        ("Ventilstellung", "position"),
        ("Stellweg", "position"),
        ("Durchfluß", "volume flow"),
        ("x", "position"),
        ("LC74_20CV", "command"),
    ],
)
def test_words_say_what_a_channel_is_and_more_than_symbols(name, role):
    assert roles_of(*split_name(name)) == (role,)


def test_a_setpoint_of_the_position_is_a_command_first():
    assert roles_of("Soll-Stellung", "%")[0] == "command"
