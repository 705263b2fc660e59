# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What reads a file in a process of its own may die, hang and print there."""

import os
import signal
import sys
from functools import partial

import numpy as np
import pytest

from valve_twin.io import apart
from valve_twin.io.apart import run_apart
from valve_twin.io.errors import BagError, ConfigError

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere it reads here")


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "a.bin"
    file.write_bytes(b"x" * 100)
    return file


def raises(error):
    raise error


def endless():
    while True:
        pass


def test_what_is_read_comes_as_it_is(path):
    def read():
        return path, {"a": np.arange(6.0).reshape(2, 3)}, np.empty(0), [np.arange(3)] * 2

    where, named, nothing, twice = run_apart(path, read)
    assert where == path
    assert np.array_equal(named["a"], [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]])
    assert (nothing.shape, nothing.dtype) == ((0,), np.float64)
    assert twice[0].tolist() == twice[1].tolist() == [0, 1, 2]
    named["a"][0, 0] = 7.0  # it is our own


def test_it_is_read_elsewhere_and_nobody_is_left(path):
    child = run_apart(path, os.getpid)
    assert child != os.getpid()
    with pytest.raises(ChildProcessError):
        os.waitpid(child, os.WNOHANG)


@pytest.mark.parametrize("kind", [BagError, ConfigError])
def test_an_error_of_ours_comes_as_it_was_raised(path, kind):
    with pytest.raises(kind, match=r"^line 3: wrong$"):
        run_apart(path, partial(raises, kind("line 3: wrong")))


def test_any_other_is_one_line(path):
    with pytest.raises(BagError, match=r"a.bin: cannot be read \(KeyError: 'x'\); save it anew"):
        run_apart(path, partial(raises, KeyError("x")))


def test_what_cannot_travel_is_one_line(path):
    with pytest.raises(BagError, match=r"a.bin: cannot be read"):
        run_apart(path, lambda: lambda: None)


@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGABRT, signal.SIGKILL])
def test_a_reader_that_dies_is_one_line(path, number):
    with pytest.raises(BagError, match=rf"is broken: its reader died of it \({number.name}\)"):
        run_apart(path, lambda: os.kill(os.getpid(), number))


def test_a_reader_that_leaves_is_one_line(path):
    with pytest.raises(BagError, match=r"its reader died of it \(exit code 3\)"):
        run_apart(path, lambda: os._exit(3))


def test_a_reader_without_an_end_is_one_line(path, monkeypatch):
    monkeypatch.setattr(apart, "LEAST_S", 0.5)
    with pytest.raises(BagError, match=r"its reader comes to no end within 1 s"):
        run_apart(path, endless)


def test_a_folder_may_take_as_long_as_its_files(tmp_path, monkeypatch):
    monkeypatch.setattr(apart, "LEAST_S", 0.0)
    monkeypatch.setattr(apart, "EACH_MEGABYTE_S", 1.0)
    for name in ("a.db3", "b.db3"):
        (tmp_path / name).write_bytes(bytes(2 << 19))
    with pytest.raises(BagError, match=r"its reader comes to no end within 2 s"):
        run_apart(tmp_path, endless)


def test_what_it_prints_is_lost(path, capfd):
    def read():
        os.write(1, b"a dump of blocks")
        sys.stderr.write("and more")
        sys.stderr.flush()
        return 1

    assert run_apart(path, read) == 1
    assert capfd.readouterr() == ("", "")


def test_who_is_interrupted_leaves_no_reader(path, monkeypatch):
    def interrupted(_):
        raise KeyboardInterrupt

    children, fork = [], os.fork

    def noted():
        children.append(fork())
        return children[-1]

    monkeypatch.setattr(os, "fork", noted)
    monkeypatch.setattr(apart, "_receive", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_apart(path, endless)
    with pytest.raises(ChildProcessError):
        os.waitpid(children[0], os.WNOHANG)
