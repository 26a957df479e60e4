import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from pd_editor.analysis.metrics.values import METRICS
from pd_editor.experiments.evaluation.evaluation import (
    ROWS_NAME,
    EvaluationPlan,
    EvaluationSplits,
    Failure,
    RunRecord,
    run_evaluation,
    scenes_of,
    splits_of,
)
from pd_editor.experiments.evaluation.report.sections import Findings, report_of
from pd_editor.experiments.evaluation.report.tables import (
    COMPARED,
    SHOWN,
    difference_tables,
    figures_of,
    named,
)
from pd_editor.experiments.evaluation.scene_rows import METRIC_COLUMNS
from pd_editor.experiments.evaluation.summary import Summary, summarise
from tests.experiments.evaluation.small_dataset import OneByOne, plan_for, write_dataset

NAMES = ("ground-truth", "constant-velocity", "sideways")
Found = tuple[EvaluationPlan, RunRecord, Findings]


def findings(summary: Summary) -> Findings:
    splits = EvaluationSplits(held_out=("train", "val"), development=())
    return Findings(splits=splits, summary=summary)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Found:
    root = write_dataset(tmp_path_factory.mktemp("data"))
    plan = plan_for(root, *NAMES, warps=("none", "smooth-turn:3", "smooth-turn:9"))
    out = tmp_path_factory.mktemp("out") / "out"
    folder = plan.folder(out, resume=False)
    record = run_evaluation(plan, scenes_of(plan.data, plan.limit), folder, OneByOne())
    summary = summarise(out / ROWS_NAME, NAMES, plan.conditions, 0)
    return plan, record, findings(summary)


def rows_under(text: str, heading: str) -> dict[str, list[str]]:
    """Cells of a Markdown table by the first cell of their row."""
    part = text.split(f"### {heading}\n")[1].split("\n#")[0]
    lines = [
        re.split(r" *\| *", line)[1:-1] for line in part.splitlines() if "|" in line
    ]
    return {line[0]: line[1:] for line in lines}


def test_the_main_table_by_hand(found):
    text = report_of(*found, "pd-editor evaluate").markdown()
    table = rows_under(text, "Movers, plain roads")
    assert table["method"][:2] == ["agents / scenes", "final lateral deviation, m"]
    head = dict(zip(table["method"], table["sideways"], strict=True))
    # Eight agents; sample 0 is 1 m off the recording's lane, sample 1 at most 1.75 m.
    assert head["agents / scenes"] == "8 / 3"
    log = dict(zip(table["method"], table["ground-truth"], strict=True))
    assert log["new collisions, %"].startswith("25.0 [0.0,")
    assert log["ADE, m"] == "0.00 [0.00, 0.00]"
    assert head["end spread, m"] == "1.00 [1.00, 1.00]"
    assert log["end spread, m"] == "-"


def test_lateral_deviation_never_stands_alone(found):
    text = report_of(*found, "x").markdown()
    for line in text.splitlines():
        if line.startswith("| method") and "final lateral deviation" in line:
            for other in ("new collisions", "path length", "ADE", "spread"):
                assert other in line


def test_the_report_says_what_was_done(found):
    text = report_of(*found, "pd-editor evaluate --seed 0").markdown()
    for words in (
        "3 scenes on plain roads and on roads warped by smooth-turn:3, smooth-turn:9.",
        "logged trajectories are warped with the map",
        "1000 bootstrap resamples of scenes",
        "pd-editor evaluate --seed 0",
        "| numpy |",
        "| weights of sideways | abc123 |",
        "Nothing.",
    ):
        assert words in text
    for name in METRIC_COLUMNS:
        assert f"| {name} | {METRICS[name].source} |" in text
    assert "missed, % *paper*" in text


def test_held_out_scenes_stand_apart_from_those_that_chose_the_settings(
    found, tmp_path
):
    plan, record, _ = found
    folder = plan.folder(tmp_path / "out", resume=False)
    run_evaluation(plan, scenes_of(plan.data, plan.limit), folder, OneByOne())
    splits = splits_of(plan, scenes_of(plan.data, plan.limit))
    assert (splits.held_out, splits.development) == (("val",), ("train",))

    def summary_of(names):
        rows = folder.path / ROWS_NAME
        return summarise(rows, NAMES, plan.conditions, 0, names)

    apart = Findings(
        splits=splits,
        summary=summary_of(splits.headline),
        development=summary_of(splits.development),
    )
    text = report_of(plan, record, apart, "x").markdown()
    assert "Figures are of `val` unless a title says otherwise." in text
    head = rows_under(text, "Movers, plain roads")
    other = rows_under(text, "Movers, plain roads (development)")
    assert head["sideways"][0] == "3 / 1"
    assert other["sideways"][0] == "5 / 2"
    only = replace(apart, splits=replace(splits, held_out=()), development=None)
    assert "no evidence of quality" in report_of(plan, record, only, "x").markdown()


def test_failures_and_left_out_scenes_are_said(found):
    plan, record, evaluated = found
    broken = replace(
        record,
        failures=(
            Failure(scene="s|1", condition="none", method="", reason="Broken <map>."),
            *[Failure(scene="b", condition="none", method="sideways", reason="?")] * 40,
        ),
        without_future=("x", "y"),
        num_skipped_folders=4,
    )
    report = report_of(plan, broken, evaluated, "x")
    text = report.markdown()
    for words in (
        "2 scenes have no logged future",
        "cannot be read: 4 folders.",
        "40 times sideways, 1 times the whole scene",
        "s\\|1",
        "And 11 more.",
    ):
        assert words in text
    assert "Broken &lt;map&gt;." in report.html()


def test_what_has_a_difference_has_pairs(found):
    """Pedestrians, which have no lane, had 0 pairs beside their differences."""
    summary = found[2].summary
    off_lane = summary.statistics[COMPARED[0]]
    none = replace(off_lane, num_pairs=np.zeros_like(off_lane.num_pairs))
    statistics = {**summary.statistics, COMPARED[0]: none}
    tables = difference_tables(replace(summary, statistics=statistics))
    assert tables
    assert all(int(row[1]) > 0 for table in tables for row in table.rows)


def test_the_page_is_whole_and_needs_nothing_else(found):
    plan, record, evaluated = found
    figures = figures_of(evaluated.summary, plan.conditions)
    page = report_of(plan, record, evaluated, "x").html()
    assert not re.search(r"href=|src=(?!\"data:)|url\(|@import", page)
    open_tags: list[str] = []

    class Checker(HTMLParser):
        def handle_starttag(self, tag, attrs):
            if tag not in ("meta", "img", "!doctype"):
                open_tags.append(tag)

        def handle_endtag(self, tag):
            assert open_tags.pop() == tag

        def handle_startendtag(self, tag, attrs):
            pass

    Checker().feed(page)
    assert open_tags == []
    assert page.count("<figure>") == len(figures) == 2


def test_figures_are_valid_svg_with_a_panel_for_each_metric_and_kind_of_road(found):
    plan, _, evaluated = found
    figures = figures_of(evaluated.summary, plan.conditions)
    assert figures == figures_of(evaluated.summary, plan.conditions)
    metrics = [named(name).removesuffix(" *paper*") for name in SHOWN]
    for figure, titles in zip(figures, (metrics, ["smooth-turn"]), strict=True):
        parts = ET.fromstring(figure.data).iter("{http://www.w3.org/2000/svg}text")
        texts = {"".join(part.itertext()) for part in parts}
        assert {*titles, *evaluated.summary.methods} <= texts


def test_a_run_without_any_row_still_has_a_report(found, tmp_path: Path):
    plan, record, _ = found
    folder = plan.folder(tmp_path / "out", resume=False)
    none = replace(scenes_of(plan.data, plan.limit), scenes=())
    run_evaluation(plan, none, folder, OneByOne())
    summary = summarise(folder.path / ROWS_NAME, NAMES, plan.conditions, 0)
    assert figures_of(summary, plan.conditions) == ()
    assert "Definitions" in report_of(plan, record, findings(summary), "x").markdown()
