# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The offline run: bad values are left out and counted, the last cycle is kept for the report."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest

from test.bag_samples import write_sample
from valve_twin.core.simulation import SimulatedValve
from valve_twin.core.types import Estimate, EstimateStatus, Frames, Validity
from valve_twin.core.valves.registry import get_simulation
from valve_twin.io.bags.read import BagWriter
from valve_twin.io.config.valve import load_config
from valve_twin.io.errors import BagError, ConfigError
from valve_twin.io.mcap.reader import McapFile
from valve_twin.io.offline.run import (
    Record,
    assess_record,
    describe_bad,
    describe_refused,
    estimate_bag,
    join_predictions,
    run_bag,
    trivial_fit,
)
from valve_twin.io.tables.json_lines import json_lines
from valve_twin.report.build import bag_data, trivial_note
from valve_twin.report.tables import source_files

CYCLES = 4
START_NS = 10**18
BAD = {300: math.nan, 301: math.inf, 302: -math.inf, 1200: 99.0, 1201: -99.0, 2000: math.nan}
"""By sample, what the position shows instead of its value."""

PREFIX = "/sim/press/valve_1"


@pytest.fixture(scope="module")
def config(tmp_path_factory, root):
    """Return the simulated press valve, with limits of the position."""
    path = tmp_path_factory.mktemp("offline") / "config.yaml"
    text = (root / "config" / "simulated_press.yaml").read_text(encoding="utf-8")
    limits = "topic: spool_position\n        lower: -0.1\n        upper: 1.1"
    path.write_text(text.replace("topic: spool_position", limits, 1), encoding="utf-8")
    (loaded,) = load_config(path)
    return loaded


@pytest.fixture(scope="module")
def write(tmp_path_factory):
    """Return a function that records a simulated press valve with some values replaced."""
    simulation = get_simulation("press_cartridge")
    block = SimulatedValve(simulation, 3).advance(CYCLES * simulation.cycle_samples)

    def record(position=(), command=(), ahead_s=0):
        path = tmp_path_factory.mktemp("record") / "bag"
        other, commanded = dict(position), dict(command)
        with BagWriter(path) as bag:
            for n, stamp in enumerate((block.stamp_ns + START_NS).tolist()):
                v_in = commanded.get(n, float(block.inputs[n, 0]))
                ahead_ns = stamp + ahead_s * 10**9
                write_sample(bag, f"{PREFIX}/command/v_in", ahead_ns, v_in, log_ns=stamp)
                write_sample(bag, f"{PREFIX}/command/v_out", stamp, float(block.inputs[n, 1]))
                measured = other.get(n, float(block.position[n]))
                write_sample(bag, f"{PREFIX}/spool_position", stamp, measured)
        return path

    return record


@pytest.fixture(scope="module")
def clean(config, write):
    return run_bag(config, write())


@pytest.fixture(scope="module")
def spoilt(config, write):
    return run_bag(config, write(BAD))


def gains(record):
    return np.array([e.value("K_in") for e in record.estimates if e.used_by_trend])


def test_estimates_are_the_same_without_predictions(config, write, clean):
    alone = run_bag(config, write(), predict=False)
    assert [repr(e) for e in alone.estimates] == [repr(e) for e in clean.estimates]
    assert alone.cycles == clean.cycles
    assert clean.predictions
    assert not alone.predictions


def test_every_cycle_is_closed_and_estimated(clean):
    assert [c.cycle for c in clean.cycles] == [1, 2, 3, 4]
    assert np.isfinite(gains(clean)).all()


def test_bad_values_are_counted_and_told_with_topic_and_remedy(config, spoilt):
    assert spoilt.counts["spool_position"].bad == len(BAD)
    (line,) = describe_bad(config, "record", spoilt)
    assert line.startswith(f"record: topic '{PREFIX}/spool_position': of 3400 values {len(BAD)} ")
    assert "outside -0.1 .. 1.1" in line
    assert "signals.spool_position.lower" in line


@pytest.mark.parametrize("ahead_s", [3600, -500])
def test_a_record_whose_clocks_differ_is_told_with_the_offset(config, write, ahead_s):
    path = write(ahead_s=ahead_s)
    lines = describe_bad(config, path, run_bag(config, path, predict=False))
    where = "ahead of" if ahead_s > 0 else "behind"
    wanted = f"{path}: signal v_in is stamped {abs(ahead_s)} s {where} spool_position"
    assert lines[0].startswith(wanted)


def test_nothing_is_told_about_a_clean_record(config, clean):
    assert describe_bad(config, "record", clean) == []


def test_estimates_survive_bad_values(clean, spoilt):
    """Six samples of 3400 left out move a gain by far less than it scatters (1 %)."""
    assert [c.cycle for c in spoilt.cycles] == [1, 2, 3, 4]
    assert gains(spoilt) == pytest.approx(gains(clean), rel=0.005)
    assert all(e.status is not EstimateStatus.REFUSED for e in spoilt.estimates)


def test_a_cycle_of_bad_values_is_refused_and_the_next_one_estimated(config, write, clean):
    cycle = get_simulation("press_cartridge").cycle_samples
    record = run_bag(config, write(dict.fromkeys(range(cycle, 2 * cycle), math.nan)))
    refused = {e.cycle for e in record.estimates if e.status is EstimateStatus.REFUSED}
    left_out = {c.cycle for c in record.cycles if not c.accepted}
    assert refused | left_out == {2}
    last = [e.value("K_in") for e in record.estimates if e.used_by_trend and e.cycle == CYCLES]
    assert last == pytest.approx(gains(clean)[-1:], rel=0.01)


def test_refusals_are_counted_by_their_code_and_told_by_their_first_line():
    reasons = [
        ("few_samples", "3 usable samples"),
        ("gaps", "2 gaps"),
        ("few_samples", "no sample"),
    ]
    refused = [
        Estimate("m", "e", n, 0, 1, (), EstimateStatus.REFUSED, line, code, used_by_trend=True)
        for n, (code, line) in enumerate(reasons, 1)
    ]
    lines = [
        "record: 2 of 3 cycles give no estimate: 3 usable samples",
        "record: 1 of 3 cycles give no estimate: 2 gaps",
    ]
    assert describe_refused("record", Record(estimates=refused)) == lines
    files = {1: ("a, b.csv",), 2: ("c.csv",), 3: ("a, b.csv", "d.csv")}
    assert describe_refused("record", Record(estimates=refused, files=files)) == [
        "record: 2 of 3 cycles give no estimate (a, b.csv, d.csv): 3 usable samples",
        "record: 1 of 3 cycles give no estimate (c.csv): 2 gaps",
    ]


def test_a_command_that_is_no_number_is_counted(config, write):
    record = run_bag(config, write(command={500: math.nan}))
    assert record.counts["v_in"].bad == 1
    assert np.isfinite(gains(record)).all()


def test_bad_values_are_marked_in_the_predictions(config, write):
    first = 3 * get_simulation("press_cartridge").cycle_samples + 100
    record = run_bag(config, write({first: math.nan, first + 1: 50.0}))
    last = join_predictions(record.predictions)
    assert last is not None
    marked = np.isin(last.stamp_ns, START_NS + 30_000_000 * np.array([first, first + 1]))
    assert marked.sum() == 2
    assert ((last.validity == Validity.BAD_INPUT) == marked).all()
    assert np.isfinite(last.simulated[marked]).all()


def test_the_same_record_gives_the_same_bytes(config, write):
    def text(bag):
        record = run_bag(config, bag)
        return "\n".join(json_lines(record.estimates, assess_record(config, record), "/v"))

    bag = write(BAD)
    assert text(bag) == text(bag)


def test_predictions_kept_are_those_of_the_last_cycle(clean):
    joined = join_predictions(clean.predictions)
    assert joined is not None
    assert joined.cycle == CYCLES
    assert joined.stamp_ns[0] == clean.cycles[-1].start_ns
    assert joined.stamp_ns[-1] == clean.cycles[-1].end_ns
    assert (np.diff(joined.stamp_ns) == 30_000_000).all()


def test_no_predictions_are_joined_to_none():
    assert join_predictions([]) is None


def test_each_closed_cycle_is_told(config, write):
    told = []
    record = run_bag(config, write(), on_cycle=lambda: told.append(1))
    assert len(told) == len(record.cycles)


def test_a_run_opens_its_bag_once(config, write, monkeypatch):
    path, opened, plain = write(), [], McapFile.__init__

    def noted(self, file, *args, **given):
        opened.append(file)
        plain(self, file, *args, **given)

    monkeypatch.setattr(McapFile, "__init__", noted)
    run_bag(config, path, predict=False)
    assert len(opened) == len(set(opened))


def test_an_open_last_cycle_is_left_out_on_demand(config, write):
    record = Record()
    for event in estimate_bag(config, write(), close_last=False):
        record.add(event)
    assert [c.cycle for c in record.cycles] == [1, 2, 3]


def test_a_bag_is_checked_before_the_first_event(config, tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        write_sample(bag, "/other", START_NS, 0.0)
    with pytest.raises(BagError, match=r"spool_position|v_in"):
        estimate_bag(config, tmp_path / "bag")


def test_a_signal_that_is_not_mapped_is_told_before_the_bag_is_read(config, tmp_path):
    signals = {k: v for k, v in config.signals.items() if k != "v_out"}
    with pytest.raises(ConfigError, match=r"signals\.v_out: not mapped.*give its topic"):
        estimate_bag(dataclasses.replace(config, signals=signals), tmp_path / "no_bag")


# -- the trivial model


def frames(position, command):
    n = len(position)
    return Frames(
        stamp_ns=np.arange(n, dtype=np.int64) * 10**9,
        position=np.array(position, dtype=float),
        inputs=np.array(command, dtype=float).reshape(n, -1),
        counter=np.full(n, np.nan),
        reference=np.full(n, np.nan),
        valid=np.ones(n, dtype=bool),
    )


def test_the_trivial_model_is_as_good_as_the_command_is_near():
    position = [0.0, 0.0, 1.0, 1.0]  # standard deviation 0.5
    assert trivial_fit(frames(position, position)) == pytest.approx(100.0)
    assert trivial_fit(frames(position, [0.1, 0.1, 1.1, 1.1])) == pytest.approx(80.0)
    assert trivial_fit(frames(position, [0.5] * 4)) == pytest.approx(0.0)


def test_the_trivial_model_leaves_out_what_is_no_number():
    fit = trivial_fit(frames([0.0, math.nan, 1.0, 1.0, 0.0], [0.1, 9.0, 1.1, 1.1, 0.1]))
    assert fit == pytest.approx(80.0)


def test_there_is_no_trivial_model_of_two_commands_or_of_rest():
    assert math.isnan(trivial_fit(frames([0.0, 1.0], [[0.0, 0.0], [1.0, 1.0]])))
    assert math.isnan(trivial_fit(frames([0.5, 0.5], [0.5, 0.5])))


def test_the_press_valve_has_no_note_about_the_trivial_model(clean):
    assert trivial_note(clean) == ()


def test_the_page_names_the_first_files_of_a_cycle_and_counts_the_others(clean, config):
    files = {1: ("a.csv",), 2: ("a, b.csv", "c.csv"), 3: ("a.csv", "d.csv", "e.csv", "f.csv")}
    record = dataclasses.replace(clean, files=files)
    data = bag_data(config, "bag", record, assess_record(config, record))
    named = [row[:2] for row in source_files(data).rows]
    assert named == [
        ["a.csv", "1"],
        ["a, b.csv, c.csv", "2"],
        ["a.csv, d.csv, e.csv and 1 more", "3"],
    ]
    lines = [json.loads(x) for x in json_lines(record.estimates, None, "/valve", files=files)]
    assert {x["file"] for x in lines if x["cycle"] == 3} == {"a.csv, d.csv, e.csv and 1 more"}
