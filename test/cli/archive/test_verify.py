# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin verify`: equal pages, what it names where something changed, refusals in a line."""

import re
import shutil
from dataclasses import replace
from types import SimpleNamespace

import pytest

from valve_twin.cli import main
from valve_twin.io.config.valve import load_config
from valve_twin.io.history.store import History
from valve_twin.io.offline.run import run_bag
from valve_twin.report.provenance.record import versions

OK, FAILED, USAGE = 0, 1, 2
VALVE = "/press/valve_1"


def call(*arguments):
    try:
        return main([str(a) for a in arguments])
    except SystemExit as end:
        return int(str(end.code))


@pytest.fixture(scope="module")
def made(tmp_path_factory, root):
    """Return a bag, a configuration with a history, and the pages of both."""
    folder = tmp_path_factory.mktemp("verify")
    text = (root / "config" / "simulated_press.yaml").read_text(encoding="utf-8")
    head = "ros__parameters:\n"
    config, url = folder / "press.yaml", f"sqlite:///{folder / 'history.sqlite'}"
    config.write_text(
        text.replace(head, f"{head}    history_url: {url}\n    nameplate: {{tag: FV-1}}\n", 1),
        encoding="utf-8",
    )
    bag, page, of_history = (folder / name for name in ("bag", "bag.html", "history.html"))
    assert call("simulate", "--config", config, "--cycles", 3, "--out", bag) == OK
    assert call("report", bag, "--config", config, "--out", page, "--label", "by <load>") == OK
    record = run_bag(load_config(config)[0], bag)
    with History(url) as history:
        for cycle in record.cycles:
            found = [e for e in record.estimates if e.cycle == cycle.cycle]
            history.store(VALVE, cycle, found, counters=record.counters)
    assert call("report", "--config", config, "--out", of_history) == OK
    return SimpleNamespace(
        folder=folder, config=config, bag=bag, page=page, history=of_history, url=url,
        record=record,
    )  # fmt: skip


@pytest.fixture
def verify(capsys):
    """Return a function that runs the verb: exit code, lines printed, lines of error."""

    def run(*arguments):
        capsys.readouterr()
        code = call("verify", *arguments)
        out, err = capsys.readouterr()
        return code, out.splitlines(), err.splitlines()

    return run


def changed(page, tmp_path, old, new):
    """Return a copy of a page in which one text is another, the last time it stands there."""
    text = page.read_text(encoding="utf-8")
    assert old in text
    before, _, after = text.rpartition(old)
    path = tmp_path / page.name
    path.write_text(f"{before}{new}{after}", encoding="utf-8")
    return path


def test_a_page_of_a_bag_is_equal(made, verify):
    code, out, err = verify(made.page)
    assert (code, err) == (OK, [])
    assert out == [
        f"{made.page}: made again from {made.bag} "
        "(spool_position 2550, v_in 2550, v_out 2550): equal in every bit"
    ]
    assert verify(made.page, "--config", made.config)[0] == OK


def test_a_page_of_a_history_is_equal(made, verify):
    code, out, err = verify(made.history)
    assert (code, err) == (OK, [])
    assert "cycles 3, " in out[0]
    assert verify(made.history, "--url", made.url)[0] == OK


def test_a_german_page_is_equal_and_says_what_the_english_one_says(made, tmp_path, verify):
    page = tmp_path / "german.html"
    assert call("report", "--config", made.config, "--out", page, "--language", "de") == OK
    text = page.read_text(encoding="utf-8")
    for part in ('<html lang="de">', "Ventilbericht", "Datenqualität"):
        assert part in text
    assert "Data quality" not in text
    assert verify(page)[0] == OK


def test_a_page_with_a_budget_is_equal_and_one_without_is_not(made, tmp_path, verify):
    page = tmp_path / "budget.html"
    arguments = ("--config", made.config, "--out", page, "--budget")
    assert call("report", made.bag, *arguments) == OK
    assert verify(page)[0] == OK
    path = changed(page, tmp_path, "&#34;budget&#34;: true", "&#34;budget&#34;: false")
    code, out, _ = verify(path)
    assert code == FAILED
    assert any(line.startswith("page: section 'Error budget") for line in out)


def test_a_bag_that_moved_is_found_beside_the_page_or_as_it_is_told(made, tmp_path, verify):
    page = changed(made.page, tmp_path, str(made.bag), str(made.bag))
    text = page.read_text(encoding="utf-8").replace(str(made.bag), "/nowhere/else/bag")
    page.write_text(text, encoding="utf-8")
    assert verify(page) == (
        FAILED,
        [],
        [f"valve-twin: {page}: its bag /nowhere/else/bag is not there; give it with --bag"],
    )
    assert verify(page, "--bag", made.bag)[0] == OK
    shutil.copytree(made.bag, tmp_path / "bag")
    assert verify(page)[0] == OK


def test_a_number_that_was_changed_on_the_page_is_named_with_its_section(made, tmp_path, verify):
    html = made.page.read_text(encoding="utf-8")
    (shown,) = re.findall(r"Samples received</th><td>(\d\u202f\d+)</td>", html)
    page = changed(made.page, tmp_path, f"<td>{shown}</td>", "<td>4711</td>")
    code, out, err = verify(page)
    assert code == FAILED
    assert len(out) == 1
    assert out[0].startswith("page: section 'Data quality': ")
    then, _, now = out[0].partition(" in the report, ")
    assert "4711" in then
    assert " ".join(shown.split()) in now
    assert err == [f"valve-twin: {page}: differs from what {made.bag} gives now"]


def test_a_drawing_that_was_changed_is_named_with_its_figure(made, tmp_path, verify):
    page = changed(made.page, tmp_path, '<path class="', '<path class="x')
    code, out, _ = verify(page)
    assert code == FAILED
    assert out[0].startswith("page: section 'Parameters over cycles (by <load>)', figure '")


def test_a_bag_with_other_samples_is_named_by_its_signal(made, tmp_path, verify):
    other = tmp_path / "other"
    setting = ("--seed", 7, "--cycles", 3, "--out", other)
    assert call("simulate", "--config", made.config, *setting) == OK
    code, out, _ = verify(made.page, "--bag", other)
    assert code == FAILED
    assert out[0].startswith("input: samples of signal 'spool_position': 2550 with sha256 ")
    assert out[0].endswith(f" in {other}")
    assert sum(line.startswith("input: ") for line in out) == 3
    assert any(line.startswith("page: ") for line in out)


def test_a_recovered_bag_is_the_same_input(made, tmp_path, verify):
    whole = tmp_path / "whole"
    assert call("recover", made.bag, "--out", whole) == OK
    assert verify(made.page, "--bag", whole)[0] == OK


def test_a_key_that_was_changed_is_named(made, tmp_path, verify):
    text = made.config.read_text(encoding="utf-8").replace("FV-1", "FV-2")
    config = tmp_path / "press.yaml"
    config.write_text(text, "utf-8")
    code, out, _ = verify(made.page, "--config", config)
    assert code == FAILED
    assert 'configuration: nameplate.tag: "FV-1" in the report, "FV-2" now' in out
    assert any(line.startswith("page: head and verdict") for line in out)


def test_a_history_that_grew_keeps_its_rows_and_one_that_changed_does_not(made, tmp_path, verify):
    copy = tmp_path / "history.sqlite"
    assert call("history", "backup", "--url", made.url, "--out", copy) == OK
    assert verify(made.history, "--url", copy)[0] == OK
    last = made.record.cycles[-1]
    with History(copy) as history:
        history.store(VALVE, replace(last, cycle=last.cycle + 1, accepted=False), [])
    code, out, _ = verify(made.history, "--url", copy)
    assert code == FAILED
    assert out[0] == "input: cycles: 1 were added, the 3 of the report are unchanged"
    assert not any("estimates: " in line for line in out if line.startswith("input"))


def test_another_version_is_told_but_is_no_difference_where_the_page_is_the_same(
    made, verify, monkeypatch
):
    here = versions()
    changed_to = {**here, "numpy": "0.1"}
    monkeypatch.setattr("valve_twin.report.provenance.compare.versions", lambda: changed_to)
    code, out, err = verify(made.page)
    assert code == OK
    assert out[0].endswith("equal in every bit")
    line = f"version: numpy: {here['numpy']} in the report, 0.1 here: the page is the same"
    assert err == [f"valve-twin: {line}"]


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (("--bag", "b", "--url", "u"), ("give --bag or --url, not both",)),
        (("--url", "u"), ("was made from a bag: give --bag, not --url",)),
        (("--valve", "x"), ("give --config as well",)),
        (("--config", "nowhere.yaml"), ("nowhere.yaml: there is no such file",)),
    ],
)
def test_wrong_usage_is_one_line(made, verify, arguments, parts):
    code, out, err = verify(made.page, *arguments)
    assert (code, out, len(err)) == (USAGE, [], 1)
    assert all(part in err[0] for part in parts)


def test_a_history_is_no_bag(made, verify):
    code, _, err = verify(made.history, "--bag", made.bag)
    assert (code, len(err)) == (USAGE, 1)
    assert "was made from a history: give --url, not --bag" in err[0]


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b"<html><body>hello</body></html>", "carries no provenance"),
        (b"\xff\xfe\x00", "is no text in UTF-8"),
        (b'<meta name="valve_twin.provenance" content="{}">', "its provenance is damaged"),
        (b'<meta name="valve_twin.provenance" content="[1]">', "its provenance is damaged"),
        (b'<meta name="valve_twin.provenance">', "its provenance is damaged"),
        (b'<meta name="valve_twin.provenance" content=\'{"form": 9}\'>', "has form 9, known is 1"),
    ],
)
def test_what_is_no_report_is_refused_in_one_line(tmp_path, verify, content, part):
    page = tmp_path / "page.html"
    page.write_bytes(content)
    code, out, err = verify(page)
    assert (code, out, len(err)) == (FAILED, [], 1)
    assert part in err[0]


def test_a_missing_page_and_a_missing_bag_are_one_line(made, tmp_path, verify):
    code, _, err = verify(tmp_path / "none.html")
    assert (code, len(err)) == (FAILED, 1)
    assert "none.html: there is no such file" in err[0]
    code, _, err = verify(made.page, "--bag", tmp_path / "none")
    assert (code, len(err)) == (FAILED, 1)
