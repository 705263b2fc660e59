# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A valve's own past is a reference once it is long and its first cycles are like those since."""

from itertools import pairwise

import numpy as np
import pytest

from valve_twin.core.diagnosis import reference
from valve_twin.core.diagnosis.changes.jumps import BEYOND
from valve_twin.core.diagnosis.config import DetectionConfig
from valve_twin.core.diagnosis.detection import detect
from valve_twin.core.diagnosis.lines import filled, rays_of_steps
from valve_twin.core.diagnosis.reference import doubt_of, doubt_of_noise, doubt_of_step
from valve_twin.core.valves.press_cartridge import MODEL

TABLE = MODEL.signatures()
SETTLED = DetectionConfig().settled


def healthy(cycles, seed):
    """Return features that scatter as those of the table about a slow drift."""
    rng = np.random.default_rng(seed)
    scatter = rng.multivariate_normal(np.zeros(len(TABLE.features)), TABLE.covariance, cycles)
    aging = np.sqrt(np.diag(TABLE.covariance)) * np.linspace(0.0, 3.0, cycles)[:, None]
    return scatter + aging


def doubt(vectors):
    return doubt_of(np.arange(1, len(vectors) + 1), vectors, TABLE)


def test_few_cycles_are_no_reference():
    vectors = healthy(SETTLED, 1)
    told = doubt(vectors[:-1])
    assert told.startswith(f"no reference yet: {SETTLED - 1} of {SETTLED} cycles")
    assert doubt(vectors) == ""


def test_cycles_that_show_no_feature_do_not_count():
    vectors = healthy(2 * SETTLED, 1)
    vectors[::2] = np.nan
    vectors[1] = np.nan
    assert doubt(vectors).startswith(f"no reference yet: {SETTLED - 1} of {SETTLED} cycles")


@pytest.mark.no_cover
def test_a_steady_past_is_one_in_all_but_few_of_200_histories():
    assert sum(bool(doubt(healthy(60, seed))) for seed in range(200)) <= 2


@pytest.mark.parametrize("name", ["leak", "supply_drop", "sensor_offset"])
def test_a_fault_that_began_in_the_first_cycles_leaves_none(name):
    change = np.array(next(s.change for s in reversed(TABLE.signatures) if s.fault == name))
    found = 0
    for seed in range(20):
        vectors = healthy(60, seed)
        vectors[4:] += change
        told = doubt(vectors)
        found += told.startswith("no reference: cycles 1 to 4 differ")
        assert doubt(vectors[:30]) in ("", told)  # what is found once is found in longer ones
    assert found >= 18


def test_a_fault_that_began_later_is_no_doubt_about_the_first_cycles():
    change = np.array(next(s.change for s in reversed(TABLE.signatures) if s.fault == "leak"))
    vectors = healthy(60, 3)
    vectors[40:] += change
    assert doubt(vectors) == ""


def change_of(name, which):
    """Return the change by a fault: of its sizes 0 = small, 1 = medium, 2 = large."""
    return np.array([s.change for s in TABLE.signatures if s.fault == name][which])


def early(vectors, others=()):
    return doubt_of(np.arange(1, len(vectors) + 1), vectors, TABLE, others=list(others))


def test_few_steady_cycles_are_a_reference_and_nine_are_not():
    told = [early(healthy(60, seed)[:12]) for seed in range(40)]
    assert sum(not t for t in told) >= 36
    assert early(healthy(60, 1)[:9]).startswith("no reference yet: 9 of 20 cycles")


@pytest.mark.parametrize("since", [3, 7])
@pytest.mark.parametrize("name", ["leak", "stiction", "supply_drop", "sensor_offset"])
def test_few_cycles_with_a_step_are_none(name, since):
    withheld = 0
    for seed in range(10):
        vectors = healthy(60, seed)[:12]
        vectors[since:] += change_of(name, 1)
        withheld += early(vectors).startswith("no reference yet: 12 of 20 cycles")
    assert withheld == 10


@pytest.mark.parametrize("name", ["leak", "weak_outflow", "aeration"])
def test_a_step_back_along_a_fault_of_one_direction_is_no_doubt(name):
    """It is no fault that begins: a leak does not close by itself."""
    given = 0
    for seed in range(6):
        vectors = healthy(60, seed)[:14]
        vectors[3:] -= change_of(name, 1)
        given += not early(vectors)
    assert given >= 5


@pytest.mark.no_cover
def test_a_reference_once_given_is_seldom_withdrawn():
    """A verdict that comes and goes is believed by nobody."""
    withdrawn = 0
    for seed in range(20):
        vectors = healthy(60, seed)
        given = [not early(vectors[:count]) for count in range(10, 20)]
        withdrawn += any(a and not b for a, b in pairwise(given))
    assert withdrawn == 0


def test_a_noisier_sensor_of_the_first_cycles_leaves_no_reference():
    noise = 1e-3 * np.exp(0.1 * np.random.default_rng(4).standard_normal(20))
    assert doubt_of_noise(np.arange(1, 21), noise) == ""
    noise[3:] *= 4.0
    told = doubt_of_noise(np.arange(1, 21), noise)
    assert told.startswith("no reference: cycles 1 to 3 differ from those since")


@pytest.mark.parametrize("mended", [11, 20])
def test_a_sensor_that_is_mended_gives_no_reference_back(mended):
    noise = 1e-3 * np.exp(0.1 * np.random.default_rng(4).standard_normal(60))
    noise[3:mended] *= 4.0
    told = {doubt_of_noise(np.arange(1, n + 1), noise[:n]) for n in range(mended, 61)}
    assert len(told) == 1
    assert told.pop().startswith("no reference: cycles 1 to 3 differ from those since")


def test_a_further_product_needs_fewer_cycles():
    known = healthy(60, 2)[:SETTLED]
    vectors = healthy(60, 7)[:8] + 5.0
    assert early(vectors).startswith("no reference yet: 8 of 20 cycles")
    assert early(vectors, [known]) == ""
    vectors[4:] += change_of("supply_drop", 1)
    assert early(vectors, [known]).startswith("no reference yet: 8 of 20 cycles")


def test_cycles_that_show_nothing_are_none():
    assert early(np.full((12, len(TABLE.features)), np.nan)) != ""


def step_told(vectors, rows=None, *, left=-1):
    return doubt_of_step(np.arange(1, len(vectors) + 1), vectors, TABLE, rows=rows, left=left)


def noisier(cycles, seed):
    """Return features of a valve that scatters three times as much as that of the table."""
    vectors = healthy(cycles, seed)
    return vectors + 2.0 * (vectors - vectors.mean(axis=0))


@pytest.mark.parametrize("name", ["dead_band", "command_offset", "preload"])
def test_a_step_that_few_cycles_do_not_show_is_told_by_all_of_them(name):
    """Few cycles show only one half as large again: their scatter counts wider."""
    told = alarms = 0
    for seed in range(10):
        vectors = noisier(44, seed)
        vectors[12:] += 2.0 * change_of(name, 1)
        alarms += bool(detect(np.arange(1, 45), vectors, TABLE).findings)
        why = step_told(vectors)
        told += why.startswith(("no reference: cycles 1 to 12", "no reference: cycles 1 to 13"))
        assert step_told(vectors[:30]) in ("", why)  # what is told once is told in longer ones
    assert told >= 9
    assert alarms <= 2


def test_fewer_cycles_tell_a_step_of_a_product_that_is_not_made_any_more():
    """Four cycles with it came before the product changed, and it stayed (seed 98247)."""
    vectors = healthy(17, 3)
    assert step_told(vectors[:15], left=15) == ""
    vectors[11:] += 2.0 * change_of("command_offset", 1)
    assert step_told(vectors[:15]) == ""
    told = step_told(vectors[:15], left=15)
    assert told.startswith("no reference: cycles 1 to 11 differ")
    assert step_told(vectors, left=15) == told  # also when the product is made again


@pytest.mark.no_cover
def test_sound_valves_hold_no_step_in_all_but_few_of_20_histories():
    assert sum(bool(step_told(healthy(48, seed))) for seed in range(20)) <= 1


@pytest.mark.no_cover
def test_aging_is_no_step():
    along = np.linspace(0.0, 1.0, 48)[:, None]
    change = change_of("coil_resistance", 2)
    for law in (along, along**3, 1.0 - (1.0 - along) ** 3):
        assert sum(bool(step_told(healthy(48, seed) + law * change)) for seed in range(8)) <= 1


@pytest.mark.no_cover
def test_what_steps_to_and_fro_holds_no_single_step():
    turns = (np.arange(48) // 7 % 2)[:, None] * change_of("sensor_offset", 1)
    assert not any(step_told(healthy(48, seed) + turns) for seed in range(8))


def test_what_changed_while_a_fault_was_found_is_no_step_of_one_cycle():
    vectors = healthy(48, 5)
    vectors[28:] += change_of("sensor_offset", 1)
    assert step_told(vectors).startswith(
        ("no reference: cycles 1 to 27", "no reference: cycles 1 to 28")
    )
    assert step_told(vectors, np.r_[0:21, 28:48]) == ""


def plainly_stepped(vectors, apart):
    """Return what `_stepped` does, step by step and signature by signature."""
    rays = rays_of_steps([vectors], TABLE, DetectionConfig())
    shown = rays.along(rays.whitened(filled(vectors, DetectionConfig().least)))
    count, best = len(shown), (reference._STEP_ALONE, 0)
    time = np.arange(count) / count
    jumps = {
        k: np.median(shown[k : k + 3], axis=0) - np.median(shown[k - 3 : k], axis=0)
        for k in range(3, count - 2)
    }
    for k in jumps:
        if any(abs(k - row) < 3 for row in apart):
            continue
        for s, along in enumerate(shown.T):
            gap = along[k:].mean() - along[:k].mean()
            jump, way = jumps[k][s] * np.sign(gap), np.sign(gap)
            others = [abs(jumps[j][s]) for j in jumps if abs(j - k) >= 3]
            if jump <= max(reference._SUDDEN * abs(gap), BEYOND * max(others)):
                continue
            off = []
            for degree in (1, 2):
                step = (np.arange(count) >= k) - np.polyval(
                    np.polyfit(time, np.arange(count) >= k, degree), time
                )
                off.append(way * float(step @ along) / np.linalg.norm(step))
            both = off[0] > reference._OFF_AGING[0] and off[1] > reference._OFF_AGING[1]
            far = abs(gap) * (k * (count - k) / count) ** 0.5
            if (off[1] > reference._OFF_BENT or both) and far > best[0]:
                best = far, k
    return best[1]


@pytest.mark.parametrize(
    "seed", [*range(4), *(pytest.param(n, marks=pytest.mark.no_cover) for n in range(4, 24))]
)
def test_all_steps_at_a_time_are_those_one_by_one(seed):
    vectors = healthy(14 + 3 * seed % 35, seed)
    name = ("sensor_offset", "leak", "preload", "dead_band")[seed % 4]
    vectors[7 + seed % 5 :] += (seed % 3) * change_of(name, 1)
    apart = (seed,) if seed % 2 else ()
    found = reference._stepped(vectors, TABLE, DetectionConfig(), apart)
    assert found == plainly_stepped(vectors, apart)


def test_some_of_these_hold_a_step():
    vectors = healthy(30, 2)
    vectors[9:] += 2.0 * change_of("preload", 1)
    assert reference._stepped(vectors, TABLE, DetectionConfig(), ()) == 9
    assert plainly_stepped(vectors, ()) == 9
    assert (
        reference._stepped(vectors, TABLE, DetectionConfig(), (10,))
        == plainly_stepped(vectors, (10,))
        != 9
    )
