"""The status chip's list of problems, without a browser."""

import pytest
from msgspec import to_builtins

from pd_editor.editor.commands import DuplicateAgents
from pd_editor.viewer.overlay.messages import StatusState
from pd_editor.viewer.state import finding_watch
from tests.analysis.findings.builders import finding
from tests.viewer.fake_browser import connected_tab, running_app


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    library = tmp_path_factory.mktemp("library")
    with running_app(library, "roundabout") as app, connected_tab(app) as found:
        yield found


def status(tab):
    """What the chip shows."""
    tab.run(tab.elements.chip.show)
    return tab.shown("status")


def test_a_study_that_runs_is_told_beside_what_is_known_of_the_scene(tab, monkeypatch):
    """Its progress was in a tab that is not open."""

    def told() -> str:
        return status(tab)["text"]

    study = tab.tab.workspace.study
    before = told()
    monkeypatch.setattr(study, "_job", object())
    study.fraction = 0.42
    assert told() == f"{before} \u00b7 study at 42%"
    monkeypatch.setattr(study, "_job", None)
    assert told() == before


def test_a_state_that_was_checked_is_known_when_it_is_back(tab, monkeypatch):
    """A quarter of the time of a switch between branches went into findings that were known."""
    session, watch = tab.session, tab.model.findings
    tab.run(watch.whole)
    before = watch.new, watch.notices, watch.recorded
    copied = DuplicateAgents(
        agent_ids=session.scenario.agents.ids[:1], new_ids=("again",), dx_m=0.4
    )
    tab.run(lambda: session.apply(copied))
    assert tab.run(watch.whole).new

    def fail(*_args, **_options):
        raise AssertionError("checked again")

    monkeypatch.setattr(finding_watch, "edit_findings", fail)
    tab.run(session.undo)
    assert (watch.new, watch.notices, watch.recorded) == before


@pytest.mark.parametrize(
    ("kinds", "tone"),
    [(["guidance-not-run"], "busy"), (["guidance-not-run", "collision"], "warn")],
)
def test_guidance_to_be_run_hides_no_collision(tab, monkeypatch, kinds, tone):
    """(A goal made the dot blue, whatever else was wrong.)"""
    found = [finding(kind, str(number)) for number, kind in enumerate(kinds)]
    monkeypatch.setattr(type(tab.model.findings), "new", tuple(found))
    assert status(tab)["tone"] == tone


@pytest.mark.parametrize(
    ("kinds", "title"),
    [
        (["near-pass"], "1 notice in the recording"),
        (["near-pass", "beyond-map"], "2 notices in the recording"),
        (["off-road", "near-pass"], "1 in the recording, 1 notice"),
        (["off-road"], "1 in the recording"),
    ],
)
def test_no_headline_says_nought_over_a_row(tab, monkeypatch, kinds, title):
    found = [finding(kind, str(number)) for number, kind in enumerate(kinds)]
    monkeypatch.setattr(type(tab.model.findings), "recorded", tuple(found))
    groups = status(tab)["groups"]
    assert [one["title"] for one in groups if one["name"] == "recorded"] == [title]


def test_a_row_never_offers_what_helps_against_another(tab, monkeypatch):
    """A press on such a button did nothing, or would have cured another problem."""
    session, chip, watch = tab.session, tab.elements.chip, tab.model.findings
    agents, now = session.scenario.agents, session.scenario.current_step
    ids = [
        n for n, there in zip(agents.ids, agents.is_valid[:, now], strict=True) if there
    ][:2]
    copy = DuplicateAgents(agent_ids=tuple(ids), new_ids=("copy-0", "copy-1"), dx_m=0.4)
    tab.run(lambda: session.apply(copy))
    tab.run(lambda: watch.check(with_future=True))
    first, second = (
        next(p for p in watch.new if name in p.agent_ids)
        for name in ("copy-0", "copy-1")
    )
    shown = []
    overlay = tab.ui.overlay
    real = overlay.show

    def show(state):
        if isinstance(state, StatusState):
            shown.append(to_builtins(state.active))
        real(state)

    monkeypatch.setattr(overlay, "show", show)
    for problem in (first, second):
        tab.run(lambda problem=problem: chip.choose("new", problem))
        tab.run(lambda: None)
    told = [active for active in shown if active is not None]
    for active in told:
        other = {"copy-0": "copy-1", "copy-1": "copy-0"}[
            "copy-0" if "copy-0" in active["id"] else "copy-1"
        ]
        assert not any(other in label for label in active["cures"]), active
        # All buttons come at once: one that is there already would move.
        assert bool(active["ignore"]) == bool(active["cures"])
    assert {"Remove copy-0", "Remove copy-1"} <= {
        label for active in told for label in active["cures"]
    }
