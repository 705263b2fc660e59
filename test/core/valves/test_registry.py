# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from importlib.metadata import EntryPoint
from types import SimpleNamespace

import pytest

from valve_twin.core.valves import registry
from valve_twin.core.valves.interface import ModelOptions
from valve_twin.core.valves.registry import MEMBERS, get_model, get_simulation, model_names


def test_every_valve_has_the_name_that_it_is_registered_under_and_the_whole_protocol():
    names = model_names()
    assert "first_order" in names
    assert list(names) == sorted(names)
    for name in names:
        model = get_model(name)
        assert model.name == name
        assert all(hasattr(model, m) for m in MEMBERS)


def test_an_unknown_valve_is_refused_with_the_nearest_name():
    with pytest.raises(ValueError, match="did you mean 'first_order'"):
        get_model("first_ordr")


def test_a_valve_without_a_plant_says_so():
    with pytest.raises(ValueError, match="'cycle_timing' cannot be simulated"):
        get_simulation("cycle_timing")


def test_a_model_that_lacks_members_is_refused_by_their_names(monkeypatch):
    whole = dict.fromkeys(MEMBERS)
    whole.pop("initial_state")
    entry = SimpleNamespace(name="mine", load=lambda: SimpleNamespace(**whole))
    monkeypatch.setattr(registry, "entry_points", lambda group: [entry])
    with pytest.raises(ValueError, match="lacks initial_state; inherit from"):
        get_model("mine")


def test_a_model_that_is_driven_by_no_input_of_its_own_is_refused(monkeypatch):
    own = {"inputs": ("command",), "driven_by": ("voltage",), "options": ModelOptions()}
    whole = dict.fromkeys(MEMBERS) | own
    entry = SimpleNamespace(name="driven", load=lambda: SimpleNamespace(**whole))
    monkeypatch.setattr(registry, "entry_points", lambda group: [entry])
    with pytest.raises(ValueError, match="driven_by names voltage, its inputs are command"):
        get_model("driven")


def test_a_model_with_options_of_another_kind_is_refused(monkeypatch):
    whole = dict.fromkeys(MEMBERS) | {"options": {"estimators": ()}}
    entry = SimpleNamespace(name="loose", load=lambda: SimpleNamespace(**whole))
    monkeypatch.setattr(registry, "entry_points", lambda group: [entry])
    with pytest.raises(ValueError, match="its options are a dict, which does not inherit from"):
        get_model("loose")


def test_a_valve_of_another_package_is_found_behind_ours(monkeypatch):
    model = get_model("first_order")
    entry = SimpleNamespace(name="a_user_s", load=lambda: model)
    monkeypatch.setattr(registry, "entry_points", lambda group: [entry])
    assert model_names()[-1] == "a_user_s"
    assert get_model("a_user_s") is model


@pytest.mark.parametrize(
    "value", ["valve_twin.nowhere:VALVE", "valve_twin.core:NOTHING", "raises_in_two_lines:VALVE"]
)
def test_a_valve_that_is_registered_and_not_there_gives_a_line(monkeypatch, tmp_path, value):
    (tmp_path / "raises_in_two_lines.py").write_text("raise ValueError('of\\ntheirs')")
    monkeypatch.syspath_prepend(str(tmp_path))
    entry = EntryPoint("my_gone_valve", value, registry.ENTRY_POINT_GROUP)
    monkeypatch.setattr(registry, "entry_points", lambda group: [entry])
    with pytest.raises(ValueError, match=f"'{value}', which cannot be loaded: ") as caught:
        get_model("my_gone_valve")
    assert "\n" not in str(caught.value)
