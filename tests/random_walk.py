"""Random editor commands over several scenarios, and what must hold afterwards."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pd_editor.base.errors import PdEditorError
from pd_editor.base.plain_text import is_plain
from pd_editor.cli.replay import read_recipe
from pd_editor.editor.commands import (
    Command,
    PlaceAgent,
    RemoveAllAgents,
    SetAgentActivity,
    SetAgentKind,
    SetAgentSize,
    SetFocalAgent,
    SetRoadWarp,
    SnapToLane,
    TransformAgents,
    new_agent_id,
    traffic_command,
)
from pd_editor.editor.recipe import replay
from pd_editor.editor.scenario_store import (
    exported_files,
    has_same_content,
    open_scenario,
)
from pd_editor.editor.session import EditorSession
from pd_editor.editor.unfinished_work import find_unfinished, restore
from pd_editor.editor.variant import Variant, name_from_text
from pd_editor.scene.agent_kind import Activity, AgentCategory, AgentKind
from pd_editor.scene.av2_io.write import check_with_official_loaders
from pd_editor.scene.bundle import write_files
from pd_editor.scene.generation import GenerationRequest, run_to_end
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.road_warp import WARP_KINDS, RoadWarp, WarpTerm
from pd_editor.scene.roles.traffic_choice import replaceable_agent_ids
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.state.workspace import Workspace
from tests.editor.command_strategies import present_ids
from tests.editor.fake_generators import DriftGenerator, PlacingGenerator
from tests.editor.random_edits import random_command
from tests.editor.same_scenario import same_scenario


@dataclass(kw_only=True)
class WalkCounts:
    """What a walk has done."""

    commands: int = 0
    refused: int = 0
    """Commands that made no sense where they came, told in a sentence."""
    moves: int = 0
    """Undo, redo, jumps and switches of branches."""
    switches: int = 0
    checked: int = 0
    """Scenarios that were undone to the start, replayed, exported and read back."""


def walk(
    workspace: Workspace,
    folders: Sequence[Path],
    rng: np.random.Generator,
    num_commands: int,
    out: Path,
) -> WalkCounts:
    """Edit the scenarios in turn, then check every one of them."""
    counts = WalkCounts()
    session = workspace.session
    while counts.commands < num_commands:
        workspace.open_reference(str(folders[rng.integers(len(folders))]))
        counts.switches += 1
        for _ in range(int(rng.integers(5, 30))):
            if counts.commands >= num_commands:
                break
            counts.commands += 1
            try:
                if rng.random() < 0.05:
                    session.describe(_variant(rng))
                    continue
                session.apply(_command(session.scenario, rng))
            except PdEditorError:
                counts.refused += 1
            check_focal(session.scenario)
            if rng.random() < 0.15:
                counts.moves += 1
                if rng.random() < 0.3:
                    session.go_to(
                        int(rng.choice([one.number for one in session.branches]))
                    )
                else:
                    session.jump_to(int(rng.integers(len(session.entries) + 1)))
                check_focal(session.scenario)
    for folder in folders:
        workspace.open_reference(str(folder))
        check(workspace, out)
        check_journal(session, out / "journals")
        counts.checked += 1
    return counts


def check_focal(scenario: Scenario) -> None:
    """Exactly one focal agent, unless the road is bare."""
    agents = scenario.agents
    focal = [
        name
        for name, category in zip(agents.ids, agents.categories, strict=True)
        if category is AgentCategory.FOCAL
    ]
    assert focal == ([scenario.focal_id] if len(agents) else [])
    assert not scenario.retired_ids & set(agents.ids)


def check(workspace: Workspace, out: Path) -> None:
    """Undo to the start is exact, replay and export lead to the same."""
    session = workspace.session
    position, last = session.state.position, session.scenario
    session.jump_to(0)
    assert session.scenario is session.base
    session.jump_to(position)
    assert session.scenario is last
    recipe = session.recipe()
    assert same_scenario(replay(recipe, session.base), last)
    if not len(last.agents):
        return
    target = out / recipe.result_id
    write_files(exported_files(last, recipe), target, forbidden=None, overwrite=True)
    check_with_official_loaders(target)
    assert read_recipe(target)[0].variant == recipe.variant
    again = open_scenario(target)
    check_focal(again)
    # A track without any step is not written.
    written = np.flatnonzero(last.agents.is_valid.any(axis=1))
    order = again.agents.rows(last.agents.ids[row] for row in written)
    assert has_same_content(
        again.with_agents(again.agents.taken(order)),
        last.with_agents(last.agents.taken(written)),
    )


def check_journal(session: EditorSession, folder: Path) -> None:
    """What stands on disk comes back as the session is."""
    if session.journal_path is None:
        return
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    shutil.copy(session.journal_path, folder)
    (work,) = find_unfinished(folder)
    back = restore(work, session.base)
    assert not back.lost_edits
    assert same_scenario(back.scenario, session.scenario)
    assert back.state.position == session.state.position
    assert back.commands_in_force == session.commands_in_force
    assert back.variant == session.variant
    for one, other in zip(back.branches, session.branches, strict=True):
        assert (one.number, one.variant) == (other.number, other.variant)
        assert same_scenario(one.scenario, other.scenario)
    back.close()


def any_text(rng: np.random.Generator) -> str:
    """A text of all of Unicode, most of it of characters that make trouble."""
    odd = "\x00\n\t\r\x7f\x85\u2028\u200b\u202e\ufeff\ud800\udfff\ufffe\U0010ffff'\"\\/:%{}<&é漢🚗"
    many = [chr(one) for one in rng.integers(32, 0x110000, 8)]
    letters = [*odd, *many, *"abc 019_-."]
    count = int(rng.choice([0, 1, 3, 20, 255, 300]))
    spoiled = "".join(rng.choice(letters, count)) if count else ""
    # Most are kept only without what no text may have.
    return spoiled if rng.random() < 0.3 else "".join(filter(is_plain, spoiled))


def _variant(rng: np.random.Generator) -> Variant:
    texts = [any_text(rng) for _ in range(4)]
    name = name_from_text(texts[0]) if rng.random() < 0.7 else texts[0]
    return Variant(name=name, tags=tuple(texts[1:3]), note=texts[3])


def _far(rng: np.random.Generator) -> float:
    """A coordinate: near, far, or beyond what a scene may have."""
    return float(rng.choice([1.0, 1e2, 1e3, 1e4, 1e7]) * rng.normal())


def _placed(scenario: Scenario, rng: np.random.Generator) -> Command:
    return PlaceAgent(
        agent_id=any_text(rng) or new_agent_id(scenario),
        kind=AgentKind.VEHICLE,
        x_m=_far(rng),
        y_m=_far(rng),
        heading_rad=_far(rng),
        speed_mps=float(rng.uniform(0, 70)),
    )


def _command(scenario: Scenario, rng: np.random.Generator) -> Command:
    ids = present_ids(scenario)
    chance = rng.random()
    if not ids or chance < 0.02:
        return _resampled(scenario, rng)
    name = ids[rng.integers(len(ids))]
    if chance < 0.025:
        return RemoveAllAgents()
    if chance < 0.10:
        return _warp(rng)
    if chance < 0.14:
        request = GenerationRequest(
            scenario=scenario, agent_ids=(name,), seed=int(rng.integers(1000))
        )
        return traffic_command(request, run_to_end(DriftGenerator().generate(request)))
    if chance < 0.18:
        return SetFocalAgent(agent_id=name)
    if chance < 0.22:
        kinds = list(AgentKind)
        return SetAgentKind(agent_ids=(name,), kind=kinds[rng.integers(len(kinds))])
    if chance < 0.26:
        length, width = rng.uniform(0.1, 31, 2)
        return SetAgentSize(agent_ids=(name,), length_m=length, width_m=width)
    if chance < 0.30:
        return SnapToLane(agent_ids=(name,))
    if chance < 0.31:
        return TransformAgents(agent_ids=(name,), dx_m=_far(rng), dy_m=_far(rng))
    if chance < 0.34:
        return _placed(scenario, rng)
    if chance < 0.37:
        activity = list(Activity)[rng.integers(len(Activity))]
        return SetAgentActivity(agent_ids=(name,), activity=activity)
    return random_command(scenario, rng)


def _warp(rng: np.random.Generator) -> Command:
    if rng.random() < 0.3:
        return SetRoadWarp(warp=None, friction_coefficient=None)
    term = WarpTerm(
        kind=WARP_KINDS[rng.integers(len(WARP_KINDS))],
        power=float(rng.uniform(-10, 10)),
        length_m=float(rng.choice([0.5, 2.0, 10.0, 60.0, 500.0]) * rng.uniform(1, 2)),
        border_m=float(rng.choice([0.0, 0.0, 5.0, 100.0])),
    )
    x, y = rng.uniform(-20, 20, 2) * rng.choice([1.0, 1.0, 10.0, 1e4])
    anchor = RigidMotion(x_m=x, y_m=y, rotation_rad=float(rng.uniform(-3, 3)))
    friction = float(rng.uniform(0.2, 1.0)) if rng.random() < 0.3 else None
    return SetRoadWarp(
        warp=RoadWarp(anchor=anchor, terms=(term,)), friction_coefficient=friction
    )


def _resampled(scenario: Scenario, rng: np.random.Generator) -> Command:
    keeps = bool(rng.random() < 0.5)
    removed = replaceable_agent_ids(scenario, keeps_ego=keeps, keeps_focal=keeps)
    request = GenerationRequest(
        scenario=scenario.without_agents(removed),
        agent_ids=(),
        num_new_agents={AgentKind.VEHICLE: int(rng.integers(1, 9))},
        seed=int(rng.integers(1000)),
    )
    traffic = run_to_end(PlacingGenerator().generate(request))
    return traffic_command(request, traffic, removed_ids=removed)
