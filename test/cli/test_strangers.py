# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin campaign --strangers` on a press, met as shipped, and on a valve of any kind."""

import json

from valve_twin.cli.main import main
from valve_twin.cli.strangers import setup_of


def test_it_prints_every_share_and_writes_all_figures(tmp_path, capsys):
    out = tmp_path / "strangers.json"
    asked = ["campaign", "--strangers", "--seed-base", "0", "--count", "1", "--json", str(out)]
    assert main(asked) == 0
    said = capsys.readouterr().out
    figures = json.loads(out.read_text(encoding="utf-8"))
    assert figures["seeds"] == [0]
    for name in ("false alarm", "not enough data", "cycle interval: kalman K_in at 1e-3"):
        assert name in said
        assert figures["shares"][name][1] > 20
    assert [len(s["verdicts"]) for s in figures["strangers"]] == [44]


def test_any_valve_is_configured_from_an_earlier_record_and_then_watched(tmp_path, capsys):
    out = tmp_path / "any.json"
    asked = ["--strangers", "any", "--seed-base", "73004", "--count", "1", "--json", str(out)]
    assert main(["campaign", *asked]) == 0
    assert "judged at all: cylinder" in capsys.readouterr().out
    (met,) = json.loads(out.read_text(encoding="utf-8"))["strangers"]
    healthy, *troubled = met["records"]
    assert (met["kind"], healthy["trouble"], healthy["findings"]) == ("cylinder", None, [])
    assert all(record["cycles"] > 10 for record in met["records"])
    assert len({record["trouble"]["name"] for record in troubled}) == 4


def test_first_cycles_are_judged_with_and_without_a_reference_of_sisters(tmp_path):
    """Seed 73012 is one of tuning; its faults: from cycle 1, and from three later ones."""
    out = tmp_path / "first.json"
    asked = ["--seed-base", "73012", "--count", "1", "--with-reference", "2", "--json", str(out)]
    assert main(["campaign", "--strangers", *asked]) == 0
    figures = json.loads(out.read_text(encoding="utf-8"))
    (met,) = figures["strangers"]
    assert (met["sisters"], met["refused"]) == (2, "")
    assert met["words"][0].count("o") > 5
    assert [t["onset"] == 1 for t in met["troubles"]] == [True, False, False, False]
    told = {n: v for n, v in figures["shares"].items() if n.endswith("told at 15")}
    assert sum(v[0] for n, v in told.items() if n.startswith("with:")) > sum(
        v[0] for n, v in told.items() if n.startswith("without:")
    )


def test_a_reference_is_for_presses(capsys):
    assert main(["campaign", "--strangers", "any", "--with-reference", "3"]) == 2
    assert "--with-reference is for --strangers press" in capsys.readouterr().err


def test_the_twin_that_meets_them_is_configured_as_shipped(root):
    built, shipped = setup_of(None), setup_of(str(root / "config" / "press_cartridge.yaml"))
    assert built == shipped


def test_without_a_file_and_without_strangers_it_says_what_to_give(capsys):
    assert main(["campaign"]) == 2
    assert "give --config FILE, --model NAME, or --strangers" in capsys.readouterr().err
