# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The verbs info, recover, cut and convert: what they print, and their exit codes."""

import json

import pytest

from test.bag_samples import write_sample
from valve_twin.cli.main import main
from valve_twin.io.bags.read import BagWriter, bag_info
from valve_twin.io.salvage.read import forget

START_NS = 1_577_836_800_000_000_000


@pytest.fixture
def bag(tmp_path):
    with BagWriter(tmp_path / "bag", chunk_size=2000) as writer:
        writer.note({"valve": "/press/valve_1"})
        for i in range(300):
            write_sample(writer, "/press/position", START_NS + i * 10_000_000, float(i))
    return tmp_path / "bag"


def cut_off(bag, share):
    file = bag / "bag_0.mcap"
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    forget()


def test_info_says_what_is_there(bag, capsys):
    assert main(["info", str(bag)]) == 0
    text = capsys.readouterr().out
    for part in ("messages:    300", "valve: /press/valve_1", "300, 100.00 Hz", "zstd"):
        assert part in text


def test_info_of_a_damaged_bag_fails_and_names_the_damage(bag, capsys):
    cut_off(bag, 0.3)
    assert main(["info", str(bag), "--json"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert report["damaged"]
    assert report["messages"] + report["lost_messages"] == 300
    assert report["damage"][0]["offset"] > 0


def test_recover_writes_a_sound_bag_and_says_what_is_lost(bag, tmp_path, capsys):
    cut_off(bag, 0.3)
    assert main(["recover", str(bag), "--out", str(tmp_path / "new")]) == 0
    text = capsys.readouterr().out
    count = bag_info(tmp_path / "new").message_count
    assert 0 < count < 300
    assert f"{count} messages written and verified: /press/position ({count})" in text
    assert f"{300 - count} messages are lost" in text
    assert main(["info", str(tmp_path / "new"), "--verify"]) == 0


def test_recover_without_anything_to_recover_fails_in_one_line(bag, tmp_path, capsys):
    cut_off(bag, 0.001)
    assert main(["recover", str(bag), "--out", str(tmp_path / "new")]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_cut_takes_seconds_and_dates(bag, tmp_path, capsys):
    out = tmp_path / "part"
    words = ["cut", str(bag), "--out", str(out), "--from", "1", "--to", "2020-01-01T00:00:02Z"]
    assert main(words) == 0
    assert "101 messages written and verified" in capsys.readouterr().out


@pytest.mark.parametrize(
    "words",
    [
        ["--from", "2", "--to", "1"],
        ["--from", "soon"],
        ["--cycles", "1..2"],
        ["--cycles", "1..2", "--config", "x.yaml", "--from", "1"],
    ],
)
def test_cut_refuses_wrong_usage_in_one_line(bag, tmp_path, capsys, words):
    assert main(["cut", str(bag), "--out", str(tmp_path / "part"), *words]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_cycles_are_cut_out_whole(root, tmp_path, capsys):
    config = str(root / "config" / "simulated_press.yaml")
    bag, out = str(tmp_path / "sim"), str(tmp_path / "part")
    assert main(["simulate", "--config", config, "--cycles", "4", "--out", bag]) == 0
    assert main(["cut", bag, "--out", out, "--config", config, "--cycles", "2..3"]) == 0
    assert 0 < bag_info(out).message_count < bag_info(bag).message_count
    assert main(["cut", bag, "--out", out + "9", "--config", config, "--cycles", "9"]) == 1
    assert "there is no cycle 9; it has 1..4" in capsys.readouterr().err


def test_convert_writes_a_table(bag, tmp_path, capsys):
    out = tmp_path / "x.csv"
    assert main(["convert", str(bag), "--out", str(out)]) == 0
    assert "300 rows, 6 columns of /press/position" in capsys.readouterr().out
    assert len(out.read_text(encoding="utf-8").splitlines()) == 301


def test_estimate_works_on_what_is_intact_and_says_what_is_lost(root, tmp_path, capsys, caplog):
    config = str(root / "config" / "simulated_press.yaml")
    assert (
        main(["simulate", "--config", config, "--cycles", "4", "--out", str(tmp_path / "b")]) == 0
    )
    file = tmp_path / "b" / "b_0.mcap"
    data = file.read_bytes()
    file.write_bytes(data[: len(data) * 3 // 4])
    capsys.readouterr()
    assert main(["estimate", str(tmp_path / "b"), "--config", config]) == 0
    assert '"cycle":' in capsys.readouterr().out
    assert "b_0.mcap: byte " in caplog.text
    assert "lost: " in caplog.text
