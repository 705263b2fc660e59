# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What stands in for interfaces that others keep private."""

import sys
from types import SimpleNamespace

import pytest

from valve_twin import compat


@pytest.mark.parametrize("arguments", [("m", {"i": 1}), (("m", {"i": 1}),)])
def test_message_and_info_come_with_either_executor(arguments):
    assert compat.message_and_info(arguments) == ("m", {"i": 1})


def test_an_answer_is_intercepted_and_can_be_sent():
    sent, seen = [], []
    service = SimpleNamespace(send_response=lambda *answer: sent.append(answer))
    send = compat.intercept_responses(service, lambda *answer: seen.append(answer))
    service.send_response("response", "header")
    assert (sent, seen) == ([], [("response", "header")])
    send(*seen[0])
    assert sent == seen


def test_the_interpreter_is_shared():
    before = sys.getswitchinterval()
    try:
        compat.share_interpreter()
        assert sys.getswitchinterval() == pytest.approx(compat.SWITCH_S)
    finally:
        sys.setswitchinterval(before)
