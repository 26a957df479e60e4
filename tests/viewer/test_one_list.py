"""All places of a screen that tell what is wrong read one list, and agree."""

import csv
import io
import json
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from pd_editor.analysis.findings.scorecard import TOTALS
from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.space import StayOnRoad
from pd_editor.analysis.guidance.kinds.speed import TargetSpeed
from pd_editor.base.errors import PdEditorError
from pd_editor.editor.commands import AddGuidance, SetRoadWarp, traffic_command
from pd_editor.editor.commands.locks import apply_within_locks
from pd_editor.editor.edit_findings import edit_findings, unrun_terms
from pd_editor.editor.library.index_table import index_csv
from pd_editor.editor.scenario_store import exported_files, made_by
from pd_editor.scene.av2_io.upload import scenario_from_upload
from pd_editor.scene.generation import GenerationRequest, run_to_end
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.viewer.generation.sample_strip import SampleCards, SampleSet, card_lines
from tests.editor.command_strategies import present_ids
from tests.editor.fake_generators import DriftGenerator
from tests.editor.random_edits import random_command
from tests.viewer.fake_browser import FakeTab, connected_tab, running_app

FAMILY = re.compile(r"^guidance")


def count_in(text: str) -> int:
    """The number before "problem" in a text; "no" is nought."""
    found = re.search(r"(\d+|[Nn]o)(?: new| open)? problem", text)
    assert found, text
    return int(found[1]) if found[1].isdigit() else 0


def random_edit(scenario, rng):
    """An edit of any kind: agents, road, guidance, generated traffic."""
    ids = present_ids(scenario)
    name = ids[rng.integers(len(ids))]
    which = rng.integers(6)
    if which == 0:
        term = WarpTerm(
            kind="double-turn", power=float(rng.integers(1, 11)), length_m=20.0
        )
        anchor = pose_of_anchor(scenario, "focal")
        return SetRoadWarp(warp=RoadWarp(anchor=anchor, terms=(term,)))
    if which == 1:
        x, y = scenario.agents.position_m[scenario.agents.row_of[name], -1]
        terms = (
            GoalPoint(agent_id=name, point_m=(float(x) + 9.0, float(y))),
            TargetSpeed(agent_ids=(name,), speed_mps=7.0),
            StayOnRoad(),
        )
        return AddGuidance(term=terms[rng.integers(len(terms))])
    if which in (2, 3):
        some = tuple(rng.choice(ids, size=min(3, len(ids)), replace=False).tolist())
        return drift(
            scenario, tuple(dict.fromkeys((name, *some))), int(rng.integers(99))
        )
    return random_command(scenario, rng)


def drift(scenario, ids, seed):
    request = GenerationRequest(scenario=scenario, agent_ids=ids, seed=seed)
    return traffic_command(request, run_to_end(DriftGenerator().generate(request)))


def settle(tab: FakeTab) -> None:
    """Let the page follow, as it does when edits pause."""

    def follow() -> None:
        tab.model.findings.check(with_future=True)
        tab.model.checked.emit()
        tab.elements.scorecard.show()

    tab.run(follow)


def contradictions(tab: FakeTab) -> list[str]:
    """Where two places of the page, the star, or a file differ; none is right."""
    session, workspace = tab.session, tab.tab.workspace
    scenario, commands = session.scenario, session.commands_in_force
    status = tab.shown("status")
    groups = {one["name"]: one for one in status["groups"]}
    keys = {
        name: [json.loads(row["id"]) for row in group["rows"]]
        for name, group in groups.items()
    }
    if any(group["more"] for group in groups.values()):
        return []
    new = keys["new"]
    wrong = []

    def same(what, one, other) -> None:
        if one != other:
            wrong.append(f"{what}: {one} and {other}")

    same("chip, list", count_in(status["text"]), len(new))
    preflight = tab.text()
    same("preflight, list", count_in(preflight), len(new))
    by_kind = Counter(kind for kind, *_ in new)
    for kind, words in (("run", "not run"), ("met", "not met")):
        told = re.search(rf"(\d+) guidance {words}", preflight)
        same(words, int(told[1]) if told else 0, by_kind[f"guidance-not-{kind}"])
    unrun = [one for one in new + keys["ignored"] if one[0] == "guidance-not-run"]
    awaiting = unrun_terms(scenario, session.commands_in_force)
    same("awaits a run", bool(unrun), bool(awaiting))

    marks = [one for one in tab.shown("timeline")["marks"] if one["kind"] == "problem"]
    step_s = scenario.time_axis.step_s
    told = {f"{one['step'] * step_s:.1f} s" for one in marks}
    same("timeline, list", told, {row["time"] for row in groups["new"]["rows"]} - {""})

    named = {name for _, ids, _ in new for name in ids}
    same("agent list, list", set(tab.model.findings.problem_ids()[0]), named)
    now = scenario.current_step
    for step in (now, now + 20):
        ringed = set(tab.model.findings.agents_at(step))
        same("rings, list", ringed - named, set())

    movers = scenario.agents.is_valid[:, now] & scenario.agents.is_in("movers")
    movers = {scenario.agents.ids[row] for row in np.flatnonzero(movers)}
    everything = [key for group in keys.values() for key in group]
    for row in tab.shown("scorecard")["rows"]:
        total = TOTALS.get(row["name"])
        if total is None or not movers:
            continue
        of_kind = {
            name for kind, ids, _ in everything if kind in total.kinds for name in ids
        }
        share = 100 * len(of_kind & movers) / len(movers)
        same(f"scorecard {row['name']}", row["value"], f"{share:.3g} %")

    if scenario.focal_id in scenario.agents.row_of:
        entry = workspace.save()
        same("star, list", dict(entry.row.problems), dict(sorted(by_kind.items())))
        (line,) = csv.DictReader(io.StringIO(index_csv([entry.row]).decode()))
        same("index.csv, list", int(line["num_problems"]), len(new))
        in_force = sum(term.is_on for term in scenario.guidance)
        same("terms in index.csv", len(entry.row.guidance), in_force)
        unmet = by_kind["guidance-not-run"] + sum(
            "not-met" in kind for kind, *_ in new + keys["ignored"]
        )
        if not keys["ignored"]:
            same("unmet terms", unmet >= 1, "guidance" in str(list(by_kind)))
        wrong += reopened(session, new + keys["ignored"])
    if commands and session.entries[-1].before is not None:
        wrong += card(tab, len(new))
    return wrong


def reopened(session, new) -> list[str]:
    """The same problems are new in the export, when it is opened again."""
    recipe = session.recipe()
    files = exported_files(session.scenario, recipe, session.base)
    again = scenario_from_upload(files)
    text = files["recipe.json"]
    export = made_by(again, type(recipe).from_text(text))
    if export is again:
        return []
    found = edit_findings(export, export, ()).problems
    mine = {str(list(one.key)) for one in found}
    theirs = {
        str([kind, tuple(ids), about])
        for kind, ids, about in new
        if not FAMILY.match(kind)
    }
    # Rounding to the file's centimetres may lift a finding over a limit or below it.
    differ = mine ^ theirs
    return [f"export, list: {differ}"] if len(differ) > 1 else []


def card(tab: FakeTab, num_problems: int) -> list[str]:
    """A card of the run that led here tells what the chip tells."""
    session = tab.session
    *done, last = session.commands_in_force
    if type(last).__name__ != "ReplaceTraffic":
        return []
    before = session.base
    for one in done:
        before = apply_within_locks(one, before)
    samples = SampleSet(
        before=before,
        base=session.base,
        done=tuple(done),
        samples=(last.sample,),
        commands=(last,),
    )
    cards = SampleCards.of(samples)
    ignored = tab.session.variant.ignored
    told = [one for one in cards.findings[0] if one.ignored_key not in ignored]
    text = card_lines(told, cards.numbers[0], "realism")[0].text
    found = count_in(text)
    return [] if found == num_problems else [f"card, list: {found}, {num_problems}"]


def walk(tab: FakeTab, seed: int, num_states: int) -> list[str]:
    """Random edits, undos and ignored problems; contradictions of each state."""
    rng, session, wrong = np.random.default_rng(seed), tab.session, []
    tab.run(lambda: tab.model.open_drawer("scorecard"))
    for number in range(num_states):
        if session.can_undo and rng.random() < 0.15:
            tab.run(session.undo)
        elif number:
            command = None
            try:
                command = random_edit(session.scenario, rng)
                tab.run(lambda one=command: session.apply(one))
            except PdEditorError:
                continue
        settle(tab)
        new = tab.model.findings.new
        if new and rng.random() < 0.2:
            one = new[rng.integers(len(new))]
            tab.run(lambda one=one: tab.model.findings.ignore(one, True))
            settle(tab)
        labels = [one.label for one in session.commands_in_force]
        wrong += [
            f"{labels[-3:]}: {one}" for one in tab.run(lambda: contradictions(tab))
        ]
    return wrong


@pytest.mark.parametrize(
    "demo", ["roundabout", pytest.param("downtown", marks=pytest.mark.slow)]
)
def test_no_two_places_differ(tmp_path, demo):
    with running_app(tmp_path, demo) as app, connected_tab(app) as tab:
        assert walk(tab, seed=3, num_states=12) == []


@pytest.mark.real_data
def test_no_two_places_differ_on_a_real_scene(tmp_path, av2_root):
    folder = sorted(path for path in (av2_root / "val").iterdir() if path.is_dir())[0]
    with running_app(tmp_path, str(folder)) as app, connected_tab(app) as tab:
        assert walk(tab, seed=5, num_states=6) == []


@pytest.mark.slow
@pytest.mark.real_data
def test_no_two_places_differ_in_500_states(tmp_path, av2_root):
    folders = sorted(path for path in av2_root.glob("[tv]*/*") if path.is_dir())[:20]
    wrong = []
    for number, folder in enumerate(folders):
        place = Path(tmp_path) / str(number)
        with running_app(place, str(folder)) as app, connected_tab(app) as tab:
            wrong += walk(tab, seed=number, num_states=25)
    assert wrong == []
