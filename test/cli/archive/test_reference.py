# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The verb that writes a stored reference, and what refuses to be one."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from valve_twin.bench.data.years import features, life
from valve_twin.cli.archive import reference
from valve_twin.cli.archive.reference import distinct
from valve_twin.cli.main import main
from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.aging.verdict import VerdictKind
from valve_twin.core.past.state import AgingState
from valve_twin.core.past.stored import freeze, thaw
from valve_twin.core.types import Maintenance
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.io.config.valve import parse_config
from valve_twin.io.errors import ConfigError
from valve_twin.io.feature_reference import MAGIC
from valve_twin.io.history.store import CycleRecord, History
from valve_twin.io.sealed import seal

FLAT = {"model": "press_cartridge", "cycles.start_signal": "v_in", "cycles.rearm_signal": "v_out"}


def lived(cycles, seed, *, wrong=0.0, since=1):
    """Return estimates and features of a press by cycle; `wrong` from a cycle on."""
    shown = [e for k in range(cycles) for e in features(1, 1000 * seed + k)]
    change = [wrong if k >= since - 1 else 0.0 for k in range(cycles)]
    whole = list(zip(life(cycles), shown, change, strict=True))
    return [(e, moved(f, e, by)) for e, f, by in whole]


def moved(feature, estimate, by):
    """Return features of the time of an estimate, changed as they are followed."""
    kind = MODEL.feature_set
    by = np.broadcast_to(by, len(kind.names))
    values = [
        replace(p, value=p.value * np.exp(b) if p.name in kind.relative else p.value + b)
        for p, b in zip(feature.parameters, by, strict=True)
    ]
    return replace(
        feature,
        cycle=estimate.cycle,
        start_ns=estimate.start_ns,
        end_ns=estimate.end_ns,
        parameters=tuple(values),
    )


def signature(fault, size=1):
    """Return the change by a medium fault (size 1), or another one."""
    found = [s for s in MODEL.signatures().signatures if s.fault == fault and s.severity > 0.0]
    return np.array(found[size].change)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A history of four sound presses, and the YAML of a press."""
    folder = tmp_path_factory.mktemp("sisters")
    with History(folder / "h.db") as history:
        for k in range(4):
            for e, f in lived(30, k + 1):
                record = CycleRecord(e.cycle, e.start_ns, e.end_ns, 800)
                history.store(f"/press/v{k}", record, [e, f])
    nested = {"/**": {"ros__parameters": {"model": "press_cartridge", "cycles": {}}}}
    nested["/**"]["ros__parameters"]["cycles"] = {"start_signal": "v_in", "rearm_signal": "v_out"}
    (folder / "press.yaml").write_text(yaml.safe_dump(nested), encoding="utf-8")
    return folder


def write(folder, name, *more, valves=("v0", "v1", "v2", "v3")):
    given = [word for v in valves for word in ("--valve", f"/press/{v}")]
    url, config = str(folder / "h.db"), str(folder / "press.yaml")
    out = folder / name
    code = main(["reference", "--url", url, "--config", config, *given, *more, "-o", str(out)])
    assert code == 0
    return out


@pytest.fixture(scope="module")
def written(folder):
    return write(folder, "presses.reference")


def config_of(path, **changes):
    flat = {**FLAT, "aging.feature_reference": str(path), **changes}
    return parse_config(flat, "press.yaml")[0].aging


def said(history, config, events=(), name="/press/new"):
    every = [e for pair in history for e in pair]
    return assess(every, events, config, parameters=MODEL.parameters, valve=name)


def test_a_fault_of_the_fourth_cycle_is_told_by_the_tenth_and_stays_told(written):
    history = lived(60, 9, wrong=signature("leak"), since=4)
    for count in (10, 30, 60):
        verdict = said(history[:count], config_of(written)).verdict
        assert verdict.kind is VerdictKind.VALVE, (count, verdict.evidence)
        assert verdict.fault == "leak"
        assert "presses.reference (4 valves, 120 cycles)" in verdict.evidence
    without = said(history[:10], AgingConfig()).verdict
    assert without.kind is not VerdictKind.VALVE


def test_a_sound_valve_is_ok_earlier_and_says_by_what(written):
    history = lived(40, 10)
    verdict = said(history[:10], config_of(written)).verdict
    assert verdict.kind is VerdictKind.OK, verdict.evidence
    assert "judged against the stored reference presses.reference" in verdict.evidence
    assert said(history[:9], AgingConfig()).verdict.kind is not VerdictKind.OK
    assert said(history, config_of(written)).verdict.kind is VerdictKind.OK


def test_maintenance_begins_anew_against_the_reference(written):
    history = lived(30, 11, wrong=signature("sensor_offset", 2), since=4)
    assert said(history, config_of(written)).verdict.fault == "sensor_offset"
    event = Maintenance(cycle=16, stamp_ns=0, note="", new_reference=True)
    found = said(history, config_of(written), [event])
    assert found.diagnosis.against.endswith("departs from it since cycle 16")


def test_without_a_reference_nothing_is_said_of_one(written):
    history = lived(30, 12)
    found = said(history, AgingConfig())
    assert found.diagnosis.against == ""
    assert "stored reference" not in found.verdict.evidence
    bare = said(history, config_of(written)).diagnosis
    assert bare.findings == found.diagnosis.findings


def test_a_state_that_let_go_of_old_cycles_still_tells_an_early_fault(written):
    pairs = lived(400, 13, wrong=signature("leak"), since=4)
    state = AgingState(recent=64, recent_features=64)
    for pair in pairs:
        for estimate in pair:
            state.add(estimate)
    past = thaw(*freeze(state)).past()
    assert past.features.cycle.min() > 16
    config = config_of(written)
    found = assess(past, (), config, parameters=MODEL.parameters, valve="/press/new")
    assert found.verdict.fault == "leak"
    assert "departs from it" in found.verdict.evidence


def test_cycles_long_after_a_start_are_not_judged_as_its_first_ones(written):
    names = MODEL.feature_set.names
    aged = np.array(
        [[-6e-4 * k if n.startswith("gain_") else 0.0 for n in names] for k in range(500)]
    )
    state = AgingState(recent=64, recent_features=64)
    for (estimate, feature), by in zip(lived(500, 13), aged, strict=True):
        state.add(estimate)
        state.add(moved(feature, estimate, by))
    late = Maintenance(cycle=200, stamp_ns=0, note="marked late", new_reference=True)
    kept_before = replace(state.past(), whole=None)

    def of(past, events):
        given = config_of(written)
        return assess(past, events, given, parameters=MODEL.parameters, valve="/press/new")

    for past, marks in ((state.past(), (late,)), (kept_before, ())):
        found = of(past, marks)
        assert "are kept no longer" in found.verdict.evidence
        assert found.verdict.kind is VerdictKind.OK
    on_time = Maintenance(cycle=500, stamp_ns=0, note="", new_reference=True)
    for events in ((), (on_time,)):
        assert "judged against" in of(state.past(), events).diagnosis.against


def test_some_cycles_are_taken_where_asked(folder):
    made = config_of(write(folder, "some.reference", "--cycles", "11..20")).reference
    assert made.cycles == 40
    assert {(x.first, x.last) for p in made.products for x in p.levels} == {(11, 20)}


def test_cycles_long_after_the_first_are_none_of_them(folder):
    """Of a condensed history the first 32 are kept, and the newest."""
    with History(folder / "condensed.db") as history:
        for e, f in lived(60, 5):
            number = e.cycle if e.cycle <= 32 else 2000 + e.cycle
            pair = [replace(x, cycle=number) for x in (e, f)]
            history.store("/press/v0", CycleRecord(number, e.start_ns, e.end_ns, 800), pair)
    out, url = folder / "condensed.reference", str(folder / "condensed.db")
    given = ["--url", url, "--config", str(folder / "press.yaml"), "--valve", "/press/v0"]
    assert main(["reference", *given, "-o", str(out)]) == 0
    assert [(x.first, x.last) for p in config_of(out).reference.products for x in p.levels] == [
        (1, 32)
    ]


def test_a_bag_that_is_given_twice_is_one_valve(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("a").mkdir()
    Path("link").symlink_to("a")
    assert distinct(["b", "a/", "a", "link", str(tmp_path / "b")]) == ["b", "a/"]


def test_bags_are_of_the_valves_that_are_named(folder, tmp_path, monkeypatch, capsys):
    """A reference is the valve's own only where its valve is named: a bag does not say whose."""

    def run(config, bag, **options):
        assert config.name == "/press"
        return SimpleNamespace(estimates=[e for pair in lived(20, 21) for e in pair]), None

    monkeypatch.setattr(reference, "run_offline", run)
    out, bags = tmp_path / "own.reference", ["--bag", "a", "--bag", "b"]
    given = ["reference", "--config", str(folder / "press.yaml"), *bags, "-o", str(out)]
    assert main(given) == 0
    assert config_of(out).reference.valves == ("a", "b")
    assert main([*given, "--valve", "press", "--valve", "/press"]) == 0
    assert config_of(out).reference.valves == ("/press",)
    capsys.readouterr()
    assert main([*given, "--valve", "/press"]) == 2
    assert "2 --bag and 1 --valve: name all" in capsys.readouterr().err


def test_a_file_is_written_by_a_yaml_that_names_it_already(folder, tmp_path):
    out, config = tmp_path / "first.reference", tmp_path / "named.yaml"
    whole = yaml.safe_load((folder / "press.yaml").read_text(encoding="utf-8"))
    whole["/**"]["ros__parameters"]["aging"] = {"feature_reference": str(out)}
    config.write_text(yaml.safe_dump(whole), encoding="utf-8")
    given = ["--url", str(folder / "h.db"), "--config", str(config), "--valve", "/press/v0"]
    assert main(["reference", *given, "-o", str(out)]) == 0
    assert config_of(out).reference.cycles == 30


def test_a_reference_that_is_none_of_this_valve_is_refused_in_one_line(written, tmp_path):
    damaged = tmp_path / "damaged.reference"
    damaged.write_bytes(written.read_bytes().replace(b"120", b"121", 1))
    foreign = tmp_path / "foreign.reference"
    foreign.write_text("{}", encoding="utf-8")
    for flat, why in (
        ({"aging.feature_reference": str(tmp_path / "none")}, "cannot be read"),
        ({"aging.feature_reference": str(damaged)}, "is damaged"),
        ({"aging.feature_reference": str(foreign)}, "no stored reference of this version"),
        ({"period_s": 0.01}, "made at a sampling time of 0.03 s, this valve has 0.01 s"),
        ({"model": "first_order", "cycles.rule": "window"}, "of model 'press_cartridge'"),
    ):
        given = {**FLAT, "aging.feature_reference": str(written), **flat}
        if flat.get("model"):
            given = {k: v for k, v in given.items() if not k.endswith("_signal")}
        with pytest.raises(ConfigError, match=why) as refused:
            parse_config(given, "press.yaml")
        assert "key 'aging.feature_reference'" in str(refused.value)
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d.pop("covariance"),
        lambda d: d.update(features=None),
        lambda d: d.update(products=[]),
        lambda d: d["products"][0].update(valves=[]),
        lambda d: d["products"][0]["valves"][0]["level"].pop(),
        lambda d: d["products"][0].update(shortest_s="short"),
        lambda d: d["covariance"].pop(),
        lambda d: d["covariance"][0].__setitem__(0, float("nan")),
        lambda d: d["products"][0]["valves"][0]["moved"].__setitem__(0, 1e300),
        lambda d: d.update(period_s=None),
    ],
)
def test_a_file_that_is_sealed_anew_and_lacks_values_is_refused(written, tmp_path, change):
    plain = json.loads(written.read_bytes().partition(b"\n")[2])
    change(plain)
    content, path = json.dumps(plain).encode(), tmp_path / "other.reference"
    path.write_bytes(seal(MAGIC, content) + content)
    with pytest.raises(ConfigError, match="holds values that no reference holds, or lacks some"):
        config_of(path)


@pytest.mark.parametrize(
    ("more", "why"),
    [
        (["--valve", "/press/none"], "there is no valve"),
        (["--valve", "/press/v0", "--cycles", "9"], "no range of cycles"),
        (["--valve", "/press/v0", "--cycles", "1..5"], "no product was made 8 times"),
        (["--valve", "/press/v0", "--cycles", "100..120"], "has no features in cycles"),
        ([], "give --url and --valve, or --bag"),
    ],
)
def test_what_makes_no_reference_is_told_in_one_line(folder, more, why, capsys):
    url, config = str(folder / "h.db"), str(folder / "press.yaml")
    out = folder / "none.reference"
    code = main(["reference", "--url", url, "--config", config, *more, "-o", str(out)])
    assert code == 2
    assert why in capsys.readouterr().err
    assert not out.exists()
