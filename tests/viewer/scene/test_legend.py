from dataclasses import replace

from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.locks import Lock
from pd_editor.scene.palette import DARK, LIGHT
from pd_editor.viewer.scene.picture import Legend
from tests.builders import scenario_with, straight_drivers
from tests.scene.test_signals import signalled
from tests.viewer.fake_page import FakePage


def entries_of(page: FakePage) -> dict[str, str]:
    shown = page.shown["legend"]["entries"]
    return {entry["text"]: entry["color"] for entry in shown}


def test_the_legend_lists_what_is_there_in_the_theme_s_colours():
    kinds = (AgentKind.VEHICLE, AgentKind.PEDESTRIAN)
    agents = straight_drivers([(0, 0, 0, 8), (9, 0, 0, 1)], kinds=kinds)
    scenario = scenario_with(agents)
    page = FakePage()
    legend = Legend(page)
    legend.show(
        scenario,
        LIGHT,
        has_original_road=False,
        has_original_agents=False,
        has_plans=False,
    )
    light = entries_of(page)
    assert light["Focal agent"] == f"rgb{LIGHT.focal}"
    assert light["Pedestrian"] == f"rgb{LIGHT.kinds[AgentKind.PEDESTRIAN]}"
    assert not any(text.startswith("Signal") for text in light)
    legend.show(
        signalled(),
        LIGHT,
        has_original_road=False,
        has_original_agents=False,
        has_plans=False,
    )
    signals = {text for text in entries_of(page) if text.startswith("Signal")}
    assert signals == {"Signal: stop", "Signal: go"}
    assert not {"Ego", "Bus", "Original road", "Not there at t = 0"} & set(light)
    is_valid = agents.is_valid.copy()
    is_valid[1, : scenario.current_step + 5] = False
    later = replace(scenario, agents=replace(agents, is_valid=is_valid))
    legend.show(
        later, DARK, has_original_road=False, has_original_agents=True, has_plans=True
    )
    dark = entries_of(page)
    assert dark["Original trajectory"] == f"rgb{DARK.ghost}"
    assert dark["Not there at t = 0"] == f"rgb{DARK.kinds[AgentKind.VEHICLE]}"


def test_the_legend_tells_of_locks_boxes_and_the_original_road():
    """The picture had padlocks, dark boxes and purple lines that it did not tell of."""
    kinds = (AgentKind.BUS, AgentKind.VEHICLE, AgentKind.STATIC, AgentKind.UNKNOWN)
    agents = straight_drivers([(9 * n, 0, 0, 8) for n in range(4)], kinds=kinds)
    scenario = scenario_with(agents)
    locks = {"101": Lock(), "102": Lock(kept_s=2.0), "103": Lock(kept_s=0.0)}
    page = FakePage()
    legend = Legend(page)
    legend.show(
        replace(scenario, locks=locks),
        LIGHT,
        has_original_road=True,
        has_original_agents=False,
        has_plans=False,
    )
    entries = {one["text"]: one for one in page.shown["legend"]["entries"]}
    assert entries["Original road"]["glyph"] == "line"
    assert entries["Original road"]["color"] == f"rgb{LIGHT.ghost}"
    assert "Original trajectory" not in entries
    assert entries["Bus"]["glyph"] == "shaded"
    assert entries["Other object"]["color"] == f"rgb{LIGHT.kinds[AgentKind.STATIC]}"
    assert [one["keeps"] for one in entries.values() if one["glyph"] == "lock"] == [
        "trajectory",
        "beginning",
        "state",
    ]
    assert entries["Locked beginning"]["keeps"] == "beginning"
