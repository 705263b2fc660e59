# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Codes of refusals: they travel with their line and stand in the documents."""

import copy
import pickle
from pathlib import Path

import pytest

from valve_twin.core.refusal import Refusal, RefusalCode, code_of

DOCUMENT = Path(__file__).parents[2] / "docs" / "troubleshooting.md"


@pytest.mark.parametrize(
    "carry", [copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))]
)
def test_a_refusal_keeps_line_and_code_in_a_copy_and_in_another_process(carry):
    carried = carry(Refusal(RefusalCode.GAPS, "3 gaps"))
    assert carried == "3 gaps"
    assert code_of(carried) == "gaps"


def test_a_line_without_a_code_is_other():
    assert code_of("the seal is blue") == "other"


def test_the_documents_list_every_code_and_no_other():
    lines = DOCUMENT.read_text(encoding="utf-8").split("| `reason_code` | why |")[1].splitlines()
    table = lines[2 : lines.index("", 2)]
    assert [line.split("`")[1] for line in table] == [code.value for code in RefusalCode]
