"""Regenerating and resampling in the whole tab, without a browser."""

import contextlib
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from unittest import mock

import numpy as np
import pytest
from viser import LocalStorageHandle

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.base.errors import GenerationError
from pd_editor.base.installed_files import models_folder
from pd_editor.editor.commands import AddGuidance, RemoveAllAgents, SetLocks
from pd_editor.editor.cures import Cure
from pd_editor.generation import generators
from pd_editor.generation import generators as registry
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.bundle import write_files
from pd_editor.scene.generation import (
    CAPABILITIES,
    LANE_GUIDANCE,
    GenerationProgress,
    GeneratorSpec,
    GuidanceSetting,
    TrafficSample,
)
from pd_editor.scene.locks import Lock
from pd_editor.viewer.findings.status_chip import apply_cure
from pd_editor.viewer.generation.generation_panel import (
    ADD_AGENTS,
    AROUND_TRAFFIC,
    AROUND_VIEW,
    REDRAW_SELECTION,
    REGION_HALF_SIDE_M,
)
from pd_editor.viewer.generation.run_bar import IN_REGION, SCOPE_ALL, SCOPE_USUAL
from pd_editor.viewer.tab.panel_style import plain
from tests.builders import two_agents_that_pass
from tests.editor.fake_generators import PlacingGenerator, ReadyGenerator
from tests.scene.formats.test_opendrive import lane, road, section, write
from tests.viewer.fake_browser import FakeTab, connected_tab, running_app, until


@pytest.fixture
def placing(monkeypatch) -> PlacingGenerator:
    generator = PlacingGenerator()
    offers = {
        "placing": GeneratorSpec(
            make=lambda: generator,
            supports=CAPABILITIES,
            default_num_steps=6,
            default_guidance=0.4,
        ),
        "plain": GeneratorSpec(make=lambda: generator),
    }
    monkeypatch.setattr(registry, "GENERATORS", offers)
    return generator


@pytest.fixture
def tab(tmp_path, placing):
    folder = tmp_path / "scene"
    write_files(scenario_files(two_agents_that_pass()), folder, forbidden=None)
    with (
        running_app(tmp_path / "library", str(folder)) as app,
        connected_tab(app) as opened,
    ):
        opened.tab.workspace.playback.pause()
        yield opened


def run_to_end(tab: FakeTab, start: str | Callable[[], None]) -> None:
    """Press a button of the run bar, or start a run otherwise, and wait for its end."""
    if isinstance(start, str):
        tab.hear("run", kind=start)
    else:
        tab.run(start)
    deadline = time.monotonic() + 90
    while tab.model.is_running and time.monotonic() < deadline:
        time.sleep(0.02)
    tab.run(lambda: None)


def targets(tab: FakeTab) -> list[str]:
    return [f"{one['label']} {one['target']}" for one in tab.shown("run")["verbs"]]


def labels(tab: FakeTab) -> list[str]:
    return [entry.label for entry in tab.session.entries]


def test_options_reach_the_request(tab, placing):
    tab.type("Denoising steps", 9)
    tab.type("Lane guidance", 0.7)
    tab.hear("run", kind="samples", value=3)
    run_to_end(tab, "regenerate")
    (request,) = placing.requests
    assert request.num_denoising_steps == 9
    assert request.num_samples == 3
    assert request.guidance == (GuidanceSetting(name=LANE_GUIDANCE, weight=0.7),)
    assert not request.resampled_state_ids
    assert labels(tab) == ["Regenerate 2 agents, sample 1 of 3 (placing, seed 0)"]
    assert tab.shown("run")["seed"] == 1


def test_untouched_guidance_is_the_models_own_choice(tab, placing):
    run_to_end(tab, "regenerate")
    (request,) = placing.requests
    assert not request.guidance


def test_a_plain_generator_is_offered_without_what_it_does_not_know(tab, placing):
    options = [tab.field(label) for label in ("Denoising steps", "Lane guidance")]
    assert [handle.value for handle in options] == [6, 0.4]
    tab.type("Model", "plain")
    assert all(handle.disabled for handle in (*options, tab.field("Replace")))
    assert [one["isEnabled"] for one in tab.shown("run")["verbs"]] == [True, False]
    run_to_end(tab, "regenerate")
    (request,) = placing.requests
    assert request.num_denoising_steps is None
    assert not request.guidance


def test_all_agents_are_replaced_by_as_many_as_there_were(tab, placing):
    before = tab.session.scenario
    tab.type("Keep focal agent", False)
    assert tab.field("Vehicles").value == 2
    run_to_end(tab, "resample")
    (request,) = placing.requests
    assert not len(request.scenario.agents)
    assert request.num_new_agents == {AgentKind.VEHICLE: 2}
    after = tab.session.scenario
    assert after.agents.ids == ("new-1", "new-2")
    assert after.focal_id in after.agents.ids
    assert after.focal_id != before.focal_id
    assert labels(tab) == ["Resample 2 agents (placing, seed 0)"]
    tab.run(tab.elements.history.undo)
    assert tab.session.scenario is before


def test_the_focal_agent_and_the_ego_stay_unless_told_otherwise(tab, placing):
    """(D2, D6): Resample took both away without a word."""
    before = tab.session.scenario
    assert tab.field("Vehicles").value == 1
    run_to_end(tab, "resample")
    (request,) = placing.requests
    assert request.scenario.agents.ids == (before.focal_id,)
    after = tab.session.scenario
    assert after.agents.ids == (before.focal_id, "new-1")
    assert after.focal_id == before.focal_id
    row = before.agents.row_of[before.focal_id]
    assert (after.agents.position_m[0] == before.agents.position_m[row]).all()


def test_a_bare_road_is_filled_and_says_what_it_needs(tab, placing):
    tab.press("Clear the road")
    tab.run(lambda: tab.model.findings.check(with_future=True))
    tab.type("Vehicles", 0)
    run_to_end(tab, "resample")
    assert "how many agents" in tab.shown("run")["text"]
    assert not placing.requests
    tab.type("Pedestrians", 1)
    tab.type("Vehicles", 3)
    run_to_end(tab, "resample")
    kinds = tab.session.scenario.agents.kinds
    assert sorted(kinds) == [AgentKind.PEDESTRIAN] + [AgentKind.VEHICLE] * 3


def test_a_road_that_was_never_full_is_filled_by_one_click(tmp_path, placing):
    bare = write(tmp_path, road(section(lane(-1), lane(1))))
    with (
        running_app(tmp_path / "library", str(bare)) as app,
        connected_tab(app) as tab,
    ):
        assert targets(tab) == ["Regenerate everybody", "Fill road"]
        regenerate, fill = tab.shown("run")["verbs"]
        assert not regenerate["isEnabled"]
        assert fill["isEnabled"]
        tab.type("As many as fit", False)
        assert tab.offers("Vehicles")
        assert not tab.field("As many as fit").value, "it is proposed once"
        tab.type("As many as fit", True)
        run_to_end(tab, "resample")
        (request,) = placing.requests
        assert request.samples_num_agents
        assert targets(tab)[1] == "Resample everybody"


def test_the_model_may_choose_how_many(tab, placing):
    assert tab.offers("Vehicles")
    tab.type("As many as fit", True)
    tab.type("Moving agents", "A quarter")
    assert tab.field("Only on the road").value
    assert not tab.offers("Vehicles")
    run_to_end(tab, "resample")
    (request,) = placing.requests
    assert request.samples_num_agents
    assert not request.num_new_agents
    assert (request.moving_share, request.only_on_road) == (0.25, True)
    run_to_end(tab, "regenerate")
    assert (placing.requests[-1].moving_share, placing.requests[-1].only_on_road) == (
        None,
        False,
    )


def test_a_selected_agent_gets_a_new_state_and_the_rest_stays(tab, placing):
    before = tab.session.scenario
    tab.type("Replace", REDRAW_SELECTION)
    run_to_end(tab, "resample")
    assert tab.shown("run")["text"].startswith("Nothing is selected")
    other, one = before.agents.ids
    tab.run(lambda: tab.session.select((one,)))
    run_to_end(tab, "resample")
    (request,) = placing.requests
    assert request.agent_ids == request.resampled_state_ids == (one,)
    agents = tab.session.scenario.agents
    assert agents.ids == before.agents.ids
    row = agents.row_of[other]
    assert (agents.position_m[row] == before.agents.position_m[row]).all()
    assert not agents.is_valid[agents.row_of[one], : before.current_step].any()


def test_agents_are_added_where_one_looks(tab, placing):
    before = tab.session.scenario
    tab.type("Replace", ADD_AGENTS)
    tab.type("Cyclists", 1)
    # It took the numbers away that had been typed.
    tab.type("Where", AROUND_VIEW)
    run_to_end(tab, "resample")
    (request,) = placing.requests
    assert request.scenario is before
    assert request.region is not None
    assert request.region.half_side_m == REGION_HALF_SIDE_M
    assert tab.session.scenario.agents.ids == (*before.agents.ids, "new-1")


def test_another_sample_takes_the_place_of_the_first(tab, placing):
    tab.hear("run", kind="samples", value=3)
    tab.type("Keep focal agent", False)
    run_to_end(tab, "resample")
    strip = tab.elements.samples
    until(lambda: strip.is_open)
    first = tab.session.scenario
    tab.run(lambda: strip.adopted.emit(2))
    now = first.current_step
    assert labels(tab) == ["Resample 2 agents, sample 3 of 3 (placing, seed 0)"]
    np.testing.assert_allclose(
        tab.session.scenario.agents.position_m[:, now]
        - first.agents.position_m[:, now],
        [[0, 2], [0, 2]],
        atol=1e-5,
    )
    # After any other edit the samples are not offered any more.
    tab.run(lambda: tab.ui.apply(RemoveAllAgents()))
    tab.run(lambda: strip.adopted.emit(1))
    assert not strip.is_open
    assert labels(tab)[-1] == "Remove all agents"
    tab.run(tab.session.undo)
    assert strip.is_open


def test_models_of_a_users_own_are_offered_first(tmp_path):
    shipped = models_folder() / generators.SHIPPED_MODEL
    mine = tmp_path / "mine"
    shutil.copytree(shipped, mine)
    with (
        running_app(tmp_path / "library", "crosswalk", models=(mine,)) as app,
        connected_tab(app) as tab,
    ):
        assert tab.field("Model").options[:2] == ("mine", generators.SHIPPED_MODEL)
        run_to_end(tab, "regenerate")
        (entry,) = tab.session.entries
        assert "(mine, seed 0)" in entry.label


def test_plugins_are_offered_with_their_origin_and_broken_folders_are_listed(tmp_path):
    broken = tmp_path / "models" / "damaged_one"
    broken.mkdir(parents=True)
    (broken / "config.json").write_text("{")
    plugin = "examples.drift_generator:DriftGenerator"
    with (
        running_app(
            tmp_path / "library", "crosswalk", models=(broken.parent, plugin)
        ) as app,
        connected_tab(app) as tab,
    ):
        assert plugin in tab.field("Model").options
        assert "damaged_one" not in tab.field("Model").options
        broken_one = r"damaged\_one: config\.json is not readable JSON"
        assert f"Not offered: {broken_one}" in tab.text()
        tab.type("Model", plugin)
        assert plain("your own code: trajectories only") in tab.text()
        run_to_end(tab, "regenerate")
        (entry,) = tab.session.entries
        assert "(drift, seed 0)" in entry.label


def test_the_quality_of_resampled_states_reaches_the_request(tab, placing):
    run_to_end(tab, "resample")
    tab.type("Quality", "High, slower")
    run_to_end(tab, "resample")
    run_to_end(tab, "regenerate")
    assert [one.quality for one in placing.requests] == ["fast", "high", "fast"]


@contextlib.contextmanager
def same_browser() -> Iterator[None]:
    """Its pages have one storage: each gets the workspace of the page before."""
    stored: dict[str, str] = {}
    with mock.patch.multiple(
        LocalStorageHandle,
        get_item=lambda _, key, **_timeout: stored.get(key),
        set_item=lambda _, key, value: stored.update({key: value}),
    ):
        yield


@pytest.fixture
def app(tmp_path, placing):
    folder = tmp_path / "scene"
    write_files(scenario_files(two_agents_that_pass()), folder, forbidden=None)
    with (
        running_app(tmp_path / "library", str(folder)) as running,
        same_browser(),
    ):
        yield running


def test_the_settings_outlive_a_reload(app, placing):
    """Samples and steps were back at their defaults, and the next seed was 0 again."""
    with connected_tab(app) as tab:
        tab.hear("run", kind="samples", value=3)
        tab.type("Denoising steps", 9)
        tab.type("Quality", "High, slower")
        tab.type("Replace", ADD_AGENTS)
        tab.type("Buses", 2)
        tab.type("Where", AROUND_VIEW)
        run_to_end(tab, "resample")
        workspace = tab.tab.workspace
    with connected_tab(app) as tab:
        assert tab.tab.workspace is workspace
        run_to_end(tab, "resample")
    first, again = placing.requests
    assert (first.seed, again.seed) == (0, 1)
    assert again.num_samples == 3
    assert (again.num_denoising_steps, again.quality) == (9, "high")
    assert again.num_new_agents == first.num_new_agents == {AgentKind.BUS: 2}
    assert again.region is not None


def test_a_model_is_chosen_again_with_its_settings(app):
    with connected_tab(app) as tab:
        tab.type("Model", "plain")
    with connected_tab(app) as tab:
        assert tab.field("Model").value == "plain"
        assert tab.field("Denoising steps").disabled


def test_a_region_is_gone_with_its_page(app):
    with connected_tab(app) as tab:
        tab.type("Where", IN_REGION)
        tab.hear("run", kind="scope", value=IN_REGION)
        tab.type("Buses", 7)
    with connected_tab(app) as tab:
        assert tab.field("Where").value == AROUND_TRAFFIC
        assert tab.shown("run")["scope"] == SCOPE_USUAL
        assert tab.field("Buses").value == 0


def test_a_run_that_a_reload_cancelled_is_told_once(app, placing):
    """The page came back as if nothing had been asked for."""
    waits = threading.Event()
    begun = threading.Event()

    def generate(_request):
        begun.set()
        while True:
            yield GenerationProgress(fraction=0.5, message="")
            waits.wait(0.01)

    placing.generate = generate
    with connected_tab(app) as tab:
        tab.hear("run", kind="regenerate")
        assert begun.wait(20)
    with connected_tab(app) as tab:
        assert (
            tab.shown("run")["text"]
            == "Its page was closed or loaded again while it ran."
        )
        assert not tab.model.is_running
    with connected_tab(app) as tab:
        assert "Its page" not in tab.shown("run")["text"]


def test_a_run_that_places_nobody_changes_nothing(tab, placing):
    before = tab.session.scenario
    nobody = two_samples_without(before.agents.ids, before)
    placing.generate = ReadyGenerator(nobody).generate
    tab.type("Keep focal agent", False)
    tab.type("As many as fit", True)
    run_to_end(tab, "resample")
    assert "would only be removed" in tab.shown("run")["text"]
    assert tab.session.scenario is before
    assert not tab.model.is_running


def test_equal_samples_are_no_choice(tab, placing):
    before = tab.session.scenario
    placing.generate = ReadyGenerator(two_samples_without((), before)).generate
    run_to_end(tab, "regenerate")
    assert tab.session.scenario is not before
    assert not tab.elements.samples.is_open


def two_samples_without(gone: tuple[str, ...], scenario) -> tuple[TrafficSample, ...]:
    agents, now = scenario.agents, scenario.current_step
    every = TrafficSample(
        ids=agents.ids,
        kinds=agents.kinds,
        size_m=agents.size_m,
        position_m=agents.position_m[:, now:],
        heading_rad=agents.heading_rad[:, now:],
        velocity_mps=agents.velocity_mps[:, now:] + 0.1,
    )
    return (every.without(gone), every.without(gone))


def test_a_selection_is_what_is_regenerated(tab, placing):
    """R, which the hint on a stale trajectory names, replaced all other agents too."""
    assert targets(tab) == ["Regenerate everybody", "Resample everybody"]
    tab.run(lambda: tab.session.select(("101",)))
    assert targets(tab)[0] == "Regenerate 101"
    run_to_end(tab, "regenerate")
    assert placing.requests[-1].agent_ids == ("101",)
    tab.run(lambda: tab.session.select(("100", "101")))
    assert targets(tab)[0] == "Regenerate 2 agents"
    tab.run(lambda: tab.session.select(("101",)))
    tab.hear("run", kind="scope", value=SCOPE_ALL)
    assert targets(tab)[0] == "Regenerate everybody"
    tab.hear("run", kind="regenerate")
    until(lambda: len(placing.requests) == 2)
    tab.run(lambda: None)
    assert placing.requests[-1].agent_ids == ("100", "101")


def test_locks_of_beginnings_and_states_keep_no_trajectory(tab):
    for lock, label in (
        (Lock(kept_s=2.0), "Regenerate everybody"),
        (Lock(), "Regenerate all but 1 locked"),
    ):
        command = SetLocks(agent_ids=("101",), lock=lock)
        tab.run(lambda command=command: tab.session.apply(command))
        assert targets(tab) == [label, "Resample all but 1 locked"]


def test_of_a_selection_those_are_counted_that_are_not_locked(tab):
    """The verb was cut to "R..." before "2 agents but 2 locked"."""
    for names, label in (
        ((), "Regenerate 2 agents"),
        (("101",), "Regenerate 1 of 2 agents"),
        (("100", "101"), "Regenerate 2 locked"),
    ):
        if names:
            command = SetLocks(agent_ids=names, lock=Lock())
            tab.run(lambda command=command: tab.session.apply(command))
        tab.run(lambda: tab.session.select(("100", "101")))
        assert targets(tab)[0] == label


def test_guidance_that_was_run_is_no_problem_of_a_later_run_without_its_agent(tab):
    """It was said to have no effect, beside a chip that knew of nothing to be run."""
    at = tab.session.scenario.agents.position_m[0, tab.session.scenario.current_step]
    term = GoalPoint(agent_id="100", point_m=(float(at[0]) + 30.0, float(at[1])))
    tab.run(lambda: tab.session.apply(AddGuidance(term=term)))
    told = []
    for name in ("101", "100", "101"):
        tab.run(lambda name=name: tab.session.select((name,)))
        before = len(tab.notices)
        run_to_end(tab, "regenerate")
        found = [title for title, _ in tab.notices[before:]]
        told.append("A guidance problem" in found)
    assert told == [True, False, False]


def test_a_cure_makes_one_sample_and_the_others_can_still_be_chosen(tab, placing):
    """It made as many as 'Samples' says, and threw away those that were there."""
    tab.hear("run", kind="samples", value=3)
    tab.type("Keep focal agent", False)
    run_to_end(tab, "resample")
    strip = tab.elements.samples
    until(lambda: strip.is_open)
    cure = Cure(label="Regenerate new-1", regenerated_ids=("new-1",))
    run_to_end(tab, lambda: apply_cure(tab.ui, cure))
    assert placing.requests[-1].num_samples == 1
    assert len(tab.session.entries) == 2
    assert strip.is_open
    tab.run(lambda: strip.adopted.emit(2))
    assert [label.split("(")[0] for label in labels(tab)] == [
        "Resample 2 agents, sample 3 of 3 "
    ]


def test_a_comparison_of_samples_closes_the_list_of_problems(tab):
    strip = tab.elements.samples
    tab.hear("run", kind="samples", value=3)
    tab.type("Keep focal agent", False)
    run_to_end(tab, "resample")
    until(lambda: strip.is_open)
    tab.hear("status", kind="list", isOpen=True)
    tab.run(strip.compare)
    assert not tab.run(tab.elements.chip.close_list)


def test_a_refusal_stays_to_be_read(tab, placing):
    """It was a notice of some seconds, and nothing else told that nothing happened."""
    with mock.patch.object(
        placing, "generate", side_effect=GenerationError("No road.")
    ):
        run_to_end(tab, "regenerate")
    assert (tab.shown("run")["text"], tab.shown("run")["tone"]) == ("No road.", "bad")
    tab.run(lambda: tab.session.select(("101",)))
    assert tab.shown("run")["text"].startswith("Nothing reacts live")
