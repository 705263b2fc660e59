# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import math
from dataclasses import dataclass, field
from enum import Enum

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from valve_twin.core.quantity import Kind, describe, quantity, setting
from valve_twin.io.config.schema import (
    Spec,
    attribute_texts,
    build,
    dataclass_specs,
    example,
)


class Rule(Enum):
    FAST = "fast"
    SLOW = "slow"


@dataclass(frozen=True, slots=True)
class Inner:
    """Inner part.

    Attributes
    ----------
    depth : float
        How deep it is [m].
    """

    depth: float = 1.0


@dataclass(frozen=True, slots=True)
class Limit:
    """A limit.

    Attributes
    ----------
    parameter : str
        Name.
    value : float
        Where it is [1].
    relative : bool
        Whether it is relative.
    """

    parameter: str
    value: float
    relative: bool = True


@dataclass(frozen=True, slots=True)
class Outer:
    """Outer part.

    Attributes
    ----------
    rule : Rule
        Which way.
    low_s, high_s : float
        Shortest and longest time
        over two lines [s].
    names : tuple of str
        Some names.
    inner : Inner
        More.
    limits : tuple of Limit
        Many.
    """

    rule: Rule = Rule.FAST
    low_s: float = 0.5
    high_s: float = field(default=2.0, metadata={"upper": 9.0})
    names: tuple[str, ...] = ()
    inner: Inner = field(default_factory=Inner)
    limits: tuple[Limit, ...] = ()


def test_a_table_is_made_of_annotations_and_docstring():
    specs = {s.name: s for s in dataclass_specs(Outer, "o", ["K_in"])}
    assert list(specs) == [
        "o.rule",
        "o.low_s",
        "o.high_s",
        "o.names",
        "o.inner.depth",
        "o.limits.K_in.value",
        "o.limits.K_in.relative",
    ]
    assert specs["o.rule"].choices == ("fast", "slow")
    assert specs["o.rule"].default == "fast"
    assert specs["o.low_s"].description == "Shortest and longest time over two lines."
    assert (specs["o.high_s"].unit, specs["o.high_s"].upper) == ("s", 9.0)
    assert (specs["o.inner.depth"].kind, specs["o.inner.depth"].unit) == (Kind.FLOAT, "m")


def test_a_dataclass_is_built_from_checked_values():
    values = {
        "o.rule": "slow",
        "o.inner.depth": 3.0,
        "o.limits.K_in.value": -20.0,
        "o.limits.K_out.value": 5.0,
        "o.limits.K_out.relative": False,
    }
    built = build(Outer, "o", values)
    limits = (Limit("K_in", -20.0), Limit("K_out", 5.0, relative=False))
    assert built == Outer(rule=Rule.SLOW, inner=Inner(3.0), limits=limits)


def test_a_record_without_its_value_is_refused():
    with pytest.raises(ValueError, match=r"'o.limits.K_in.value' is missing; write it or remove"):
        build(Outer, "o", {"o.limits.K_in.relative": True})


def test_options_keep_their_type_and_limits():
    @dataclass(frozen=True)
    class Options:
        lag_s: float = quantity(0.5, "s", "Longest lag.", lower=0.0, upper=1.0)
        estimators: tuple[str, ...] = setting(("a",), "Which run.", choices=("a", "b"))
        samples: int = quantity(3, "1", "How many.")
        on: bool = setting(default=True, text="Whether.")

    kinds = {d.name: d.kind for d in describe(Options, "options.")}
    assert kinds == {
        "options.lag_s": Kind.FLOAT,
        "options.estimators": Kind.STRINGS,
        "options.samples": Kind.INT,
        "options.on": Kind.BOOL,
    }


def test_docstrings_are_read_by_attribute():
    assert attribute_texts(Outer)["low_s"] == attribute_texts(Outer)["high_s"]


GOOD = [
    (Kind.FLOAT, 1, 1.0),
    (Kind.INT, 2.0, 2),
    (Kind.STRING, "x", "x"),
    (Kind.STRING, 13, "13"),
    (Kind.STRINGS, ["a", ""], ("a",)),
    (Kind.FLOATS, [1, 2.5], (1.0, 2.5)),
    (Kind.BOOL, False, False),
]


@pytest.mark.parametrize(("kind", "given_value", "value"), GOOD)
def test_values_are_taken_in_the_type_of_the_parameter(kind, given_value, value):
    checked = Spec("a", kind, value, "").check(given_value)
    assert checked == value
    assert type(checked) is type(value)


BAD = [
    (Spec("a", Kind.FLOAT, 0.5, ""), "x", "value 'x' is no number; write for example 0.5"),
    (Spec("a", Kind.FLOAT, 0.5, ""), True, "value True is no number"),
    (Spec("a", Kind.FLOAT, 0.5, "", "s", 0.0, 1.0), 2, r"2.0 s is outside .* write 0 to 1"),
    (Spec("a", Kind.FLOAT, 0.5, "", "s", 0.0), math.nan, "nan is not a number; write 0 or more"),
    (Spec("a", Kind.INT, 5, ""), 1.5, "value 1.5 is no integer; write for example 5"),
    (
        Spec("a", Kind.BOOL, True, ""),
        "yes",
        "value 'yes' is no true or false; write for example true",
    ),
    (Spec("a", Kind.STRINGS, ("b",), ""), "b", r'is no list of texts; write for example \["b"\]'),
    (
        Spec("a", Kind.FLOATS, (1.0,), ""),
        ["b"],
        r"is no list of numbers; write for example \[1.0\]",
    ),
    (
        Spec("a", Kind.STRING, "b", "", choices=("b", "c")),
        "d",
        "'d' is unknown; write one of b, c",
    ),
]


@pytest.mark.parametrize(("spec", "value", "says"), BAD)
def test_wrong_values_are_told_with_what_to_write(spec, value, says):
    with pytest.raises(ValueError, match=says):
        spec.check(value)


@given(
    st.one_of(
        st.booleans(), st.floats(allow_nan=False), st.lists(st.floats(allow_nan=False), min_size=1)
    )
)
def test_examples_are_yaml_of_the_same_value(value):
    assert yaml.safe_load(example(value)) == value
