"""Regenerating and resampling in the whole tab, without a browser."""

import contextlib
import json
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any
from unittest import mock

import numpy as np
import pytest

from pd_editor.base.errors import GenerationError
from pd_editor.base.installed_files import models_folder
from pd_editor.editor.commands import RemoveAllAgents, SetLocks
from pd_editor.editor.cures import Cure
from pd_editor.generation import generators
from pd_editor.generation.generators import registry
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.exporters.bundle import write_files
from pd_editor.scene.generation import (
    CAPABILITIES,
    LANE_GUIDANCE,
    GeneratedTraffic,
    GenerationProgress,
    GenerationRequest,
    GeneratorSpec,
    GuidanceSetting,
    TrafficSample,
)
from pd_editor.scene.locks import Lock
from pd_editor.viewer import viewer_app
from pd_editor.viewer.findings.status_chip import apply_cure
from pd_editor.viewer.generation.generation_panel import (
    ADD_AGENTS,
    AROUND_TRAFFIC,
    AROUND_VIEW,
    REDRAW_SELECTION,
    REGION_HALF_SIDE_M,
)
from pd_editor.viewer.generation.generation_run import GenerationInput
from pd_editor.viewer.generation.run_bar import IN_REGION, SCOPE_ALL, SCOPE_USUAL
from pd_editor.viewer.tab.panel_style import plain
from pd_editor.viewer.viewer_app import ViewerApp
from tests.builders import two_agents_that_pass
from tests.editor.fake_generators import PlacingGenerator
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


def run_to_end(tab: FakeTab, start: Callable[[], None]) -> None:
    tab.run(start)
    deadline = time.monotonic() + 90
    while tab.model.is_running and time.monotonic() < deadline:
        time.sleep(0.02)
    tab.run(lambda: None)


def bar(tab: FakeTab) -> dict[str, Any]:
    """What the page shows of the run bar."""
    return json.loads(tab.ui.overlay._shown["run"])


def targets(tab: FakeTab) -> list[str]:
    return [f"{one['label']} {one['target']}" for one in bar(tab)["verbs"]]


def labels(tab: FakeTab) -> list[str]:
    return [entry.label for entry in tab.session.entries]


def test_options_reach_the_request(tab, placing):
    panel = tab.elements.generation
    panel._steps.value, panel._guidance.value, panel.bar.samples = 9, 0.7, 3
    run_to_end(tab, panel.regenerate)
    (request,) = placing.requests
    assert request.num_denoising_steps == 9
    assert request.num_samples == 3
    assert request.guidance == (GuidanceSetting(name=LANE_GUIDANCE, weight=0.7),)
    assert not request.resampled_state_ids
    assert labels(tab) == ["Regenerate 2 agents, sample 1 of 3 (placing, seed 0)"]
    assert panel.bar.seed == 1


def test_untouched_guidance_is_the_models_own_choice(tab, placing):
    panel = tab.elements.generation
    run_to_end(tab, panel.regenerate)
    (request,) = placing.requests
    assert not request.guidance


def test_a_plain_generator_is_offered_without_what_it_does_not_know(tab, placing):
    panel = tab.elements.generation
    assert (panel._steps.value, panel._guidance.value) == (6, 0.4)
    panel._model.value = "plain"
    tab.run(panel._show_options)
    unused = (panel._steps, panel._guidance, panel._which)
    assert all(handle.disabled for handle in unused)
    assert [one["isEnabled"] for one in bar(tab)["verbs"]] == [True, False]
    run_to_end(tab, panel.regenerate)
    (request,) = placing.requests
    assert request.num_denoising_steps is None
    assert not request.guidance


def test_all_agents_are_replaced_by_as_many_as_there_were(tab, placing):
    panel, before = tab.elements.generation, tab.session.scenario
    panel._keeps_focal.value = False
    tab.run(panel._show_counts)
    assert panel._counts[AgentKind.VEHICLE].value == 2
    run_to_end(tab, panel.resample)
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
    panel, before = tab.elements.generation, tab.session.scenario
    assert panel._counts[AgentKind.VEHICLE].value == 1
    run_to_end(tab, panel.resample)
    (request,) = placing.requests
    assert request.scenario.agents.ids == (before.focal_id,)
    after = tab.session.scenario
    assert after.agents.ids == (before.focal_id, "new-1")
    assert after.focal_id == before.focal_id
    row = before.agents.row_of[before.focal_id]
    assert (after.agents.position_m[0] == before.agents.position_m[row]).all()


def test_a_bare_road_is_filled_and_says_what_it_needs(tab, placing):
    panel = tab.elements.generation
    tab.run(lambda: tab.ui.apply(RemoveAllAgents()))
    tab.run(lambda: tab.model.findings.check(with_future=True))
    panel._counts[AgentKind.VEHICLE].value = 0
    with pytest.raises(GenerationError, match="how many agents"):
        tab.run(panel.resample)
    panel._counts[AgentKind.PEDESTRIAN].value = 1
    panel._counts[AgentKind.VEHICLE].value = 3
    run_to_end(tab, panel.resample)
    kinds = tab.session.scenario.agents.kinds
    assert sorted(kinds) == [AgentKind.PEDESTRIAN] + [AgentKind.VEHICLE] * 3


def test_the_model_may_choose_how_many(tab, placing):
    panel = tab.elements.generation
    panel._fits.value = True
    panel._moving.value = "A quarter"
    panel._only_on_road.value = True
    tab.run(panel._show_counts)
    assert panel._counts[AgentKind.VEHICLE].disabled
    run_to_end(tab, panel.resample)
    (request,) = placing.requests
    assert request.samples_num_agents
    assert not request.num_new_agents
    assert (request.moving_share, request.only_on_road) == (0.25, True)
    run_to_end(tab, panel.regenerate)
    assert (placing.requests[-1].moving_share, placing.requests[-1].only_on_road) == (
        None,
        False,
    )


def test_a_selected_agent_gets_a_new_state_and_the_rest_stays(tab, placing):
    panel, before = tab.elements.generation, tab.session.scenario
    panel._which.value = REDRAW_SELECTION
    with pytest.raises(GenerationError, match="Nothing is selected"):
        tab.run(panel.resample)
    other, one = before.agents.ids
    tab.run(lambda: tab.session.select((one,)))
    run_to_end(tab, panel.resample)
    (request,) = placing.requests
    assert request.agent_ids == request.resampled_state_ids == (one,)
    agents = tab.session.scenario.agents
    assert agents.ids == before.agents.ids
    row = agents.row_of[other]
    assert (agents.position_m[row] == before.agents.position_m[row]).all()
    assert not agents.is_valid[agents.row_of[one], : before.current_step].any()


def test_agents_are_added_where_one_looks(tab, placing):
    panel, before = tab.elements.generation, tab.session.scenario
    panel._which.value, panel._where.value = ADD_AGENTS, AROUND_VIEW
    tab.run(panel._show_counts)
    panel._counts[AgentKind.CYCLIST].value = 1
    run_to_end(tab, panel.resample)
    (request,) = placing.requests
    assert request.scenario is before
    assert request.region is not None
    assert request.region.half_side_m == REGION_HALF_SIDE_M
    assert tab.session.scenario.agents.ids == (*before.agents.ids, "new-1")


def test_another_sample_takes_the_place_of_the_first(tab, placing):
    panel = tab.elements.generation
    panel.bar.samples, panel._keeps_focal.value = 3, False
    tab.run(panel._show_counts)
    run_to_end(tab, panel.resample)
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
        panel = tab.elements.generation
        assert panel._model.options[:2] == ("mine", generators.SHIPPED_MODEL)
        run_to_end(tab, panel.regenerate)
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
        panel = tab.elements.generation
        assert plugin in panel._model.options
        assert "damaged_one" not in panel._model.options
        (shown,) = (handle.content for handle in panel._unusable)
        assert shown == r"Not offered: damaged\_one: config\.json is not readable JSON"
        panel._model.value = plugin
        tab.run(panel._model_chosen)
        assert panel._origin.content == plain("your own code: trajectories only")
        run_to_end(tab, panel.regenerate)
        (entry,) = tab.session.entries
        assert "(drift, seed 0)" in entry.label


def test_the_quality_of_resampled_states_reaches_the_request(tab, placing):
    panel = tab.elements.generation
    run_to_end(tab, panel.resample)
    panel._quality.value = "High, slower"
    run_to_end(tab, panel.resample)
    run_to_end(tab, panel.regenerate)
    assert [one.quality for one in placing.requests] == ["fast", "high", "fast"]


@contextlib.contextmanager
def same_browser(app: ViewerApp) -> Iterator[None]:
    """Its pages get the workspaces that pages before them have left."""
    with mock.patch.object(
        viewer_app, "_stored_keys", side_effect=lambda _: ("", [*app._workspaces])
    ):
        yield


@pytest.fixture
def app(tmp_path, placing):
    folder = tmp_path / "scene"
    write_files(scenario_files(two_agents_that_pass()), folder, forbidden=None)
    with (
        running_app(tmp_path / "library", str(folder)) as running,
        same_browser(running),
    ):
        yield running


def test_the_settings_outlive_a_reload(app, placing):
    """Samples and steps were back at their defaults, and the next seed was 0 again."""
    with connected_tab(app) as tab:
        panel = tab.elements.generation
        panel.bar.samples, panel._steps.value, panel._quality.value = 3, 9, "Fast"
        panel._which.value = ADD_AGENTS
        tab.run(panel._show_counts)
        panel._counts[AgentKind.BUS].value = 2
        panel._where.value = AROUND_VIEW
        run_to_end(tab, panel.resample)
        workspace = tab.tab.workspace
    with connected_tab(app) as tab:
        assert tab.tab.workspace is workspace
        run_to_end(tab, tab.elements.generation.resample)
    first, again = placing.requests
    assert (first.seed, again.seed) == (0, 1)
    assert again.num_samples == 3
    assert again.num_denoising_steps == 9
    assert again.num_new_agents == first.num_new_agents == {AgentKind.BUS: 2}
    assert again.region is not None


def test_a_model_is_chosen_again_with_its_settings(app):
    with connected_tab(app) as tab:
        panel = tab.elements.generation
        panel._model.value = "plain"
        tab.run(panel._model_chosen)
    with connected_tab(app) as tab:
        panel = tab.elements.generation
        assert panel._model.value == "plain"
        assert panel._steps.disabled


def test_a_region_is_gone_with_its_page(app):
    with connected_tab(app) as tab:
        panel = tab.elements.generation
        panel._where.value = panel.bar.scope = IN_REGION
        panel._counts[AgentKind.BUS].value = 7
    with connected_tab(app) as tab:
        panel = tab.elements.generation
        assert panel._where.value == AROUND_TRAFFIC
        assert panel.bar.scope == SCOPE_USUAL
        assert panel._counts[AgentKind.BUS].value == 0


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
        tab.run(tab.elements.generation.regenerate)
        assert begun.wait(20)
    with connected_tab(app) as tab:
        assert bar(tab)["text"] == "Its page was closed or loaded again while it ran."
        assert not tab.model.is_running
    with connected_tab(app) as tab:
        assert "Its page" not in bar(tab)["text"]


def test_a_run_that_places_nobody_changes_nothing(tab):
    before = tab.session.scenario
    run = tab.elements.generation.result
    names = before.agents.ids
    task = GenerationInput(
        base=before,
        request=GenerationRequest(
            scenario=before.without_agents(names), agent_ids=(), samples_num_agents=True
        ),
        removed_ids=names,
    )
    nobody = two_samples_without(names, before)
    traffic = GeneratedTraffic(samples=nobody, generator="ready")
    with mock.patch.object(tab.ui, "report") as told:
        tab.run(lambda: run._finished(task, traffic, 0.0))
    assert "would only be removed" in str(told.call_args.args[0])
    assert tab.session.scenario is before
    assert not run.is_running


def test_equal_samples_are_no_choice(tab):
    before = tab.session.scenario
    run = tab.elements.generation.result
    task = GenerationInput(
        base=before,
        request=GenerationRequest(scenario=before, agent_ids=before.agents.ids),
    )
    samples = two_samples_without((), before)
    tab.run(
        lambda: run._finished(
            task, GeneratedTraffic(samples=samples, generator="r"), 0.0
        )
    )
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
    panel = tab.elements.generation
    assert targets(tab) == ["Regenerate everybody", "Resample everybody"]
    tab.run(lambda: tab.session.select(("101",)))
    assert targets(tab)[0] == "Regenerate 101"
    run_to_end(tab, panel.regenerate)
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
        (Lock(), "Regenerate everybody but 1 locked"),
    ):
        command = SetLocks(agent_ids=("101",), lock=lock)
        tab.run(lambda command=command: tab.session.apply(command))
        assert targets(tab) == [label, "Resample everybody but 1 locked"]


def test_a_cure_makes_one_sample_and_the_others_can_still_be_chosen(tab, placing):
    """It made as many as 'Samples' says, and threw away those that were there."""
    panel = tab.elements.generation
    panel.bar.samples, panel._keeps_focal.value = 3, False
    tab.run(panel._show_counts)
    run_to_end(tab, panel.resample)
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
    panel, strip = tab.elements.generation, tab.elements.samples
    panel.bar.samples, panel._keeps_focal.value = 3, False
    tab.run(panel._show_counts)
    run_to_end(tab, panel.resample)
    until(lambda: strip.is_open)
    tab.hear("status", kind="list", isOpen=True)
    tab.run(strip.compare)
    assert not tab.run(tab.elements.chip.close_list)


def test_a_refusal_stays_to_be_read(tab, placing):
    """It was a notice of some seconds, and nothing else told that nothing happened."""
    panel = tab.elements.generation
    with mock.patch.object(
        placing, "generate", side_effect=GenerationError("No road.")
    ):
        run_to_end(tab, panel.regenerate)
    assert (bar(tab)["text"], bar(tab)["tone"]) == ("No road.", "bad")
    tab.run(lambda: tab.session.select(("101",)))
    assert bar(tab)["text"].startswith("Nothing reacts live")
