"""What could happen to an agent: asked for, pointed at, made, and looked for again."""

from pd_editor.analysis.guidance.kinds.pairs import Threaten
from pd_editor.analysis.guidance.possible_encounters import possible_encounters
from pd_editor.editor.commands import DeleteAgents, SetAgentPosition, SetFocalAgent
from tests.viewer.fake_browser import FakeTab, until


def listed(tab: FakeTab) -> dict:
    return tab.shown("guidance_panel")["encounters"]


def arcs(tab: FakeTab) -> list[dict]:
    return [m for m in tab.shown("guidance_marks")["marks"] if m["shape"] == "arc"]


def send(tab: FakeTab, **event) -> None:
    tab.hear("guidance_panel", **{"version": None, "count": 0, **event})


def asked(tab: FakeTab) -> dict:
    send(tab, kind="look")
    until(lambda: listed(tab)["items"])
    return listed(tab)


def test_nothing_is_shown_until_it_is_asked_for_and_after_it_is_closed(tab: FakeTab):
    assert listed(tab)["items"] == []
    assert arcs(tab) == []
    found = asked(tab)
    assert found["isOpen"]
    scenario = tab.session.scenario
    wanted = possible_encounters(scenario, scenario.focal_id)
    assert [one["text"] for one in found["items"]] == [one.in_words for one in wanted]
    assert len(arcs(tab)) == len({one.term.named_ids for one in wanted})
    send(tab, kind="look")
    assert listed(tab)["items"] == []
    assert arcs(tab) == []


def test_pointing_previews_and_a_click_makes_one_edit(tab: FakeTab):
    asked(tab)
    send(tab, kind="point", number=0)
    assert listed(tab)["items"][0]["isPointed"]
    (pointed,) = [arc for arc in arcs(tab) if arc["isChosen"]]
    assert len(pointed["points"]) > 2
    assert tab.session.scenario.guidance == ()
    send(tab, kind="make", number=0)
    (term,) = tab.session.scenario.guidance
    assert isinstance(term, Threaten)
    assert len(tab.session.entries) == 1
    assert listed(tab)["items"][0]["isMade"]
    send(tab, kind="make", number=0)
    assert len(tab.session.entries) == 1
    send(tab, kind="point", number=None)
    assert not any(one["isPointed"] for one in listed(tab)["items"])
    for wrong in (99, -1, "0", None, True, 1.5):
        send(tab, kind="make", number=wrong)
        send(tab, kind="point", number=wrong)
    assert len(tab.session.entries) <= 2


def test_an_arc_is_pointed_at_and_clicked(tab: FakeTab):
    asked(tab)
    arc = arcs(tab)[0]
    tab.hear("guidance_marks", kind="point", index=arc["index"])
    assert arcs(tab)[0]["isChosen"]
    tab.hear("guidance_marks", kind="grab", index=arc["index"])
    tab.hear("guidance_marks", kind="drop", index=arc["index"])
    assert len(tab.session.scenario.guidance) == 1


def test_edits_of_agents_look_again_and_those_of_guidance_do_not(tab: FakeTab):
    before = asked(tab)["items"]
    send(tab, kind="make", number=0)
    assert listed(tab)["items"][0]["text"] == before[0]["text"]
    scenario = tab.session.scenario
    other = next(name for name in scenario.agents.ids if name != scenario.focal_id)
    move = SetAgentPosition(agent_id=other, x_m=-25.0, y_m=0.0)
    tab.run(lambda: tab.session.apply(move))
    until(lambda: listed(tab)["items"] and listed(tab)["items"] != before)
    wanted = possible_encounters(tab.session.scenario, scenario.focal_id)
    assert [one["text"] for one in listed(tab)["items"]] == [
        one.in_words for one in wanted
    ]
    for command in (
        SetFocalAgent(agent_id=other),
        DeleteAgents(agent_ids=(scenario.focal_id,)),
    ):
        tab.run(lambda command=command: tab.session.apply(command))
    assert not listed(tab)["isOpen"]
    assert arcs(tab) == []


def test_the_menu_of_a_threat_tells_which_approaches_are_infeasible(tab: FakeTab):
    asked(tab)
    send(tab, kind="make", number=0)
    tab.run(tab.model.checked.emit)
    (row,) = tab.shown("guidance_panel")["rows"]
    (approach,) = [one for one in row["inputs"] if one["name"] == "approach"]
    assert approach["value"] not in approach["notes"]
    few, sentence = approach["notes"]["pulls out"]
    assert few == "no way to that"
    assert sentence.startswith("It would have to stand beside the way")


def test_the_list_is_of_the_agent_and_scene_that_it_was_asked_for(tab: FakeTab):
    """Its title followed the selection; its arcs came along to the next scene."""
    label = asked(tab)["label"]
    other = next(
        n for n in tab.session.scenario.agents.ids if n != tab.session.scenario.focal_id
    )
    tab.run(lambda: tab.session.select((other,)))
    assert (listed(tab)["label"], listed(tab)["isOpen"]) == (label, True)
    tab.run(lambda: tab.ui.workspace.open_reference("roundabout"))
    assert not listed(tab)["isOpen"]
    assert arcs(tab) == []


def test_a_threat_has_one_name_in_list_menu_and_history(tab: FakeTab):
    words = asked(tab)["items"][0]["text"].split(":")[0]
    send(tab, kind="make", number=0)
    (row,) = tab.shown("guidance_panel")["rows"]
    (how,) = [one for one in row["inputs"] if one["name"] == "approach"]
    assert how["value"] == words
    assert f"({words})" in tab.session.scenario.guidance[0].in_words
    send(
        tab,
        kind="input",
        index=0,
        name="approach",
        value="crosses",
        version=tab.shown("guidance_panel")["version"],
    )
    (term,) = tab.session.scenario.guidance
    assert isinstance(term, Threaten)
    assert term.approach == "side"
