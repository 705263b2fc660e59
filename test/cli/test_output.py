# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the verbs print: names of foreign origin are shown, never obeyed by a terminal."""

import io

import pytest
import yaml
from rich.console import Console

from test.bag_samples import write_sample
from valve_twin.cli import main, output
from valve_twin.io.bags.read import BagWriter
from valve_twin.io.history.store import CycleRecord, History

ORDER = "\x1b]0;mine\x07\x9b2J\u202e"
CONFIG = """\
/**:
  ros__parameters:
    model: first_order
    period_s: 0.05
    signals:
      command: {topic: command, column: a}
      position: {topic: position, column: b}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a bag, a table and a history whose names give orders."""
    made = tmp_path_factory.mktemp("orders")
    with BagWriter(made / "bag") as writer:
        for i in range(60):
            write_sample(writer, f"/a{ORDER}", 10**18 + i * 10**7, 0.1 * i)
    rows = "".join(f"{i},{i % 7},{2 * i}\n" for i in range(50))
    (made / f"a{ORDER}.csv").write_text(f"t,x{ORDER},y\n{rows}50,{ORDER},1\n", encoding="utf-8")
    with History(made / "h.sqlite") as history:
        history.store(f"/v{ORDER}", CycleRecord(1, 0, 1, 850, reason=ORDER))
    (made / "valve.yaml").write_text(CONFIG, encoding="utf-8")
    return made


@pytest.mark.parametrize(
    "command",
    [
        "info bag",
        "info bag --verify",
        "info bag --json",
        "estimate bag --config valve.yaml",
        "cut bag --from 0 --to 5 --out part",
        "recover bag --out whole",
        "convert bag --config valve.yaml --out out.csv",
        "configure bag",
        f"configure a{ORDER}.csv",
        f"import a{ORDER}.csv --config valve.yaml --out bag_2",
        "history list --url h.sqlite",
        "history verify --url h.sqlite",
        "fleet --url h.sqlite",
        "fleet --url h.sqlite --json",
    ],
)
def test_no_name_gives_the_terminal_an_order(folder, monkeypatch, capsys, command):
    monkeypatch.chdir(folder)
    main(command.split(" "))
    out, err = capsys.readouterr()
    assert out + err
    assert not set(out + err) & set(ORDER[0] + "\x07\x9b\u202e")


def test_tables_keep_their_own_orders():
    stream = io.StringIO()
    console = output.console()
    assert isinstance(console, Console)
    table = output.table("t", left=["name"])
    table.add_row(f"[bold]x[/bold]{ORDER}")
    shown = type(console)(file=stream, force_terminal=True, color_system="standard", width=80)
    shown.print(table)
    assert "\x1b[1mx\x1b[0m" in stream.getvalue()
    assert "\\x1b]0;" in stream.getvalue()
    assert "\x1b]" not in stream.getvalue()


def test_text_that_people_write_is_as_it_was():
    text = "Öffnung 3 µm\t≥ 0.5\n压力 → ok\n"
    assert output.shown(text) == text


def test_a_damaged_name_can_be_written():
    assert output.shown("/v\udc80") == "/v\\udc80"


def test_no_line_of_a_table_becomes_a_line_of_a_proposed_configuration(tmp_path, capsys):
    name = "x\n/**:\n  ros__parameters:\n    history_url: /etc/x\n#"
    rows = "".join(
        f"{0.05 * i:.2f},{float(i % 80 >= 40)},{float(i % 80 >= 42)}\n" for i in range(800)
    )
    (tmp_path / "a.csv").write_text(f'"t","{name}","y\nmore: 1"\n{rows}', encoding="utf-8")
    code = main(["configure", str(tmp_path / "a.csv")])
    out, err = capsys.readouterr()
    assert code == 0, err
    assert "history_url" not in yaml.safe_load(out)["/**"]["ros__parameters"]
