# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The report page: complete, self-contained, honest about what is not known, safe to open."""

from __future__ import annotations

import dataclasses
import re
from html.parser import HTMLParser
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from valve_twin.core.faults.advice import advise
from valve_twin.core.types import (
    Disagreement,
    EstimateStatus,
    Guard,
    ParameterStatus,
    ParameterValue,
)
from valve_twin.io.errors import ValveTwinError
from valve_twin.report import ReportData, render_report, write_report
from valve_twin.report.tables import refused_cycles

if TYPE_CHECKING:
    from pathlib import Path
    from types import ModuleType

VOID = {"meta", "path", "rect", "circle"}


class Structure(HTMLParser):
    """Collect elements and text; fail on wrong nesting."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="module")
def data(example: ModuleType) -> ReportData:
    made = example.report_data()
    assert isinstance(made, ReportData)
    return made


@pytest.fixture(scope="module")
def page(data: ReportData) -> str:
    return render_report(data)


@pytest.fixture(scope="module")
def text(page: str) -> str:
    return Structure(page).text


def svgs(page: str, kind: str) -> list[ET.Element]:
    found = re.findall(rf'<svg class="{kind}".*?</svg>', page, re.DOTALL)
    return [ET.fromstring(svg) for svg in found]


def paths(svg: ET.Element, style: str) -> list[str]:
    return [str(p.get("d")) for p in svg.iter("path") if p.get("class") == style]


class TestPage:
    def test_needs_nothing_from_outside_and_runs_nothing(self, page: str) -> None:
        tags = {tag for tag, _ in Structure(page).tags}
        assert tags.isdisjoint({"script", "link", "img", "iframe", "object", "use", "image"})
        attributes = {name for _, attrs in Structure(page).tags for name in attrs}
        assert not {a for a in attributes if a.startswith("on") or a in {"src", "href"}}
        assert "http" not in page
        assert "url(" not in page
        assert "@import" not in page

    def test_is_small(self, page: str) -> None:
        assert len(page.encode()) < 200_000

    def test_is_the_same_for_the_same_data(self, data: ReportData, page: str) -> None:
        assert render_report(data) == page

    def test_names_valve_model_source_range_and_version(self, text: str) -> None:
        for words in (
            "/press/valve_1",
            "Model press_cartridge. Data: history.db.",
            "Cycles 1 to 106, from 2026-02-02 03:40:00 UTC to",
            "valve_twin 0.1.0; written 2026-02-06",
            "estimators: output_error, equation_error_qp4",
            "v_ref = 0.3",
        ):
            assert words in text

    def test_gives_verdict_with_its_cause_in_word_and_shape(
        self, data: ReportData, page: str
    ) -> None:
        assert data.assessment is not None
        assert '<section class="verdict bad">' in page
        text = Structure(page).text
        assert f"The valve needs attention {data.assessment.verdict.evidence}" in text
        advice = advise(data.assessment.verdict, data.assessment.trends)
        assert f"NE 107: {advice.ne107.value}" in text
        assert f"(ISO 14224); probably {advice.cause}" in text
        assert advice.action in text

    def test_says_that_a_steady_valve_is_in_order(self, example: ModuleType) -> None:
        made = example.report_data(drift=0.0)
        steady = dataclasses.replace(
            made.assessment.verdict,
            kind=type(made.assessment.verdict.kind).OK,
            evidence="no drift",
        )
        made = dataclasses.replace(
            made, assessment=dataclasses.replace(made.assessment, verdict=steady)
        )
        assert "Nothing has changed no drift" in Structure(render_report(made)).text

    def test_shows_the_trend_numbers_of_the_monitor(self, data: ReportData, text: str) -> None:
        assert data.assessment is not None
        trend = data.assessment.trends[0]
        assert trend.parameter == "K_in"
        assert f"{trend.level:.5f}" in text
        change = f"{trend.drift_reference:+.1f} %".replace("-", "−")
        assert change in text
        assert f"{round(trend.remaining_median)} {round(trend.remaining_low)} … " in text
        assert trend.reason.replace("-", "−") in text

    def test_lists_refused_cycles_and_parameters_with_the_reason(self, text: str) -> None:
        assert "shorter than min_cycle_s = 1 s: the command fell back at once" in text
        assert "leak not excited 4 no rest longer than 1 s" in text

    def test_counts_lost_and_masked_samples(self, text: str) -> None:
        assert "Samples lost 4 (0.00 %)" in text
        assert "Masked: seat 14 805" in text
        assert "Masked: bad 105 (0.07 %)" in text

    def test_explains_units_and_intervals(self, text: str) -> None:
        assert "leak [1/s]" in text
        assert "Positions are shares of the stroke" in text
        assert "An interval that is not calibrated is not shown" in text
        assert "filter of the pilot oil changed" in text


class TestHonesty:
    def test_cycles_by_load_get_no_verdict_trend_or_life(self, example: ModuleType) -> None:
        made = example.report_data(label="by load, not aging", assessment=None, maintenance=())
        page = render_report(made)
        text = Structure(page).text
        assert "Valve report: by load, not aging" in text
        assert "No aging verdict" in text
        assert "Parameters over cycles (by load, not aging)" in text
        assert "Remaining life" not in text
        assert all(
            not paths(svg, style) for svg in svgs(page, "small") for style in ("trend", "mean")
        )

    def test_a_label_hides_the_trend_even_where_there_is_one(self, example: ModuleType) -> None:
        page = render_report(example.report_data(label="by load, not aging"))
        assert "Remaining life" not in page
        assert "needs attention" not in page
        assert not any(paths(svg, "trend") for svg in svgs(page, "small"))

    def test_says_not_calibrated_before_ten_cycles(self, example: ModuleType) -> None:
        few = example.estimates(cycles=9)
        page = render_report(example.report_data(estimates=tuple(few), assessment=None))
        text = Structure(page).text
        assert "limits of single estimates: not calibrated (fewer than 10 cycles)" in text
        assert "interval not calibrated" in text
        assert not any(paths(svg, "limits") for svg in svgs(page, "small"))

    def test_an_unbounded_life_is_called_so(self, data: ReportData, text: str) -> None:
        assert data.assessment is not None
        assert data.assessment.trends[1].unbounded
        assert "no forecast yet" in text

    def test_a_value_on_its_bound_is_called_a_limit(self, example: ModuleType) -> None:
        found = example.estimates(cycles=20)
        bound = ParameterValue("K_in", 0.0, ParameterStatus.AT_BOUND)
        found[-2] = dataclasses.replace(found[-2], parameters=(bound, *found[-2].parameters[1:]))
        text = Structure(render_report(example.report_data(estimates=tuple(found)))).text
        assert "on its bound: a limit, not a measurement" in text

    def test_names_the_constant_that_limits_a_value(self, example: ModuleType) -> None:
        found = example.estimates(cycles=20)
        why = "limited by the tolerance of area_1"
        limited = ParameterValue("K_in", 0.01, reason=why, lower_95=0.009, upper_95=0.011)
        found[-2] = dataclasses.replace(found[-2], parameters=(limited, *found[-2].parameters[1:]))
        text = Structure(render_report(example.report_data(estimates=tuple(found)))).text
        assert why in text

    @pytest.mark.parametrize("without_cycles", [False, True])
    def test_says_what_is_missing(self, data: ReportData, without_cycles: bool) -> None:
        bare = dataclasses.replace(
            data, assessment=None, prediction=None, maintenance=(), estimates=()
        )
        if without_cycles:
            bare = dataclasses.replace(bare, cycles=())
        text = Structure(render_report(bare)).text
        assert "Not enough data for a verdict" in text
        assert "No cycle with a prediction is in these data." in text
        assert "No estimate is in these data." in text

    def test_draws_no_line_where_the_monitor_has_not_enough_data(
        self, example: ModuleType
    ) -> None:
        few = example.estimates(cycles=6)
        made = example.report_data(estimates=tuple(few))
        trends = example.assess(
            few, (), example.AgingConfig(), parameters=example.PARAMETERS, valve="/v"
        )
        page = render_report(dataclasses.replace(made, assessment=trends, maintenance=()))
        assert "Nothing to compare the valve with yet" in page
        for svg in svgs(page, "small"):
            assert not any(paths(svg, style) for style in ("trend", "mean", "prediction"))
            assert paths(svg, "estimate")

    def test_survives_a_history_of_refusals(self, example: ModuleType) -> None:
        refused = [
            dataclasses.replace(
                e,
                status=EstimateStatus.REFUSED,
                reason="spool did not move",
                parameters=tuple(
                    ParameterValue(p.name, np.nan, ParameterStatus.REFUSED) for p in e.parameters
                ),
            )
            for e in example.estimates(cycles=70)
        ]
        text = Structure(render_report(example.report_data(estimates=tuple(refused)))).text
        assert "the newest 60 of 71" in text
        assert "69 " in text
        assert "spool did not move" in text
        assert text.count("no cycle says anything about it") == 3

    def test_a_cycle_without_an_estimate_counts_as_refused(self, example: ModuleType) -> None:
        data = example.report_data()
        last = data.trend_estimates[-1]
        silent = dataclasses.replace(last, status=EstimateStatus.REFUSED, reason="no motion")
        made = tuple(silent if e is last else e for e in data.estimates)
        before = Structure(render_report(data)).text
        after = Structure(render_report(dataclasses.replace(data, estimates=made))).text
        count = re.compile(r"(\d+) refused")
        assert int(count.findall(after)[0]) == int(count.findall(before)[0]) + 1

    def test_a_cycle_that_was_cut_off_counts_as_refused_once(self, example: ModuleType) -> None:
        """Estimation is handed it as well and stores an estimate that is refused."""
        data = example.report_data()
        last = data.trend_estimates[-1]
        silent = dataclasses.replace(last, status=EstimateStatus.REFUSED, reason="cut off")
        estimates = tuple(silent if e is last else e for e in data.estimates)
        own = next(c for c in data.cycles if c.cycle == last.cycle)
        short = dataclasses.replace(own, accepted=False, reason="cut off")
        cycles = tuple(short if c is own else c for c in data.cycles)
        made = dataclasses.replace(data, estimates=estimates, cycles=cycles)
        count = re.compile(r"(\d+) refused")
        before, after = (Structure(render_report(d)).text for d in (data, made))
        assert int(count.findall(after)[0]) == int(count.findall(before)[0]) + 1
        assert [row[2] for row in refused_cycles(made).rows].count("cut off") == 1

    def test_escapes_everything_that_comes_from_outside(self, data: ReportData) -> None:
        evil = '<script>alert("x")</script>&'
        made = dataclasses.replace(
            data,
            valve=evil,
            model=evil,
            source=evil,
            notes=(evil,),
            version=evil,
            options={evil: evil},
            parameters=tuple(
                dataclasses.replace(p, unit=evil, description=evil) for p in data.parameters
            ),
            cycles=tuple(
                dataclasses.replace(c, accepted=False, reason=evil, software=evil)
                for c in data.cycles
            ),
            maintenance=tuple(dataclasses.replace(m, note=evil) for m in data.maintenance),
            estimates=tuple(
                dataclasses.replace(
                    e,
                    estimator=evil,
                    reason=evil,
                    parameters=tuple(
                        ParameterValue(p.name + evil, 1.0, ParameterStatus.AT_BOUND, evil)
                        for p in e.parameters
                    ),
                )
                for e in data.estimates
            ),
        )
        for label in ("", evil):
            page = render_report(dataclasses.replace(made, label=label))
            assert "<script" not in page
            assert Structure(page).text.count('<script>alert("x")</script>&') > 10


class TestCharts:
    def test_every_accepted_estimate_is_a_dot_at_its_place(
        self, example: ModuleType, page: str
    ) -> None:
        svg = svgs(page, "small")[0]
        dots = re.findall(r"M([\d.]+) ([\d.]+)h0", paths(svg, "estimate")[0])
        values = [e.value("K_in") for e in example.estimates() if e.used_by_trend]
        assert len(dots) == 105
        x, y = np.array(dots, float).T
        assert np.all(np.diff(x) > 0)
        assert np.corrcoef(y, values)[0, 1] < -0.9999  # up on the page is more

    def test_refused_estimates_are_marked_and_not_drawn_as_values(self, page: str) -> None:
        leak = svgs(page, "small")[2]
        assert paths(leak, "estimate")[0].count("M") == 101
        assert paths(leak, "refused")[0].count("M") == 4

    def test_lines_bands_limit_and_maintenance_are_there(
        self, data: ReportData, page: str
    ) -> None:
        assert data.assessment is not None
        for svg, detail in zip(svgs(page, "small"), data.assessment.details, strict=True):
            fits = sum(line is not None for line in detail.lines)
            for style in ("trend", "mean", "prediction"):
                assert len(paths(svg, style)) == fits
            assert len(paths(svg, "service")) == 1
            assert any("service limit" in str(t.text) for t in svg.iter("text"))

    def test_a_withdrawn_event_is_listed_as_such_and_not_drawn(self, data: ReportData) -> None:
        (event,) = data.maintenance
        gone = dataclasses.replace(event, withdrawn=True, withdrawn_note="it was valve 2")
        page = render_report(dataclasses.replace(data, maintenance=(gone,)))
        assert "withdrawn, begins nothing: it was valve 2" in Structure(page).text
        assert event.note in Structure(page).text
        assert not any(paths(svg, "service") for svg in svgs(page, "small"))

    def test_no_coordinate_is_lost(self, page: str) -> None:
        for svg in (*svgs(page, "small"), *svgs(page, "wide")):
            for path in svg.iter("path"):
                assert "nan" not in str(path.get("d"))
                assert "inf" not in str(path.get("d"))

    def test_the_last_cycle_shows_all_curves_and_what_cannot_be_judged(self, page: str) -> None:
        (svg,) = svgs(page, "wide")
        for style in ("measured", "predicted", "freerun", "residual", "expected"):
            assert len(paths(svg, style)) == 1
        assert len([r for r in svg.iter("rect") if r.get("class") == "unused"]) == 4

    def test_a_long_cycle_is_thinned_without_losing_its_peaks(self, example: ModuleType) -> None:
        base = example.prediction()
        n = 200_000
        measured = np.zeros(n)
        measured[123_456] = 1.0
        long = dataclasses.replace(
            base,
            stamp_ns=base.stamp_ns[0] + np.arange(n) * 10**6,
            measured=measured,
            predicted=np.zeros(n),
            simulated=np.full(n, np.nan),
            residual=measured,
            validity=np.zeros(n, np.uint8),
        )
        page = render_report(example.report_data(prediction=long))
        (svg,) = svgs(page, "wide")
        points = re.findall(r"[ML]([\d.]+) ([\d.]+)", paths(svg, "measured")[0])
        assert len(points) <= 2000
        assert min(float(y) for _, y in points) == pytest.approx(34 + 262 * 0.04 / 1.08, abs=0.2)


class TestWriting:
    def test_writes_a_file(self, data: ReportData, page: str, tmp_path: Path) -> None:
        path = write_report(data, tmp_path / "report.html")
        assert path.read_text(encoding="utf-8") == page
        assert [p.name for p in tmp_path.iterdir()] == ["report.html"]

    def test_names_a_folder_that_does_not_exist(self, data: ReportData, tmp_path: Path) -> None:
        with pytest.raises(
            ValveTwinError, match=r"nowhere/r.html: cannot be written: No such file"
        ):
            write_report(data, tmp_path / "nowhere" / "r.html")


def test_estimators_are_held_against_each_other(data: ReportData) -> None:
    *before, last = data.estimates
    judged = dataclasses.replace(
        last,
        trend_reason="output_error always feeds the trend; scatter: <1 %",
        disagreements=(
            Disagreement("kalman", "K_in", 1e-5, 0.34),
            Disagreement("kalman", "K_out", -1e-3, -2.41),
            Disagreement("kalman", "pole", 0.1, np.nan),
        ),
        guards=(
            Guard("noise at rest", True, 1e-3, 0.01, "1.0e-3"),
            Guard("structure: level of v_in", False, 0.2, 0.1, "K_in is 20 % larger below 0.4"),
        ),
    )
    text = Structure(render_report(dataclasses.replace(data, estimates=(*before, judged)))).text
    assert "output_error always feeds the trend; scatter: <1 %" in text
    assert "kalman: K_in +0.3, K_out \N{MINUS SIGN}2.4" in text
    assert "structure: level of v_in K_in is 20 % larger below 0.4 1 passed" in text
    assert "Disagreement" not in Structure(render_report(data)).text


def test_the_nameplate_stands_on_the_page_as_text(data: ReportData) -> None:
    plate = {"tag": "FV-1205", "place": "hall <3>"}
    html = render_report(dataclasses.replace(data, nameplate=plate))
    assert "Tag FV-1205, Place hall &lt;3&gt;." in html
