# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import math
import pickle
from dataclasses import dataclass, field, make_dataclass
from enum import Enum

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from valve_twin.core.quantity import (
    Descriptor,
    Kind,
    QuantityError,
    check_quantities,
    checked,
    describe,
    example,
    needed,
    quantity,
    records,
    replaced,
    setting,
)


@dataclass(frozen=True)
class Tank:
    volume: float = quantity(1.0, "m^3", "Volume", lower=0.1, upper=5.0, assumed=True)

    def __post_init__(self):
        check_quantities(self)


@pytest.mark.parametrize("value", [0.0, 6.0, math.nan, math.inf, "1.0", True, None])
def test_refuses_a_value_with_its_name_value_and_range(value):
    with pytest.raises(ValueError, match=r"Tank\.volume = .*from 0\.1 to 5 \[m\^3\]") as caught:
        Tank(volume=value)
    assert repr(value) in str(caught.value)


def test_a_refusal_holds_its_reason_apart_from_the_owner():
    with pytest.raises(QuantityError) as caught:
        Tank(volume=9.0)
    for error in (caught.value, pickle.loads(pickle.dumps(caught.value))):
        assert error.reason == "volume = 9.0: must be a number from 0.1 to 5 [m^3]"
        assert str(error) == f"Tank.{error.reason}"


def test_takes_the_ends_of_the_range_and_integers():
    assert [Tank(v).volume for v in (0.1, 1, 5.0)] == [0.1, 1, 5.0]


def test_an_assumption_carries_its_tag():
    assert [d.description for d in describe(Tank)] == ["Volume (assumed)"]


class Rule(Enum):
    FAST = "fast"
    SLOW = "slow"


@dataclass(frozen=True, slots=True)
class Inner:
    depth: float = quantity(1.0, "m", "How deep it is.")


@dataclass(frozen=True, slots=True)
class Limit:
    parameter: str
    value: float = needed("1", "Where it is.")
    relative: bool = setting(default=True, text="Whether it is relative.")


@dataclass(frozen=True, slots=True)
class Outer:
    rule: Rule = setting(Rule.FAST, "Which way.")
    low_s: float = quantity(0.5, "s", "Shortest time.")
    high_s: float = quantity(2.0, "s", "Longest time.", upper=9.0)
    names: tuple[str, ...] = setting((), "Some names.")
    inner: Inner = field(default_factory=Inner)
    limits: tuple[Limit, ...] = records(Limit)


def test_a_table_is_made_of_the_fields():
    specs = {s.name: s for s in describe(Outer, "o.", ["K_in"])}
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
    assert specs["o.low_s"].description == "Shortest time."
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
    built = replaced(Outer(), values, "o.")
    limits = (Limit("K_in", -20.0), Limit("K_out", 5.0, relative=False))
    assert built == Outer(rule=Rule.SLOW, inner=Inner(3.0), limits=limits)


def test_a_record_without_its_value_is_refused():
    with pytest.raises(ValueError, match=r"'o.limits.K_in.value' is missing; write it or remove"):
        replaced(Outer(), {"o.limits.K_in.relative": True}, "o.")


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
    checked = Descriptor("a", kind, value).check(given_value)
    assert checked == value
    assert type(checked) is type(value)


BAD = [
    (Descriptor("a", Kind.FLOAT, 0.5), "x", "value 'x' is no number; write for example 0.5"),
    (Descriptor("a", Kind.FLOAT, 0.5), True, "value True is no number"),
    (Descriptor("a", Kind.FLOAT, 0.5, "s", "", 0.0, 1.0), 2, r"2.0 s is outside .* write 0 to 1"),
    (
        Descriptor("a", Kind.FLOAT, 0.5, "s", "", 0.0),
        math.nan,
        "nan is not a number; write 0 or more",
    ),
    (Descriptor("a", Kind.INT, 5), 1.5, "value 1.5 is no integer; write for example 5"),
    (
        Descriptor("a", Kind.BOOL, True),
        "yes",
        "value 'yes' is no true or false; write for example true",
    ),
    (
        Descriptor("a", Kind.STRINGS, ("b",)),
        "b",
        r'is no list of texts; write for example \["b"\]',
    ),
    (
        Descriptor("a", Kind.FLOATS, (1.0,)),
        ["b"],
        r"is no list of numbers; write for example \[1.0\]",
    ),
    (Descriptor("a", Kind.FLOATS, ()), 5, r"is no list of numbers; write for example \[1.0\]"),
    (
        Descriptor("a", Kind.STRING, "b", choices=("b", "c")),
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


def test_an_instance_is_described_with_its_values():
    inner = {d.name: d.default for d in describe(Outer(inner=Inner(3.0), rule=Rule.SLOW))}
    assert (inner["inner.depth"], inner["rule"]) == (3.0, "slow")


def test_a_number_without_both_limits_is_refused_in_words():
    with pytest.raises(
        ValueError, match=r"Outer.high_s = 10.0: must be a number, 9 or less \[s\]"
    ):
        check_quantities(Outer(high_s=10.0))


def test_a_word_that_is_no_choice_is_refused():
    lid = make_dataclass(
        "Lid", [("state", str, setting("open", "State.", choices=("open", "shut")))]
    )
    with pytest.raises(ValueError, match=r"Lid\.state = 'ajar': must be one of open, shut"):
        check_quantities(lid("ajar"))


def test_a_note_and_an_assumption_stand_behind_the_text():
    known = Descriptor("a", Kind.FLOAT, 1.0, "s", "Length", assumed=True, note="empty = none")
    assert known.description == "Length (assumed); empty = none"


def test_settings_by_name_are_checked_and_the_nearest_name_is_told():
    assert checked(Tank, {"volume": 2}) == {"volume": 2.0}
    with pytest.raises(
        ValueError, match=r"^tank\.volum: unknown setting; did you mean 'volume'\?$"
    ):
        checked(Tank, {"volum": 2.0}, where="tank.")
    with pytest.raises(ValueError, match=r"^tank\.volume: value 9\.0 m\^3 is outside its limits"):
        checked(Tank, {"volume": 9.0}, where="tank.")
