"""The study's chart and progress."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from pd_editor.experiments.evaluation.evaluation import FoundScenes, Scene
from pd_editor.experiments.evaluation.summary import Estimate
from pd_editor.experiments.studies.outcomes import SearchSettings, SeverityCurve
from pd_editor.experiments.studies.whole_study import WORK_ITEMS, StudyExtras
from pd_editor.experiments.work_engine.work_engine import WorkProgress
from pd_editor.viewer.state import study_run
from pd_editor.viewer.state.study_run import StudyRun
from pd_editor.viewer.study_panel import severity_svg
from tests.experiments.studies.test_study import grid_conditions, plan_for


def curve(method: str) -> SeverityCurve:
    value = np.array([0.1, 0.2])
    return SeverityCurve(
        method=method,
        kind="smooth-turn",
        anchor="focal",
        agents="movers",
        power=np.array([0.0, 3.0]),
        estimates={"collision": Estimate(value=value, low=value, high=value)},
        num_scenes=np.array([2, 2]),
    )


def test_a_method_keeps_its_colour_whichever_curves_are_there():
    """Colours went by the order of finishing, and changed places at the end."""
    one, other = curve("one"), curve("other")
    methods = ("one", "other")
    shown = [
        severity_svg(curves, methods, "collision", "Collisions")
        for curves in ((one, other), (other, one))
    ]
    assert shown[0] == shown[1]
    alone = severity_svg((other,), methods, "collision", "Collisions")
    assert '<span style="color:#d1600c;font-weight:700">\u2014</span> other' in alone


def test_the_progress_of_a_study_never_falls(monkeypatch, tmp_path: Path):
    """It reached 100 %, and was 0 % again with the search for the worst warps."""
    job = SimpleNamespace(start=lambda: None, rows=lambda: None)
    given: dict[str, Any] = {}
    monkeypatch.setattr(study_run, "StudyJob", lambda *_, **to: given.update(to) or job)
    monkeypatch.setattr(study_run, "severity_curves", lambda _: ())
    plan = plan_for(
        tmp_path,
        "ground-truth",
        conditions=grid_conditions(["smooth-turn"], [-6.0, 6.0]),
    )
    extras = StudyExtras(search=SearchSettings(num_trials=9))
    scenes = (Scene(folder=tmp_path / "one", split="train"),)
    study = StudyRun()
    study.start(
        plan,
        extras,
        FoundScenes(scenes=scenes, num_skipped=0),
        plan.folder(tmp_path / "out", resume=False),
    )
    seen = []
    for noun, done in (
        (WORK_ITEMS, 1),
        (WORK_ITEMS, 2),
        ("searches", 1),
        ("searches", 2),
    ):
        progress = WorkProgress(num_done=done, num_items=2, num_failed=0)
        given["on_progress"](noun, progress, 1.0)
        seen.append(study.fraction)
    assert seen == [0.125, 0.25, 0.625, 1.0]
