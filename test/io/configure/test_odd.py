# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from __future__ import annotations

import math

import numpy as np
import pytest

from test.io.configure.test_survey import slew_valve, steps, survey
from valve_twin.core.survey.choose import Pair
from valve_twin.io.configure.channels import look
from valve_twin.io.configure.odd import odd_files, without
from valve_twin.io.errors import ConfigError
from valve_twin.io.instruments.clock import ClockChoice
from valve_twin.io.instruments.into_bag import _left_out


def files(folder, spoil, count=4):
    """Write recordings of one valve; the second one is spoilt."""
    paths = []
    for k in range(count):
        command = steps(seed=k + 2)
        position = slew_valve(command, seed=k + 1)
        rows = slice(None) if k else slice(900)  # not all are of one length
        columns = {"cmd": command[rows], "pos": (spoil(position) if k == 1 else position)[rows]}
        paths.append(folder / f"run_{k}.csv")
        survey(paths[-1], columns)
    return paths


def odd(paths):
    found = look(paths, ClockChoice())
    return odd_files(found, [Pair("cmd", "pos", 4, 0.9, math.nan, math.nan, named=True)])


SPOILT = {
    "upside down": lambda y: 45.0 - y,
    "of another run": lambda y: np.roll(y, 175),
    "noise": lambda y: np.random.default_rng(3).normal(20.0, 9.0, len(y)),
}


@pytest.mark.parametrize("kind", SPOILT)
def test_a_file_that_follows_unlike_the_others_is_named(tmp_path, kind):
    paths = files(tmp_path, SPOILT[kind])
    found = odd(paths)
    assert list(found) == [paths[1]]
    assert "'pos' follows 'cmd' unlike in the other files" in found[paths[1]]
    rest = without(found, look([p for p in paths if p not in found], ClockChoice()))
    assert rest.left_out == ("run_1.csv",)
    assert str(paths[1]) in rest.refused[0]


def test_of_two_files_of_one_name_only_the_odd_one_is_left_out(tmp_path):
    paths = [tmp_path / f"day_{k}" / "run.csv" for k in range(4)]
    for old, path in zip(files(tmp_path, SPOILT["upside down"]), paths, strict=True):
        path.parent.mkdir()
        old.rename(path)
    found = odd(paths)
    rest = without(found, look([p for p in paths if p not in found], ClockChoice()))
    assert rest.left_out == ("day_1/run.csv",)
    assert _left_out(paths, rest.left_out) == {paths[1]}
    with pytest.raises(ConfigError, match=r"'run.csv' names .*day_0/run.csv and .*day_1/run.csv"):
        _left_out(paths, ["run.csv"])
    with pytest.raises(ConfigError, match="names every file given"):
        _left_out(paths[1:2], rest.left_out)


def test_other_steps_and_a_slower_valve_are_not_odd(tmp_path):
    assert odd(files(tmp_path, lambda y: y)) == {}
    assert odd(files(tmp_path, lambda y: 0.9 * y + 1.0)) == {}


def test_of_two_files_none_is_the_odd_one(tmp_path):
    assert odd(files(tmp_path, SPOILT["noise"], count=2)) == {}
