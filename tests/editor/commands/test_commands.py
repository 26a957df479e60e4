"""Laws that hold for every command."""

import inspect
import json

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pd_editor.base.errors import EditError, RecipeError
from pd_editor.editor.commands import (
    COMMANDS,
    BeginAt,
    Command,
    ContinueScene,
    ReplaceTraffic,
    SetRoadWarp,
    command_from_json,
    command_to_json,
)
from pd_editor.editor.session import EditorSession
from pd_editor.scene.scenario import Scenario
from tests.editor.command_strategies import (
    STRATEGIES,
    busy_scenario,
    ignore_random_checks,
)
from tests.editor.same_scenario import same_scenario

pytestmark = ignore_random_checks
BASE = busy_scenario()
EVERY = pytest.mark.parametrize("kind", COMMANDS.values(), ids=COMMANDS.keys())
SOME = settings(max_examples=12, deadline=None)


def drawn(data: st.DataObject, kind: type[Command]) -> tuple[Command, Scenario]:
    """A command that applies to the busy scenario, and what it makes of it."""
    command = data.draw(STRATEGIES[kind](BASE))
    try:
        return command, command.apply(BASE)
    except EditError:
        assume(False)
        raise


def test_every_command_is_registered_and_drawn():
    def leaves(cls: type) -> set[type]:
        below = cls.__subclasses__()
        return set().union(*map(leaves, below)) if below else {cls}

    # Slotted or hooked classes may leave twins; names identify them.
    names = {cls.__name__ for cls in leaves(Command) if not inspect.isabstract(cls)}
    names = {name for name in names if not name.startswith("_")}
    assert names == set(COMMANDS) == {cls.__name__ for cls in STRATEGIES}


@EVERY
@SOME
@given(data=st.data())
def test_undo_gives_back_the_same_object(kind: type[Command], data: st.DataObject):
    command, _ = drawn(data, kind)
    session = EditorSession(BASE)
    session.apply(command)
    changed = session.scenario
    if changed is BASE:
        assert not session.can_undo
        return
    session.undo()
    assert session.scenario is BASE
    session.redo()
    assert session.scenario is changed


@EVERY
@SOME
@given(data=st.data())
def test_json_form_is_the_same_command(kind: type[Command], data: st.DataObject):
    command, result = drawn(data, kind)
    text = json.dumps(command_to_json(command))
    again = command_from_json(json.loads(text), "Entry 1")
    assert again == command
    assert again.label == command.label
    assert same_scenario(again.apply(BASE), result)


@EVERY
@SOME
@given(data=st.data())
def test_tracks_stay_well_formed(kind: type[Command], data: st.DataObject):
    command, result = drawn(data, kind)
    agents = result.agents
    absent = ~agents.is_valid
    for name in ("position_m", "heading_rad", "velocity_mps"):
        values = getattr(agents, name)
        assert values.dtype == np.float64
        assert np.isfinite(values).all()
        assert not values[absent].any(), name
        assert not values.flags.writeable
    assert (np.abs(agents.heading_rad) <= np.pi).all()
    assert not (agents.observed & absent).any()
    assert result.focal_id in agents.row_of or not len(agents)
    assert command.label
    assert set(command.selects or ()) <= set(agents.ids)


@EVERY
@SOME
@given(data=st.data())
def test_agents_that_are_not_named_stay_untouched(
    kind: type[Command], data: st.DataObject
):
    command, result = drawn(data, kind)
    named: set[str] = set()
    for part in command.parts:
        named |= set(getattr(part, "agent_ids", ()))
        named |= {getattr(part, "agent_id", ""), *getattr(part, "new_ids", ())}
        if isinstance(part, SetRoadWarp | ContinueScene | BeginAt):
            return
        if isinstance(part, ReplaceTraffic):
            named |= set(part.sample.ids)
    if kind.__name__ == "RemoveAllAgents":
        named |= set(BASE.agents.ids)
    kept = [name for name in BASE.agents.ids if name not in named]
    before = BASE.agents.taken(BASE.agents.rows(kept))
    after = result.agents.taken(result.agents.rows(kept))
    for name in ("position_m", "heading_rad", "velocity_mps", "is_valid", "size_m"):
        assert (getattr(before, name) == getattr(after, name)).all(), name
    assert result.road_map is BASE.road_map


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (None, "Entry 3 must be an object that names its command."),
        ({"agent_ids": []}, "Entry 3 must be an object that names its command."),
        ({"command": "Fly"}, "Entry 3 is of the unknown command 'Fly'."),
        (
            {"command": "DeleteAgents"},
            "Entry 3 (DeleteAgents) lacks the field 'agent_ids'.",
        ),
        (
            {"command": "DeleteAgents", "agent_ids": ["1"], "why": 1},
            "Entry 3 (DeleteAgents) has an unknown field 'why'.",
        ),
        (
            {"command": "DeleteAgents", "agent_ids": "1"},
            "Entry 3 (DeleteAgents).agent_ids must be a list, not '1'.",
        ),
        (
            {"command": "SetAgentSpeed", "agent_ids": ["1"], "speed_mps": True},
            "Entry 3 (SetAgentSpeed).speed_mps must be a number, not True.",
        ),
        (
            {"command": "SetAgentSpeed", "agent_ids": ["1"], "speed_mps": 99},
            "Entry 3 (SetAgentSpeed): Speed 99 m/s is outside -60..60 m/s.",
        ),
        (
            {"command": "SetFocalAgent", "agent_id": 7},
            "Entry 3 (SetFocalAgent).agent_id must be a text, not 7.",
        ),
    ],
)
def test_bad_json_gets_one_sentence(data: object, message: str):
    with pytest.raises(RecipeError) as caught:
        command_from_json(data, "Entry 3")
    assert str(caught.value) == message
