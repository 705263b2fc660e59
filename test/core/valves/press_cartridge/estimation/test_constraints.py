# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Inequalities over named parameters are read, not evaluated, and refused in one line."""

import numpy as np
import pytest

from valve_twin.core.valves.press_cartridge.estimation.constraints import (
    THETA,
    no_inequalities,
    parse_inequalities,
    physical_inequalities,
)


def holds(limits, **theta):
    values = np.array([theta.get(name, 0.0) for name in limits.names])
    return bool((limits.matrix @ values <= limits.bound).all())


@pytest.mark.parametrize(
    ("text", "row", "bound"),
    [
        ("theta_2 + 0.3*theta_3 <= 0", {1: 1.0, 2: 0.3}, 0.0),
        ("theta_5 >= 0.01", {4: -1.0}, -0.01),
        ("1 <= 2 * (theta_1 - theta_2) / 4", {0: -0.5, 1: 0.5}, -1.0),
        ("-theta_3 + 1e-3 <= theta_3 - 2", {2: -2.0}, -2.001),
        ("theta_4 * 3 * -2 <= +6", {3: -6.0}, 6.0),
    ],
)
def test_a_linear_inequality_is_read(text, row, bound):
    limits = parse_inequalities([text])
    expected = np.zeros(8)
    expected[list(row)] = list(row.values())
    assert limits.matrix[0] == pytest.approx(expected)
    assert limits.bound[0] == pytest.approx(bound)
    assert limits.labels == (text,)


def test_a_chain_and_an_equation_become_two_inequalities_each():
    chain = parse_inequalities(["0 <= theta_2 <= 0.5"])
    assert holds(chain, theta_2=0.2)
    assert not holds(chain, theta_2=-0.1)
    assert not holds(chain, theta_2=0.6)
    equation = parse_inequalities(["theta_2 == 0.5"])
    assert holds(equation, theta_2=0.5)
    assert not holds(equation, theta_2=0.4)
    assert not holds(equation, theta_2=0.6)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("theta_2 + theta_3", "it has no <=, >= or =="),
        ("theta_2 <", "it cannot be read"),
        ("", "it cannot be read"),
        ("theta_2 < 0", "only <=, >= and == are understood"),
        ("theta_2 * theta_3 <= 0", "a product of parameters is not linear"),
        ("1 / theta_3 <= 0", "a quotient needs a number other than 0 below"),
        ("theta_3 / 0 <= 0", "a quotient needs a number other than 0 below"),
        ("theta_2 ** 2 <= 0", r"only \+ - \* / are understood"),
        ("thete_2 <= 0", "did you mean 'theta_2'"),
        ("abs(theta_2) <= 1", "only numbers, parameters"),
        ("__import__('os') <= 1", "only numbers, parameters"),
        ("theta_2 <= 'a'", "is not a number"),
        ("theta_2 <= True", "is not a number"),
        ("theta_2 <= 1e999", "not finite"),
        ("0 <= 1", "it constrains no parameter"),
        ("theta_2 - theta_2 <= 1", "it constrains no parameter"),
    ],
)
def test_another_text_is_refused_in_one_line_that_quotes_it(text, what):
    with pytest.raises(ValueError, match=what) as caught:
        parse_inequalities(["theta_1 <= 0", text])
    message = str(caught.value)
    assert f'constraint "{text}"' in message
    assert "theta_2 + 0.3*theta_3 <= 0" in message
    assert "\n" not in message


def test_the_signs_are_those_of_the_paper():
    paper = physical_inequalities(extended=False)
    good = {"theta_1": -0.9, "theta_2": 0.01, "theta_3": -0.05, "theta_5": 0.03}
    assert holds(paper, **good)
    wrong = {1: 0.1, 2: -0.1, 3: 0.1, 4: 0.1, 5: -0.1, 7: -0.1, 8: -0.1}
    for term, value in wrong.items():
        assert not holds(paper, **{**good, f"theta_{term}": value})
    assert not holds(paper, **{**good, "theta_1": -1.1})
    assert holds(paper, **good, theta_6=1.0)
    assert holds(paper, **good, theta_6=-1.0)


@pytest.mark.parametrize(
    "theta",
    [
        {"theta_1": -0.3, "theta_7": 0.5},
        {"theta_1": -0.3, "theta_8": 0.8},
        {"theta_1": -0.3, "theta_3": -0.05, "theta_5": 0.06},
        {"theta_1": -0.3, "theta_2": 0.01, "theta_4": -0.01},
    ],
)
def test_what_the_paper_lacks_keeps_the_pole_and_the_flow_physical(theta):
    assert holds(physical_inequalities(extended=False), **theta)
    assert not holds(physical_inequalities(v_in_max=0.8, v_out_max=0.5, extended=True), **theta)


def test_a_part_leaves_out_what_then_always_holds():
    part = physical_inequalities(extended=False).part([0, 1])
    assert part.names == ("theta_1", "theta_2")
    assert part.labels == ("theta_1 <= 0", "theta_1 >= -1", "theta_2 >= 0")


def test_sets_add_up():
    both = physical_inequalities() + parse_inequalities(["theta_2 <= 0.5"])
    assert both.labels[-1] == "theta_2 <= 0.5"
    assert len(both.bound) == len(physical_inequalities().bound) + 1
    assert len((no_inequalities() + both).bound) == len(both.bound)
    assert both.names == THETA
