# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Maps as files."""

from __future__ import annotations

import zipfile

import numpy as np
import pytest

from valve_twin.core.physics.coenergy import CoenergyMap, spline_coefficients
from valve_twin.design.map import read_map, write_map

NODES = np.linspace(0.0, 1.0, 4)


def a_map():
    values = np.random.default_rng(0).normal(size=(8, 8))
    made = spline_coefficients(values, (NODES, NODES))
    return CoenergyMap(("A",), NODES, NODES, made, {"name": "x", "unknowns": 7})


def test_a_map_comes_back_to_the_last_bit_and_its_file_is_always_the_same(tmp_path):
    paths = [tmp_path / name for name in ("one.npz", "two.npz")]
    for path in paths:
        write_map(a_map(), path)
    found = read_map(paths[0])
    assert (found.coefficients == a_map().coefficients).all()
    assert (found.coils, dict(found.provenance)) == (("A",), {"name": "x", "unknowns": 7})
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_what_is_no_map_is_refused_with_its_name(tmp_path):
    path = tmp_path / "m.npz"
    with pytest.raises(ValueError, match=r"m.npz: is no map"):
        read_map(path)
    path.write_bytes(b"PK\x03\x04 broken")
    with pytest.raises(ValueError, match=r"m.npz: is no map"):
        read_map(path)
    np.savez(path, form=np.array(9))
    with pytest.raises(ValueError, match="is a map of form 9: this version reads form 1"):
        read_map(path)
    np.savez(path, form=np.array(1))
    with pytest.raises(ValueError, match="is no map"):
        read_map(path)


def test_no_file_is_told_to_be_loaded_unsafely(tmp_path):
    path = tmp_path / "README.md"
    path.write_text("# no map\n", encoding="utf-8")
    with pytest.raises(
        ValueError, match=r"is no map of .* \(its bytes are no archive npz of"
    ) as of:
        read_map(path)
    assert "pickle" not in str(of.value)
    np.savez(tmp_path / "o.npz", form=np.array([{}], dtype=object))
    with pytest.raises(ValueError, match=r"\(it holds objects of a program, which are") as of:
        read_map(tmp_path / "o.npz")
    assert "trust" not in str(of.value)


def test_a_map_that_unpacks_to_much_or_claims_to_is_refused(tmp_path):
    path = tmp_path / "map.npz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file,
        file.open("form.npy", "w") as out,
    ):
        for _ in range(300):
            out.write(bytes(1 << 20))
    with pytest.raises(ValueError, match="unpacks to more than 256 MB"):
        read_map(path)
    with zipfile.ZipFile(path, "w") as file, file.open("form.npy", "w") as out:
        shape = {"descr": "<f8", "fortran_order": False, "shape": (1 << 50,)}
        np.lib.format.write_array_header_1_0(out, shape)
    with pytest.raises(ValueError, match="is no map"):
        read_map(path)
    np.save(tmp_path / "map.npy", NODES)
    with pytest.raises(ValueError, match="is no map"):
        read_map(tmp_path / "map.npy")
