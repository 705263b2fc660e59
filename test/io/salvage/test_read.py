# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A bag cut at any byte, or with any byte flipped, yields every message of every intact chunk."""

import json
import zlib

import numpy as np
import pytest

from test.io.salvage.damage_truth import Region, Tally, judge_cut, judge_flip, salvaged, written
from valve_twin.io.mcap.format import Op
from valve_twin.io.salvage.read import salvage_file

KINDS = [
    "ours",
    "zstd-crc-2000",
    "zstd-nocrc-2000",
    "zstd-crc-400000",
    "lz4-crc-2000",
    "lz4-nocrc-2000",
    "lz4-crc-200000",
    "none-crc-2000",
    "none-nocrc-2000",
    "loose-crc-0",
    "loose-nocrc-0",
]
COUNTS = {"zstd-crc-400000": 1800, "lz4-crc-200000": 1200}
CASES = 100
"""Cuts and flips of each kind of file: 1100 of both in all."""


def sample(kind, tmp_path):
    rng = np.random.default_rng(zlib.crc32(kind.encode()))
    truth = written(kind, rng, tmp_path, COUNTS.get(kind, 120))
    path = tmp_path / "bag" / "bag_0.mcap" if kind == "ours" else tmp_path / "damaged.mcap"
    return truth, path, rng


def every_region(truth):
    """Return one byte of the begin, the middle and the end of a record of each kind."""
    seen: dict[int, Region] = {}
    for region in truth.regions:
        seen.setdefault(region.op, region)
    places = [0, 7, len(truth.data) - 1, len(truth.data) - 9]
    for region in seen.values():
        size = region.end - region.begin
        places += [region.begin + n for n in (0, 1, 5, 9, 13, 37, 41, 45, size // 2) if n < size]
        places.append(region.end - 1)
    return places


@pytest.mark.parametrize("kind", KINDS)
def test_a_byte_flipped_in_any_kind_of_record_costs_no_other(kind, tmp_path):
    truth, path, rng = sample(kind, tmp_path)
    for place in every_region(truth):
        judge_flip(truth, path, place, int(rng.integers(1, 256)))


def test_a_cut_file_with_a_wrong_byte_in_a_record_beside_its_chunks_gives_all(tmp_path):
    truth, path, _ = sample("ours", tmp_path)
    beside = [r for r in truth.regions if r.op in {Op.HEADER, Op.METADATA}]
    places = [n for r in beside for n in range(r.begin + 9, min(r.end, r.begin + 60))]
    assert {r.end <= truth.data_end for r in beside} == {True}
    assert len(beside) == 2
    for place in places:
        content = bytearray(truth.data[: truth.data_end + 5])
        content[place] = 0xFF
        path.write_bytes(content)
        counted = salvage_file(path).summary.statistics
        assert counted is not None
        assert counted.message_count == truth.messages.total()


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_cut_in_any_kind_of_record_gives_all_before(kind, tmp_path):
    truth, path, _ = sample(kind, tmp_path)
    for place in every_region(truth):
        if place:
            judge_cut(truth, path, place)


@pytest.mark.slow
def test_campaign_of_random_cuts_and_flips(tmp_path, root):
    """Write what 1100 random cuts and 1100 random flips gave to docs/campaigns."""
    results = {}
    for kind in KINDS:
        folder = tmp_path / kind
        folder.mkdir()
        truth, path, rng = sample(kind, folder)
        cuts, flips = Tally(), Tally()
        for size in rng.integers(1, len(truth.data), CASES).tolist():
            cuts.add(judge_cut(truth, path, size))
        for place in rng.integers(0, len(truth.data), CASES).tolist():
            flips.add(judge_flip(truth, path, place, int(rng.integers(1, 256))))
        results[kind] = {
            "bytes": len(truth.data),
            "messages": truth.messages.total(),
            "cuts": {n: getattr(cuts, n) for n in cuts.__dataclass_fields__},
            "flips": {n: getattr(flips, n) for n in flips.__dataclass_fields__},
        }
    parts = [r[way] for r in results.values() for way in ("cuts", "flips")]
    total = {name: sum(p[name] for p in parts) for name in Tally.__dataclass_fields__}
    total["share_of_intact_found"] = total["intact_found"] / total["intact"]
    assert total["share_of_intact_found"] == 1.0
    assert not total["wrong_checked"] + total["wrong_unchecked_unmarked"] + total["false_counts"]
    text = json.dumps({"total": total, "kinds": results}, indent=1)
    (root / "docs" / "campaigns" / "damage.json").write_text(f"{text}\n", encoding="utf-8")


@pytest.mark.parametrize("beside", [False, True])
def test_a_lost_definition_is_taken_from_another_file_or_told(tmp_path, beside):
    truth, _, _ = sample("zstd-crc-2000", tmp_path)
    first, second = [r for r in truth.regions if r.op == 6][:2]
    data = bytearray(truth.data[: truth.data_end])
    for region in (first, second):  # the definitions stand in the first chunks and the summary
        data[region.end - 20] ^= 0xFF
    path = tmp_path / "bag_0.mcap"
    if beside:
        (tmp_path / "bag_1.mcap").write_bytes(truth.data)
    found, messages = salvaged(path, bytes(data))
    later = [m for r in truth.regions if r.op == 6 for m in r.messages if r.begin > second.begin]
    if beside:
        assert [m for m, _ in messages] == later
        assert any("of another file of the bag" in loss.reason for loss in found.losses)
    else:
        assert not messages
        told = [loss.count for loss in found.losses if "no definition is left" in loss.reason]
        assert told == [len(later)]
