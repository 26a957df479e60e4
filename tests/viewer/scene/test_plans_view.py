"""Plans of policies at the playhead, kept with the roll-out that they led to."""

import numpy as np

from pd_editor.editor.commands import BeginAt, ContinueScene, SetAgentSize
from pd_editor.editor.commands.roll_out import RolledMotion


def roll_out(tab) -> ContinueScene:
    """Everybody goes on as recorded; one is driven, with plans at two steps."""
    session, workspace = tab.session, tab.tab.workspace
    agents = session.scenario.agents.cut_to(slice(49, 110))
    command = ContinueScene(motion=RolledMotion.of(agents), generator="test")
    plans = {49: np.arange(8.0).reshape(4, 2), 54: np.arange(12.0).reshape(6, 2)}
    tab.run(lambda: session.apply(command))
    workspace.driven_plans.append((command, {agents.ids[0]: plans}))
    return command


def shown(tab):
    return [len(one) for one in tab.elements.plans.shown]


def at(tab, value: int) -> None:
    tab.hear("timeline", kind="seek", value=value)
    tab.run(lambda: None)


def test_a_plan_is_shown_from_its_step_on_and_goes_with_undo(tab):
    command = roll_out(tab)
    at(tab, -3)
    assert not shown(tab)
    at(tab, 2)
    assert shown(tab) == [4]
    # Another edit keeps it.
    size = SetAgentSize(agent_ids=command.motion.ids[:1], length_m=5.0, width_m=2.0)
    tab.run(lambda: tab.session.apply(size))
    at(tab, 7)
    assert shown(tab) == [6]
    tab.run(lambda: tab.session.apply(BeginAt(time_s=1.0)))
    at(tab, 1)
    assert not shown(tab)
    tab.run(tab.session.undo)
    at(tab, 7)
    assert shown(tab) == [6]
    tab.run(tab.session.undo)
    tab.run(tab.session.undo)
    at(tab, 8)
    assert not shown(tab)
