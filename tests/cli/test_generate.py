import csv
import json
from pathlib import Path

import numpy as np
import pytest

from pd_editor.base.errors import GenerationError
from pd_editor.cli.generate import generate
from pd_editor.editor.commands import SampleSignals
from pd_editor.editor.recipe import Recipe, replay
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.generation import generators as registry
from pd_editor.scene.agent_kind import ROAD_USER_KINDS, Activity, AgentKind
from pd_editor.scene.generation import (
    CAPABILITIES,
    LANE_GUIDANCE,
    GeneratorSpec,
    Region,
)
from pd_editor.scene.locks import STATE_LOCK, TRAJECTORY_LOCK, Lock
from pd_editor.scene.roles.traffic_choice import agent_ids_of_kinds, drivable_agent_ids
from pd_editor.scene.scenario import EGO_ID
from tests.cli.shell import JUNCTION, Shell, files_of
from tests.editor.fake_generators import PlacingGenerator


def test_the_same_seed_gives_the_same_files(shell: Shell, tmp_path: Path):
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        result = shell.run(
            "generate",
            JUNCTION,
            "--seed",
            seed,
            "--name",
            "x",
            "--out",
            tmp_path / name,
        )
        # A slow machine is told of progress on stderr.
        assert result.code == 0, result.err
        assert result.lines[0] == str(tmp_path / name / "x")
    first, again, other = (files_of(tmp_path / name / "x") for name in "abc")
    assert first == again
    tracks = "scenario_x.parquet"
    assert first[tracks] != other[tracks]


def test_states_and_pasts_are_kept(tmp_path: Path):
    done = generate(JUNCTION, out=tmp_path)
    before, after = open_scenario(JUNCTION), open_scenario(done.folder)
    now = before.current_step
    np.testing.assert_allclose(
        after.agents.position_m[:, : now + 1],
        before.agents.position_m[:, : now + 1],
        atol=1e-3,
    )
    assert np.abs(after.agents.position_m - before.agents.position_m).max() > 1


def test_samples_get_folders_of_their_own(shell: Shell, tmp_path: Path):
    result = shell.run("generate", JUNCTION, "--samples", 2, "--out", tmp_path)
    folders = [tmp_path / f"{JUNCTION}-s0-1", tmp_path / f"{JUNCTION}-s0-2"]
    assert result.lines[:2] == [str(folder) for folder in folders]
    table = tmp_path / f"{JUNCTION}-s0-samples.csv"
    assert sorted(tmp_path.iterdir()) == [*folders, table]
    one, two = (open_scenario(folder).agents.position_m for folder in folders)
    assert not np.array_equal(one, two)
    (alone,) = generate(JUNCTION, out=tmp_path / "alone").scenarios
    np.testing.assert_allclose(one, alone.agents.position_m, atol=1e-3)


def test_samples_are_ranked_in_a_table_and_the_most_diverse_are_written(
    shell: Shell, tmp_path: Path
):
    options = ("--samples", 3, "--rank", "movement", "--pick", 2)
    result = shell.run("generate", JUNCTION, *options, "--out", tmp_path)
    with (tmp_path / f"{JUNCTION}-s0-samples.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["rank"] for row in rows] == ["1", "2", "3"]
    moved = [float(row["moving"]) * float(row["speed_mps"]) for row in rows]
    assert moved == sorted(moved, reverse=True)
    picked = {row["sample"] for row in rows if row["picked"] == "yes"}
    assert len(picked) == 2
    assert rows[0]["sample"] in picked
    assert {path.name for path in tmp_path.iterdir() if path.is_dir()} == picked
    assert result.lines[2].split()[:3] == ["rank", "sample", "agents"]
    assert result.lines[3].split()[:2] == ["1", rows[0]["sample"]]
    refused = shell.refused(
        "generate", JUNCTION, "--samples", 3, "--pick", 4, "--out", tmp_path
    )
    assert "--pick is 4; expected 1 to 3" in refused


def test_only_the_named_agents_are_driven(shell: Shell, tmp_path: Path):
    before = open_scenario(JUNCTION)
    options = ("--agents", "AV", "AV", "--model", "lane-follower")
    result = shell.run("generate", JUNCTION, *options, "--out", tmp_path)
    assert result.code == 0
    after = open_scenario(tmp_path / f"{JUNCTION}-s0")
    others = [row for row, name in enumerate(before.agents.ids) if name != "AV"]
    np.testing.assert_allclose(
        after.agents.position_m[others], before.agents.position_m[others], atol=1e-3
    )
    recipe = json.loads((tmp_path / f"{JUNCTION}-s0" / "recipe.json").read_text())
    (entry,) = recipe["commands"]
    assert (entry["seed"], entry["generator"]) == (0, "lane-follower")
    assert entry["request"]["agent_ids"] == ["AV"]


@pytest.mark.parametrize("asked", [3, "3", ("vehicle=1", "2")])
def test_a_number_of_agents_may_be_a_number(tmp_path: Path, asked):
    """An int gave a TypeError in Python."""
    (made,) = generate(JUNCTION, out=tmp_path, num_agents=asked, add=True).scenarios
    assert len(made.agents) == len(open_scenario(JUNCTION).agents) + 3
    with pytest.raises(GenerationError, match="no agent to generate"):
        generate(JUNCTION, out=tmp_path / "none", num_agents=0)


def test_one_agent_may_be_named_without_a_list(tmp_path: Path):
    (made,) = generate(JUNCTION, out=tmp_path, agents="AV", lock="AV=1.0").scenarios
    assert list(made.locks) == ["AV"]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("--samples 0", "The number of samples is 0; expected 1 to 1000."),
        ("--seed -1", "The seed is -1; expected 0 to"),
        ("--model crystal-ball", "There is no generator 'crystal-ball'"),
        ("--agents missing", "There is no agent 'missing' here; expected one of "),
        ("--num-agents 3 --model lane-follower", "lane-follower adds no agents"),
        ("--num-agents three", "neither a number, nor KIND=NUMBER"),
        ("--num-agents dragon=3", "a kind out of bus, cyclist, motorcyclist"),
        ("--num-agents fit 3", "'fit' is neither a number"),
        ("--num-agents 3 --resample-states", "give one of them"),
        ("--num-agents 3 --agents AV", "give --add to keep them"),
        (f"--samples {10**21}", f"samples is {10**21}; expected 1 to 1000."),
        (f"--steps {10**21}", f"steps is {10**21}; expected 1 to 1000."),
        (f"--tries {10**21}", "tries is 1e+21; expected a whole number from 0 to 64."),
        (f"--num-agents {10**21}", "is neither a number"),
        ("--num-agents 600", "The number of new agents is 600; expected 0 to 500."),
        ("--samples 1000 --tries 64", "at most 50000 are sampled at once."),
        ("--region 0 0 0", "expected more than 0 and at most 5000 m."),
        ("--add", "--add needs --num-agents"),
        ("--replace-ego-and-focal", "needs --num-agents without --add"),
        ("--keep-to-lanes 3", "must be between 0 and 1"),
        (
            "--tries -1",
            "The number of tries is -1; expected a whole number from 0 to 64.",
        ),
        ("--moving-share 0.5", "--num-agents or --resample-states"),
        ("--num-agents 3 --moving-share 3", "must be between 0 and 1, not 3."),
    ],
)
def test_impossible_requests_are_refused(
    shell: Shell, tmp_path: Path, options: str, sentence: str
):
    command = ("generate", JUNCTION, "--out", tmp_path / "out", *options.split())
    assert sentence in shell.refused(*command)
    assert not (tmp_path / "out").exists()


def test_a_taken_place_is_refused_before_anything_is_written(
    shell: Shell, tmp_path: Path
):
    taken = tmp_path / f"{JUNCTION}-s0-2"
    taken.mkdir()
    (taken / "recipe.json").write_text("{}")
    (taken / "thesis.txt").write_text("precious")
    command = ("generate", JUNCTION, "--samples", 2, "--out", tmp_path)
    assert "already holds files" in shell.refused(*command)
    assert "'thesis.txt'" in shell.refused(*command, "--overwrite")
    assert [path.name for path in tmp_path.iterdir()] == [taken.name]


@pytest.mark.real_data
def test_who_cannot_be_driven_is_said(av2_scenario_folders: list[Path], tmp_path: Path):
    for folder in av2_scenario_folders:
        scenario = open_scenario(folder)
        if not scenario.agents.is_valid[:, -1].any():
            continue
        there = scenario.agents.is_valid[:, scenario.current_step]
        things = [
            name
            for name, kind in zip(
                scenario.agents.ids, scenario.agents.kinds, strict=True
            )
            if kind.value in ("static", "construction", "background")
        ]
        gone = [scenario.agents.ids[row] for row in np.flatnonzero(~there)]
        if things and gone:
            break
    else:
        pytest.fail("no scenario has such agents")
    names = (scenario.focal_id, things[0], gone[0])
    done = generate(folder, agents=names, out=tmp_path)
    assert f"Agent {things[0]} keeps its trajectory" in done.remarks[0]
    assert f"Agent {gone[0]} keeps its trajectory" in done.remarks[1]


@pytest.fixture
def placing(monkeypatch: pytest.MonkeyPatch) -> PlacingGenerator:
    generator = PlacingGenerator()
    offer = GeneratorSpec(make=lambda: generator, supports=CAPABILITIES)
    monkeypatch.setattr(registry, "GENERATORS", {"placing": offer})
    return generator


def test_new_agents_take_the_place_of_all_but_ego_and_focal_agent(
    shell: Shell, tmp_path: Path, placing: PlacingGenerator
):
    """As in the browser, which keeps both; before, an export had neither."""
    before = open_scenario(JUNCTION)
    counts = ("--num-agents", 2, "pedestrian=1", "--model", "placing")
    result = shell.run("generate", JUNCTION, *counts, "--out", tmp_path)
    assert result.code == 0
    (request,) = placing.requests
    assert request.num_new_agents == {AgentKind.VEHICLE: 2, AgentKind.PEDESTRIAN: 1}
    after = open_scenario(tmp_path / f"{JUNCTION}-s0")
    assert after.focal_id == before.focal_id
    users = after.agents.kind_mask(ROAD_USER_KINDS)
    assert users.sum() == 5
    for name in (before.focal_id, EGO_ID):
        np.testing.assert_allclose(
            after.agents.position_m[after.agents.row_of[name]],
            before.agents.position_m[before.agents.row_of[name]],
            atol=1e-3,
        )


def test_new_agents_replace_ego_and_focal_agent_if_told(
    shell: Shell, tmp_path: Path, placing: PlacingGenerator
):
    counts = ("--num-agents", 2, "pedestrian=1", "--model", "placing")
    result = shell.run(
        "generate", JUNCTION, *counts, "--replace-ego-and-focal", "--out", tmp_path
    )
    assert result.code == 0
    written = open_scenario(tmp_path / f"{JUNCTION}-s0")
    assert written.agents.kind_mask(ROAD_USER_KINDS).sum() == 3
    assert EGO_ID not in written.agents.ids
    assert written.focal_id in written.agents.ids


def test_new_agents_may_join_those_that_stay(tmp_path: Path, placing: PlacingGenerator):
    before = open_scenario(JUNCTION)
    done = generate(
        JUNCTION, out=tmp_path, num_agents=("2",), add=True, model="placing", steps=5
    )
    (request,) = placing.requests
    assert request.num_denoising_steps == 5
    assert len(done.scenarios[0].agents) == len(before.agents) + 2


def test_states_of_named_agents_are_redrawn_in_a_region(
    tmp_path: Path, placing: PlacingGenerator
):
    generate(
        JUNCTION,
        out=tmp_path,
        agents=("AV",),
        resample_states=True,
        region=(1.0, 2.0, 30.0),
        moving_share=0.5,
        only_on_road=True,
        keep_to_lanes=0.25,
        model="placing",
    )
    (request,) = placing.requests
    assert request.agent_ids == request.resampled_state_ids == ("AV",)
    assert request.region == Region(center_m=(1.0, 2.0), half_side_m=30.0)
    assert (request.moving_share, request.only_on_road) == (0.5, True)
    (term,) = request.guidance
    assert (term.name, term.weight) == (LANE_GUIDANCE, 0.25)


def test_new_agents_replace_those_in_the_region_alone(
    tmp_path: Path, placing: PlacingGenerator
):
    before = open_scenario(JUNCTION)
    place = before.agents.position_m[
        before.agents.row_of[before.focal_id], before.current_step
    ]
    generate(
        JUNCTION,
        out=tmp_path,
        num_agents="2",
        region=(float(place[0]), float(place[1]), 15.0),
        model="placing",
    )
    (request,) = placing.requests
    assert request.region is not None
    inside = set(request.region.held(before, before.agents.ids))
    gone = set(before.agents.ids) - set(request.scenario.agents.ids)
    users = {
        name
        for name, kind in zip(before.agents.ids, before.agents.kinds, strict=True)
        if kind in ROAD_USER_KINDS
    }
    assert gone == (inside & users) - {before.focal_id, EGO_ID}
    assert gone
    assert len(before.agents) - len(gone) > 10


def test_activities_are_known_to_the_model_and_kept(
    shell: Shell, tmp_path: Path, placing: PlacingGenerator
):
    before = open_scenario(JUNCTION)
    speed = before.agents.speed_mps()[:, before.current_step]
    there = before.agents.is_valid[:, before.current_step]
    users = before.agents.kind_mask(ROAD_USER_KINDS) & there
    parked, waiting = (
        before.agents.ids[row] for row in np.flatnonzero(users & (speed < 0.1))[:2]
    )
    moving = before.agents.ids[np.flatnonzero(users & (speed > 3))[0]]
    done = generate(
        JUNCTION, out=tmp_path, parked=(parked,), waiting=(waiting,), model="placing"
    )
    (request,) = placing.requests
    for scenario in (request.scenario, open_scenario(done.folders[0])):
        rows = scenario.agents.rows((parked, waiting))
        assert scenario.activity()[rows].tolist() == [Activity.PARKED, Activity.WAITING]
    recipe = Recipe.from_text((done.folders[0] / "recipe.json").read_bytes())
    again = replay(recipe, before)
    assert again.activity()[again.agents.row_of[parked]] == Activity.PARKED
    for options, sentence in (
        ((parked, "--waiting", parked), "named by --parked and by --waiting"),
        ((moving,), "cannot be parked at"),
        (("missing",), "There is no agent 'missing' here; expected one of "),
    ):
        out = ("--model", "placing", "--out", tmp_path / "other")
        assert sentence in shell.refused(
            "generate", JUNCTION, "--parked", *options, *out
        )


def test_sampled_signals_stand_in_the_recipe_and_come_again(tmp_path: Path):
    done = generate(JUNCTION, out=tmp_path, sample_signals=True, seed=4)
    assert done.scenarios[0].signals
    recipe = Recipe.from_text((done.folder / "recipe.json").read_text())
    assert SampleSignals(seed=4) in recipe.commands
    again = replay(recipe, open_scenario(JUNCTION)).signals
    states = [one.states.tolist() for one in done.scenarios[0].signals]
    assert [one.states.tolist() for one in again] == states


def test_as_many_as_suit_the_road_is_the_models_choice(
    tmp_path: Path, placing: PlacingGenerator
):
    generate(JUNCTION, out=tmp_path, num_agents="fit", model="placing")
    (request,) = placing.requests
    assert request.samples_num_agents
    assert not request.num_new_agents


def test_a_region_may_be_given_in_the_frame_of_the_city(
    tmp_path: Path, placing: PlacingGenerator
):
    scenario = open_scenario(JUNCTION)
    x, y = (scenario.origin_city_m + np.array([1.0, 2.0])).tolist()
    for region in ((1.0, 2.0, 30.0), (x, y, 30.0)):
        generate(
            JUNCTION,
            out=tmp_path,
            num_agents=("2",),
            region=region,
            quality="high",
            model="placing",
            overwrite=True,
        )
    scene, city = placing.requests
    assert scene.quality == city.quality == "high"
    assert city.region is not None
    assert scene.region is not None
    assert np.allclose(city.region.center_m, scene.region.center_m)
    assert city.region.half_side_m == 30.0
    with pytest.raises(
        GenerationError,
        match=r"no road within 30 m of \(9000, 0\); roads lie at x from .* in the frame "
        r"of the scene or x from .* in the frame of the city\.",
    ):
        generate(
            JUNCTION,
            out=tmp_path,
            num_agents=("2",),
            region=(9000.0, 0.0, 30.0),
            model="placing",
        )


def test_locked_agents_are_kept_and_stand_in_the_recipe(shell: Shell, tmp_path: Path):
    before = open_scenario(JUNCTION)
    held, some, still = (drivable_agent_ids(before)[place] for place in (0, 1, 2))
    locks = ("--lock", f"{held}=trajectory", f"{some}=2.5", f"{still}=state")
    result = shell.run(
        "generate", JUNCTION, *locks, "--resample-states", "--out", tmp_path
    )
    assert result.code == 0, result.err
    assert "3 agents are locked and kept." in result.out
    folder = tmp_path / f"{JUNCTION}-s0"
    recipe = Recipe.from_text((folder / "recipe.json").read_text())
    again = replay(recipe, before)
    assert again.locks == {
        held: TRAJECTORY_LOCK,
        some: Lock(kept_s=2.5),
        still: STATE_LOCK,
    }
    old, new, now = before.agents, again.agents, before.current_step
    for name, steps in (
        (held, slice(None)),
        (some, slice(now, now + 26)),
        (still, slice(now, now + 1)),
    ):
        for field in ("position_m", "heading_rad", "velocity_mps", "is_valid"):
            one = getattr(old, field)[old.row_of[name], steps]
            two = getattr(new, field)[new.row_of[name], steps]
            assert one.tobytes() == two.tobytes(), (name, field)
    free = [name for name in drivable_agent_ids(before) if name not in again.locks]
    rows, others = old.rows(free), new.rows(free)
    moved = np.abs(old.position_m[rows, now] - new.position_m[others, now])
    assert moved.max() > 1


def test_only_some_kinds_are_regenerated(tmp_path: Path):
    before = open_scenario(JUNCTION)
    ids = drivable_agent_ids(before)
    kind = str(before.agents.kinds[before.agents.row_of[ids[0]]])
    done = generate(JUNCTION, only_kinds=(kind,), out=tmp_path)
    entry = json.loads((done.folder / "recipe.json").read_text())["commands"][0]
    wanted = agent_ids_of_kinds(before, ids, {AgentKind(kind)})
    assert tuple(entry["request"]["agent_ids"]) == wanted


def test_only_agents_in_a_region_are_regenerated(tmp_path: Path):
    before = open_scenario(JUNCTION)
    ids = drivable_agent_ids(before)
    place = before.agents.position_m[before.agents.row_of[ids[0]], before.current_step]
    region = (float(place[0]), float(place[1]), 15.0)
    done = generate(JUNCTION, region=region, out=tmp_path)
    entry = json.loads((done.folder / "recipe.json").read_text())["commands"][0]
    held = Region(center_m=region[:2], half_side_m=15.0).held(before, ids)
    assert 0 < len(held) < len(ids)
    assert tuple(entry["request"]["agent_ids"]) == held


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--lock", "AV"), "is not ID=WHAT"),
        (("--lock", "AV=-1"), "is not ID=WHAT"),
        (("--lock", "AV=nan"), "is not ID=WHAT"),
        (("--lock", "ghost=state"), "no agent 'ghost'"),
        (("--only-kinds", "tram"), "'tram' is not a kind"),
        (("--only-kinds", "bus", "--agents", "AV"), "of the kinds bus"),
        (("--agents", "AV", "--lock", "AV=trajectory"), "are locked"),
        (
            ("--agents", "AV", "--resample-states", "--lock", "AV=state"),
            "states of all these agents are locked",
        ),
    ],
)
def test_bad_locks_and_kinds_are_refused_in_words(
    shell: Shell, tmp_path: Path, options: tuple[str, ...], sentence: str
):
    result = shell.run("generate", JUNCTION, *options, "--out", tmp_path / "out")
    assert result.code == 2
    assert sentence in result.err
    assert not (tmp_path / "out").exists()


def test_what_a_generator_cannot_do_is_refused_before_it_runs(
    shell: Shell, tmp_path: Path
):
    """Nothing is asked of it silently: neither states, new agents nor guidance."""
    drift = ("generate", JUNCTION, "--model", "examples.drift_generator:DriftGenerator")
    goal = f"target-speed:agents={open_scenario(JUNCTION).focal_id},speed=8"
    for options, sentence in (
        (("--resample-states",), "drift samples no initial states"),
        (("--num-agents", 3), "drift adds no agents"),
        (("--guide", goal), "--guide: the generator drift takes no guidance"),
    ):
        assert sentence in shell.refused(*drift, *options, "--out", tmp_path / "out")
    told = shell.refused(
        *drift[:2], "--model", "lane-folower", "--out", tmp_path / "out"
    )
    assert "There is no generator 'lane-folower'; the nearest is lane-follower" in told
    assert not (tmp_path / "out").exists()
