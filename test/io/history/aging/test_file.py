# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A file of what is known of a valve's aging is whole and of this code, or not used."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.aging.cutting.memory import Memory
from valve_twin.core.past.state import AgingState
from valve_twin.core.past.stored import freeze
from valve_twin.core.types import Estimate, EstimateStatus, ParameterValue
from valve_twin.io.errors import StoreError
from valve_twin.io.history.aging.file import Known, load, origin_of, pack, write

CONFIG = AgingConfig(max_candidates=20)
ORIGIN = origin_of("/v", "press_cartridge")


@pytest.fixture
def known():
    state, memory = AgingState(), Memory()
    random = np.random.default_rng(1)
    values = random.standard_normal(100)
    for n, value in enumerate(values.tolist(), 1):
        state.add(
            Estimate(
                model="press_cartridge",
                estimator="e",
                cycle=n,
                start_ns=n,
                end_ns=n + 1,
                parameters=(ParameterValue("gain", value),),
                status=EstimateStatus.ACCEPTED,
                reason="",
                used_by_trend=True,
            )
        )
    memory.pieces(np.arange(100.0), values, CONFIG)
    return Known(state, memory, {"at": [100, 0]})


def packed(known):
    return pack(freeze(known.state), known.memory, known.place, ORIGIN, CONFIG)


@pytest.fixture
def path(tmp_path, known):
    write(tmp_path / "known", packed(known))
    return tmp_path / "known"


def test_it_comes_back_to_the_last_bit(path, known):
    found = load(path, ORIGIN, CONFIG)
    assert found is not None
    assert found.place == known.place
    assert packed(found)[:200] == packed(known)[:200]
    ours, theirs = found.state.past().trend, known.state.past().trend
    assert np.array_equal(ours.value("gain"), theirs.value("gain"))
    assert np.array_equal(ours.cycle, theirs.cycle)
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_where_there_is_none_there_is_nothing(tmp_path):
    assert load(tmp_path / "none", ORIGIN, CONFIG) is None


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_a_flipped_bit_is_noticed(path, share):
    content = bytearray(path.read_bytes())
    content[round(share * (len(content) - 1))] ^= 4
    path.write_bytes(content)
    with pytest.raises(StoreError, match="it is damaged: the history is read anew"):
        load(path, ORIGIN, CONFIG)


def test_half_a_file_is_noticed(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(StoreError, match="it is damaged"):
        load(path, ORIGIN, CONFIG)


@pytest.mark.parametrize("name", ["layout", "software", "valve", "model", "build"])
def test_another_origin_is_refused(path, name):
    with pytest.raises(StoreError, match=f"it is of another {name}"):
        load(path, {**ORIGIN, name: "x"}, CONFIG)


def test_searches_by_other_rules_are_not_taken_over(path):
    same = load(path, ORIGIN, CONFIG)
    other = load(path, ORIGIN, AgingConfig(max_candidates=21))
    assert same is not None
    assert other is not None
    assert len(same.memory._stored) == 1
    assert not other.memory._stored


def test_a_full_disk_leaves_nothing_behind(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(OSError, match="No space"):
        write(tmp_path / "known", b"x")
    assert not list(tmp_path.iterdir())


def test_threads_that_write_the_same_file_spoil_nothing(tmp_path, known):
    content = packed(known)
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda _: write(tmp_path / "known", content), range(200)))
    assert load(tmp_path / "known", ORIGIN, CONFIG) is not None
    assert [p.name for p in tmp_path.iterdir()] == ["known"]
