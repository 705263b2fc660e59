# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design report`: the page of a search."""

from __future__ import annotations

import resource

import pytest

from valve_twin.cli import main
from valve_twin.cli.design import sensitivity
from valve_twin.design import chain
from valve_twin.design.geometry import DoubleStroke, read_design, read_dxf
from valve_twin.design.map import MapGrid
from valve_twin.design.search.archive import Archive, header_of
from valve_twin.design.search.tasks import DesignTask, Outcome

FIGURES = {"rise_s": 3e-3, "settling_s": 6e-3, "graded_s": 6e-3, "overshoot": 0.02, "error": 0.001,
           "loss": 1.2,
           "heating": 10.0, "margin": 80.0}  # fmt: skip
pytestmark = pytest.mark.usefixtures("transients_once", "maps_once")


@pytest.fixture
def quick(monkeypatch):
    coarse = chain.Fidelity(MapGrid(currents=4, positions=4, fine=0.3), fine=0.3, step=4e-4)
    monkeypatch.setitem(chain.FIDELITIES, "usual", coarse)
    monkeypatch.setattr(chain, "STEPS", (0.5,))


@pytest.fixture
def searched(tmp_path):
    """Return an archive with reference, a better design, and one that keeps no limit."""

    def make(*fidelities):
        found = []
        for fidelity in fidelities:
            for gap, factor in ((0.1875, 1.0), (0.187, 0.9), (0.17, 0.8)):
                values = {"gap_ratio": gap, "valve.preload": 20.0}
                figures = {name: factor * v for name, v in FIGURES.items()}
                figures["overshoot"] = 0.3 if gap == 0.17 else 0.02
                found.append(Outcome(f"gap {gap}", fidelity, values, figures))
        path = tmp_path / "a.jsonl"
        archive = Archive(path, header_of(DoubleStroke(), ""))
        tasks = [DesignTask(of.key, DoubleStroke(), of.values, "", of.fidelity) for of in found]
        archive.outcomes(tasks, lambda tasks: found)
        return str(path)

    return make


def plane(arguments, work, lost, *, keep):
    """Return what runs tasks: every figure follows the gap."""
    del arguments, work, lost, keep
    poles = {f"{of}_{kind}_{k}_hz": 10.0 for of in ("current", "force")
             for kind in ("pole", "zero") for k in (1, 2)}  # fmt: skip

    def run(tasks):
        for task in tasks:
            gap = task.design.gap_ratio
            figures = {name: v * gap for name, v in FIGURES.items()} | poles
            curves = {"force": (gap,), "flux": (gap,)}
            yield Outcome(task.key, task.fidelity, task.values, figures, curves)

    return run


def test_the_folder_holds_page_drawing_and_numbers(quick, searched, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(sensitivity, "runner_of", plane)
    archive, out = searched("search", "usual", "twice"), tmp_path / "out"
    words = ["--archive", archive, "--out", str(out), "--sensitivity", "--sobol", "20"]
    words += ["--of", "gap_ratio", "--of", "tube_ratio"]
    assert main(["design", "report", *words]) == 0
    assert "report.html: written" in capsys.readouterr().err
    html = (out / "report.html").read_text(encoding="utf-8")
    for text in (
        "rise -10 %",
        "settling -10 %",
        "1 (chosen)",
        "Sobol",
        "tube_ratio",
        "chosen.dxf",
    ):
        assert text in html, text
    assert html.count("data:image/svg+xml") == 1 + 2 * 4 + 1
    chosen = read_design(out / "chosen.yaml")
    assert isinstance(chosen, DoubleStroke)
    assert chosen.gap_ratio == 0.187
    assert chosen.stroke == pytest.approx(DoubleStroke().stroke)
    assert "armature" in read_dxf(out / "chosen.dxf")


def test_without_an_archive_or_a_final_front_there_is_no_page(searched, tmp_path, capsys):
    out = str(tmp_path / "out")
    for archive, said in (
        (str(tmp_path / "none"), "none: name the file of valve-twin design optimise"),
        (searched("search"), "the archive holds no reference on the fields 'twice'"),
    ):
        assert main(["design", "report", "--archive", archive, "--out", out]) == 2
        shown = capsys.readouterr().err
        assert said in shown
        assert shown.count("\n") == 1


def test_a_folder_that_fills_up_keeps_the_page_and_drawing_that_belong_together(
    quick, searched, tmp_path, monkeypatch
):
    archive, out = searched("search", "usual", "twice"), tmp_path / "out"
    words = ["design", "report", "--archive", archive, "--out", str(out)]
    out.mkdir()
    (out / "chosen.yaml").write_text("of before", encoding="utf-8")
    page = "valve_twin.report.design.page.render_design"
    monkeypatch.setattr(page, lambda page: "x" * 10_000_000)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5_000_000, hard))
    try:
        assert main(words) == 1
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert [path.name for path in out.iterdir()] == ["chosen.yaml"]
    assert (out / "chosen.yaml").read_text(encoding="utf-8") == "of before"
