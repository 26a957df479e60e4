"""``--guide``: terms as texts and files, refusals, the table of outcomes, replays."""

import csv
import json
from pathlib import Path

import pytest

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.pairs import Threaten
from pd_editor.analysis.guidance.kinds.path import FollowLane, FollowPath
from pd_editor.analysis.guidance.kinds.space import AvoidCollisions
from pd_editor.analysis.guidance.kinds.speed import SpeedLimit, StopAtLine, TargetSpeed
from pd_editor.base.errors import GenerationError, InputError
from pd_editor.cli.generate import generate
from pd_editor.cli.options import field_names, guidance_terms_of
from pd_editor.editor.recipe import Recipe, replay
from pd_editor.editor.scenario_store import open_scenario

TEXTS = {
    "goal-point:agent=12,point=3.5/-10": GoalPoint(agent_id="12", point_m=(3.5, -10.0)),
    "goal-point:agent=12,point=3/1,at=4,weight=2": GoalPoint(
        agent_id="12", point_m=(3.0, 1.0), at_s=4.0, weight=2.0
    ),
    "target-speed:agents=12+13,speed=8": TargetSpeed(
        agent_ids=("12", "13"), speed_mps=8.0
    ),
    "speed-limit:speed=9.5": SpeedLimit(speed_mps=9.5),
    "stop-at-line:agent=12,line=3/1+3/5": StopAtLine(
        agent_id="12", line_m=((3.0, 1.0), (3.0, 5.0))
    ),
    "follow-path:agent=12,points=0/0+5/1+9/1": FollowPath(
        agent_id="12", points_m=((0.0, 0.0), (5.0, 1.0), (9.0, 1.0))
    ),
    "follow-path:agent=12,points=0/0+5/1+9/1,speeds=-+8+-,waits-for=-+-+13": FollowPath(
        agent_id="12",
        points_m=((0.0, 0.0), (5.0, 1.0), (9.0, 1.0)),
        speeds_mps=(None, 8.0, None),
        waits_for=(None, None, "13"),
    ),
    "follow-lane:agent=12,lanes=4+5": FollowLane(agent_id="12", lane_ids=(4, 5)),
    "avoid-collisions:side=left": AvoidCollisions(side="left"),
    "threaten:agent=12,other=13,approach=cut-in": Threaten(
        agent_id="12", other_id="13", approach="cut-in"
    ),
}


@pytest.mark.parametrize("text", TEXTS)
def test_texts_are_terms(text: str):
    assert guidance_terms_of((text,)) == (TEXTS[text],)


def test_every_field_of_every_kind_has_a_name():
    for kind in KINDS:
        assert all("_" not in name for name in field_names(kind))
    assert set(field_names("comfort-limits")) == {
        "weight",
        "agents",
        "max-acceleration",
        "max-braking",
        "max-lateral",
    }


def test_files_hold_lists_of_terms(tmp_path: Path):
    path = tmp_path / "terms.json"
    term = {"kind": "goal-point", "agent_id": "12", "point_m": [3.5, -10]}
    path.write_text(json.dumps([term, {"kind": "speed-limit", "speed_mps": 9.5}]))
    goal, limit = guidance_terms_of((str(path),))
    assert goal == TEXTS["goal-point:agent=12,point=3.5/-10"]
    assert limit == SpeedLimit(speed_mps=9.5)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("goalpoint:agent=1", "the nearest is goal-point"),
        ("xyz", "expected one of goal-point"),
        ("goal-point:agnt=1", "the nearest is agent"),
        ("goal-point:agent=1", "give point=X/Y as well"),
        ("goal-point:agent=1,point=3", "expected X/Y"),
        ("goal-point:agent=1,point=a/b", "'a'; expected a number"),
        ("goal-point:agent=1,point=nan/0", "finite"),
        ("goal-point:agent,point=1/2", "agent lacks its value; expected agent=ID"),
        ("goal-point:agent=1,agent=2,point=1/2", "given twice"),
        ("follow-lane:agent=1,lanes=x", "whole number"),
        ("stop-at-line:agent=1,line=3/1", r"expected 2 points, X/Y\+X/Y"),
        ("target-speed:speed=999", "expected 0 to 60"),
        ("threaten:agent=1,other=2,approach=up", "one of rear"),
        ("missing.json", "missing.json"),
    ],
)
def test_wrong_texts_are_refused_in_one_sentence(text: str, said: str):
    with pytest.raises(InputError, match=said) as caught:
        guidance_terms_of((text,))
    assert "\n" not in str(caught.value)


def test_a_guided_run_tells_what_was_achieved_and_replays_with_its_terms(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    outcome = generate(
        "roundabout",
        out=tmp_path,
        guide=("goal-point:agent=car-0012,point=-40/1", "speed-limit:speed=30"),
        agents=("car-0012", "AV"),
    )
    lines = [line for line in outcome.remarks if "goal point of agent car-0012" in line]
    assert len(lines) == 1
    assert "asked at (-40.0, 1.0) m" in lines[0]
    (path,) = tmp_path.glob("*-guidance.csv")
    with path.open() as file:
        rows = list(csv.DictReader(file))
    assert rows[0]["what"] == "goal point of agent car-0012"
    assert rows[0]["obeyed"] == "yes"
    assert float(rows[0]["error"]) < 1.0
    recipe = Recipe.from_text((outcome.folder / "recipe.json").read_text())
    again = replay(recipe, open_scenario("roundabout"))
    assert again.guidance == outcome.scenario.guidance
    assert len(again.guidance) == 2
    assert capsys.readouterr().err.count("goal") == 0


def test_doubtful_terms_are_told_before_the_run_and_impossible_ones_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    far = "goal-point:agent=car-0012,point=-300/0"
    generate("roundabout", out=tmp_path, guide=far, agents=("car-0012",))
    assert "car-0012" in capsys.readouterr().err
    left_out = "goal-point:agent=AV,point=0/0"
    generate("roundabout", out=tmp_path, name="b", guide=left_out, agents=("car-0012",))
    assert "is not regenerated" in capsys.readouterr().err
    replaced = "goal-point:agent=car-0073,point=0/0"
    with pytest.raises(GenerationError, match="car-0073 is gone"):
        generate("roundabout", out=tmp_path, name="c", num_agents="3", guide=replaced)
