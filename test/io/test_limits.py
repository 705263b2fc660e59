# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import gzip
import io
import json
import struct
import subprocess
import sys
import time
import zlib
from pathlib import Path

import lz4.frame
import pytest
import yaml
import zstandard
from mcap.records import Schema

from test import peak
from test.io import foreign_designs, foreign_estimates, foreign_lies, foreign_verbs
from test.io.foreign import INSTRUMENTS, SUBJECTS, campaign, imported
from valve_twin.io.bags.folder import find_files
from valve_twin.io.cdr.bag_types import BagTypes
from valve_twin.io.config.parameter_file import read_parameter_file
from valve_twin.io.errors import BagError, ConfigError
from valve_twin.io.limits import VARIABLE, load_yaml, no_formula, unpack_gzip, unpack_limit
from valve_twin.io.tables.csv import read_table

LAUGHS = "a0: &a0 [x, x, x]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 10)
)
HOSTILE = {
    "brackets": "[" * 50_000,
    "braces": "{" * 50_000,
    "dashes": "- " * 50_000,
    "laughs": LAUGHS,
    "itself": "a: &a [*a]",
    "number": "a: " + "1" * 5000,
    "date": "a: 2026-99-99",
    "timestamp": "a: !!timestamp x",
    "binary": "a: !!binary x=",
    "object": "a: !!python/object/apply:os.system [ls]",
    "list as key": "{[a]: 1}",
}


@pytest.mark.parametrize("what", HOSTILE)
def test_a_hostile_yaml_is_refused_at_once_wherever_it_is_read(what, tmp_path):
    text = HOSTILE[what]
    begin = time.process_time()
    with pytest.raises(yaml.YAMLError):
        load_yaml(text)
    (tmp_path / "metadata.yaml").write_text(text)
    with pytest.raises(BagError, match="metadata"):
        find_files(tmp_path)
    if what != "list as key":
        path = tmp_path / "valve.yaml"
        path.write_text("/**:\n  ros__parameters:\n    " + text.replace("\n", "\n    "))
        with pytest.raises(ConfigError, match="valid YAML"):
            read_parameter_file(path)
    assert time.process_time() - begin < 2.0


def test_what_people_write_is_read():
    text = "base: &base {a: 1, b: [1, 2]}\nother: {<<: *base, b: [[[1]]]}\n"
    assert load_yaml(text)["other"] == {"a": 1, "b": [[[1]]]}


@pytest.mark.parametrize(
    "text",
    [
        "uint8[4000000000] data",
        "B[4000000000] data\n" + "=" * 80 + "\nMSG: a/B\nuint8 x",
        "A a",
        "B[] b\n" + "=" * 80 + "\nMSG: a/B\nA[] a",
        "B[1000] b\n"
        + "=" * 80
        + "\nMSG: a/B\nC[1000] c\n"
        + "=" * 80
        + "\nMSG: a/C\nuint8[1000] d",
    ],
)
def test_a_definition_without_bounds_is_refused(text):
    with pytest.raises(BagError, match="no readable definition"):
        BagTypes(Schema(1, text.encode(), "ros2msg", "a/msg/A"), "here")


def test_a_sequence_that_claims_more_than_there_is_is_refused():
    types = BagTypes(Schema(1, b"string[] b", "ros2msg", "a/msg/A"), "here")
    with pytest.raises(BagError, match="log time 7 ns"):
        types.decode(b"\0\1\0\0" + struct.pack("<I", 4_000_000_000) + bytes(64), 7)


def test_a_packed_table_may_not_unpack_without_end(tmp_path):
    bomb = gzip.compress(bytes(300 << 20), 9)
    with pytest.raises(OSError, match=r"MB"):
        unpack_gzip(bomb)
    path = tmp_path / "a.csv.gz"
    path.write_bytes(bomb)
    with pytest.raises(BagError, match=VARIABLE + "|no measurement"):
        read_table(path, ["0"])


@pytest.mark.parametrize("text", ["=1+1", "+cmd", "-x", "@a", " =1", "\t=1", "\r=1"])
def test_no_text_leaves_as_a_formula(text):
    assert no_formula(text) == f"'{text}"


@pytest.mark.parametrize("cell", ["seal", "", "a=1", -1.5, None, 3])
def test_any_other_cell_leaves_as_it_is(cell):
    assert no_formula(cell) == cell


def test_the_limit_can_be_set(monkeypatch):
    monkeypatch.setenv(VARIABLE, "7")
    assert unpack_limit() == 7 << 20
    monkeypatch.setenv(VARIABLE, "many")
    assert unpack_limit() == 256 << 20


def chunk_file(packed, compression, size, crc):
    """Return a file of one chunk without a summary."""
    name = compression.encode()
    head = (
        struct.pack("<QQQII", 1, 2, size, crc, len(name)) + name + struct.pack("<Q", len(packed))
    )
    magic = b"\x89MCAP0\r\n"
    header = struct.pack("<BQ", 1, 8) + bytes(8)
    chunk = struct.pack("<BQ", 6, len(head) + len(packed)) + head + packed
    end = struct.pack("<BQI", 15, 4, 0) + struct.pack("<BQQQI", 2, 20, 0, 0, 0)
    return magic + header + chunk + end + magic


def zeros(compression, size, *, sized):
    """Return so many zeros, packed piece by piece; with the size in the frame's head or not."""
    piece = bytes(1 << 20)
    if compression == "lz4":
        packer = lz4.frame.LZ4FrameCompressor()
        out = io.BytesIO()
        out.write(packer.begin(size if sized else 0))
        for _ in range(size >> 20):
            out.write(packer.compress(piece))
        out.write(packer.flush())
        return out.getvalue()
    made = zstandard.ZstdCompressor().compressobj(size=size if sized else -1)
    return b"".join(made.compress(piece) for _ in range(size >> 20)) + made.flush()


def crc_of_zeros(size):
    crc = 0
    for _ in range(size >> 20):
        crc = zlib.crc32(bytes(1 << 20), crc)
    return crc


WATCHED = f"""{Path(peak.__file__).read_text(encoding="utf-8")}
import json, sys
from valve_twin.cli.main import main
code = main(sys.argv[1:])
print(json.dumps({{"code": code, "mb": peak_mb()}}))
"""


@pytest.mark.parametrize("claim", ["true", "small", "huge"])
@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_bomb_in_a_chunk_is_told_and_takes_no_memory(compression, claim, tmp_path):
    size = 2 << 30
    packed = zeros(compression, size, sized=claim == "true")
    stated = {"true": size, "small": 1 << 20, "huge": 1 << 60}[claim]
    path = tmp_path / "bomb.mcap"
    path.write_bytes(chunk_file(packed, compression, stated, 0 if claim != "true" else 1))
    for more in ([], ["--verify"]):
        begin = time.monotonic()
        done = subprocess.run(
            [sys.executable, "-c", WATCHED, "info", str(path), *more],
            capture_output=True,
            text=True,
            check=False,
        )
        assert time.monotonic() - begin < 60
        assert "Traceback" not in done.stderr
        found = json.loads(done.stdout.splitlines()[-1])
        assert found["code"] == 1
        assert found["mb"] < 1000, found
        assert str(path) in done.stdout + done.stderr


def hold(kind, folder, seed, count):
    """Run a campaign of mutations and hold it to what is promised."""
    tally = campaign(SUBJECTS[kind](folder), folder, seed, count)
    assert tally.cases == count
    assert not tally.tracebacks, tally.tracebacks[:5]
    assert not tally.silent, tally.silent[:5]
    assert not tally.slow, tally.slow[:5]
    assert tally.grown_mb < 1000.0
    assert tally.refused + tally.told > 0
    own = OWN.get(kind) or f"a{INSTRUMENTS[kind]}"
    assert {p.name for p in folder.iterdir()} <= {"made", "meta", own}


OWN = {
    "bag": "a.mcap",
    "metadata": "meta",
    "configuration": "valve.yaml",
    "table": "a.csv",
    "messages": "a.cdr",
    "history": "a.sqlite",
    "sqlite": "sqlite",
}


@pytest.mark.parametrize("kind", SUBJECTS)
def test_no_mutation_of_a_file_ends_in_a_trace_or_is_read_wrong_silently(kind, tmp_path):
    hold(kind, tmp_path, 1, 40 if kind in {*INSTRUMENTS, "sqlite"} else 150)


@pytest.mark.parametrize("kind", ["tdms", "mat5"])
def test_an_import_tells_what_the_reader_tells(kind, tmp_path):
    assert imported(kind, tmp_path, 3, 8) == []


@pytest.mark.slow
@pytest.mark.parametrize("part", range(5))
@pytest.mark.parametrize("kind", INSTRUMENTS)
def test_five_hundred_imports_do(kind, part, tmp_path):
    assert imported(kind, tmp_path, 200 + part, 100) == []


def test_every_verb_tells_what_a_mutated_bag_lacks(tmp_path):
    assert foreign_verbs.of_bags(tmp_path, 3, 16) == []


@pytest.mark.parametrize("kind", [foreign_lies.of_files, foreign_lies.of_folders])
def test_every_verb_tells_what_a_consistent_lie_hides(kind, tmp_path):
    assert kind(tmp_path, 4, 12) == []


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("part", range(10))
def test_each_of_ten_thousand_lies_is_told_or_loses_nothing(part, tmp_path):
    (tmp_path / "files").mkdir()
    (tmp_path / "folders").mkdir()
    assert foreign_lies.of_files(tmp_path / "files", 400, 800, 800 * part) == []
    assert foreign_lies.of_folders(tmp_path / "folders", 401, 200, 200 * part) == []


def test_a_mutated_bag_is_played_as_the_sound_one_or_named(tmp_path):
    assert foreign_verbs.of_players(tmp_path, 3, 20) == []


@pytest.mark.slow
@pytest.mark.parametrize("part", range(5))
def test_each_of_five_thousand_is(part, tmp_path):
    assert foreign_verbs.of_players(tmp_path, 200 + part, 1000) == []


@pytest.mark.parametrize("kind", ["text", "tdms"])
def test_configure_tells_what_the_reader_tells(kind, tmp_path):
    assert foreign_verbs.of_configure(kind, tmp_path, 3, 3) == []


ESTIMATES = {
    "bags": foreign_estimates.of_bags,
    "histories": foreign_estimates.of_histories,
    "pages": foreign_estimates.of_pages,
    "archives": foreign_estimates.of_archives,
    "configurations": foreign_estimates.of_configurations,
}


@pytest.mark.parametrize("of", ESTIMATES)
def test_what_estimates_mutated_files_gives_what_the_sound_ones_give_or_names_them(of, tmp_path):
    assert ESTIMATES[of](tmp_path, 3, 4) == []


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
@pytest.mark.parametrize("of", ESTIMATES)
def test_what_estimates_five_hundred_does(of, part, tmp_path):
    assert ESTIMATES[of](tmp_path, 200 + part, 50) == []


@pytest.mark.parametrize("kind", foreign_designs.KINDS)
def test_a_mutated_design_is_what_its_texts_say_or_refused(kind, tmp_path):
    assert foreign_designs.of_designs(kind, tmp_path, 3, 30) == []


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
@pytest.mark.parametrize("kind", foreign_designs.KINDS)
def test_each_of_ten_thousand_designs_is(kind, part, tmp_path):
    assert foreign_designs.of_designs(kind, tmp_path, 200 + part, 1000) == []


@pytest.mark.slow
@pytest.mark.parametrize("part", range(5))
def test_every_verb_tells_it_of_two_thousand(part, tmp_path):
    assert foreign_verbs.of_bags(tmp_path, 200 + part, 400) == []


@pytest.mark.slow
@pytest.mark.parametrize("part", range(5))
@pytest.mark.parametrize("kind", INSTRUMENTS)
def test_configure_tells_it_of_five_hundred(kind, part, tmp_path):
    assert foreign_verbs.of_configure(kind, tmp_path, 200 + part, 100) == []


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
@pytest.mark.parametrize("kind", SUBJECTS)
def test_none_of_ten_thousand_mutations_does(kind, part, tmp_path):
    hold(kind, tmp_path, 100 + part, 1000)


@pytest.mark.skipif(sys.platform != "linux", reason="memory is bounded on Linux")
def test_what_takes_more_memory_than_it_is_given_gets_none():
    code = """
from valve_twin.io.limits import bounded_memory
with bounded_memory(50_000_000):
    some = bytearray(20_000_000)
    try:
        more = bytearray(100_000_000)
    except MemoryError:
        print("none")
more = bytearray(100_000_000)
"""
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "none\n"
