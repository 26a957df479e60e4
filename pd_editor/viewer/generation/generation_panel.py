"""The generation panel: regenerates trajectories and resamples agents."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np
import viser

from pd_editor.analysis.guidance.report import guidance_problems
from pd_editor.analysis.metrics.lanes import ids_near_lanes
from pd_editor.base.errors import GenerationError, PdEditorError
from pd_editor.base.plain_text import one_line
from pd_editor.editor.commands import RemoveAllAgents
from pd_editor.editor.commands.command import shortened
from pd_editor.editor.commands.locks import locked_agents_error
from pd_editor.editor.edit_findings import unrun_terms
from pd_editor.editor.live_regeneration import LiveRegeneration, LiveRequests
from pd_editor.generation.generators import GeneratorCatalogue
from pd_editor.scene.agent_kind import ROAD_USER_KINDS, AgentKind
from pd_editor.scene.generation import (
    Capability,
    GenerationRequest,
    GeneratorSpec,
    GuidanceSetting,
    Quality,
    Region,
    check_future,
    check_room,
    guidance_settings,
)
from pd_editor.scene.roles.traffic_choice import (
    agent_ids_of_kinds,
    drivable_agent_ids,
    replaceable_agent_ids,
    resamplable_agent_ids,
    road_user_ids,
    steered_agent_ids,
    trajectory_locked_ids,
)
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.generation.generation_run import (
    GenerationInput,
    GenerationRun,
    LazyGenerator,
    RunInput,
)
from pd_editor.viewer.generation.region_drawing import RegionDrawing
from pd_editor.viewer.generation.roll_out_panel import RollOutInput, RollOutPanel
from pd_editor.viewer.generation.run_bar import (
    IN_REGION,
    SCOPE_USUAL,
    LiveSwitch,
    RunBar,
    nearest_to_edit,
)
from pd_editor.viewer.generation.sample_strip import SampleStrip
from pd_editor.viewer.overlay.messages import RunVerb
from pd_editor.viewer.tab.panel_style import WITH_PAST, KeptSettings, plain
from pd_editor.viewer.tab.tab_model import RunState
from pd_editor.viewer.tab.ui_context import UiContext, set_property, set_value

REPLACE_ALL: Final = "All agents"
REDRAW_SELECTION: Final = "The selection"
ADD_AGENTS: Final = "None (add)"
AROUND_TRAFFIC: Final = "On the whole mapped road"
AROUND_VIEW: Final = "In the middle of my view (125 m square)"
_REGION: Final = "region"
"""Name of the drawn region among the kept settings."""
DRAW_REGION: Final = "Draw a region"
STOP_DRAWING: Final = "Stop drawing"
ALL_KINDS: Final = "All kinds"
KIND_LABELS: Final[Mapping[AgentKind, str]] = {
    AgentKind.VEHICLE: "Vehicles",
    AgentKind.BUS: "Buses",
    AgentKind.MOTORCYCLIST: "Motorcyclists",
    AgentKind.CYCLIST: "Cyclists",
    AgentKind.PEDESTRIAN: "Pedestrians",
}
MOVING_SHARES: Final[Mapping[str, float | None]] = {
    "As usual on such roads": None,
    "None": 0.0,
    "A quarter": 0.25,
    "Half": 0.5,
    "Three quarters": 0.75,
    "All": 1.0,
}
QUALITIES: Final[Mapping[str, Quality]] = {"Fast": "fast", "High, slower": "high"}
MODEL_SETTINGS: Final = "Model settings"
RESAMPLING_SETTINGS: Final = "More settings"
MAX_STEPS: Final = 50
MAX_TRIES: Final = 12
MAX_AGENTS_OF_A_KIND: Final = 100
REGION_HALF_SIDE_M: Final = 62.0


class GenerationPanel:
    """The generator and its options, and what the run bar's buttons do."""

    def __init__(
        self,
        ui: UiContext,
        catalogue: GeneratorCatalogue,
        drawing: RegionDrawing,
        strip: SampleStrip,
        before_run: Callable[[], str],
    ) -> None:
        """Build it into the current tab; ``before_run`` tells what to know of guidance."""
        self._ui = ui
        self._tab = ui.model
        self._generators = catalogue.offers
        self._drawing, self._before_run = drawing, before_run
        self._counted: Scenario | None = None
        gui = ui.client.gui
        self._build_resample(gui)
        with gui.add_folder("Regenerate trajectories"):
            self._kinds = gui.add_dropdown(
                "Only kinds",
                (ALL_KINDS, *KIND_LABELS.values()),
                hint="Of the agents that are regenerated, resampled or replaced",
            )
            self.live_switch = LiveSwitch(ui)
        self.closed_loop = RollOutPanel(ui, self._roll_out)
        self._build_model(gui, catalogue)
        self.result = GenerationRun(ui, strip)
        self.bar = RunBar(
            ui,
            {
                "regenerate": self.regenerate,
                "resample": self.resample,
                "cancel": self.cancel,
                "use": self.result.use_result,
                "scope": self._scope_chosen,
            },
        )
        ui.on_change(self._model, lambda _name: self._model_chosen())
        ui.on_change(self._kinds, lambda _value: self._show_counts())
        self._live = LiveRegeneration(
            ui.session,
            ui.post,
            self._live_requests,
            on_change=self._run_changed,
            on_end=ui.gesture_was_committed,
            on_result=self.result.tell_reaction,
            on_error=self._live_failed,
        )
        ui.live = self._live
        self._settings = self._kept_settings()
        self._restore()
        self.live_switch.switched.subscribe(self._live_switched)
        self.result.changed.subscribe(self._run_changed)
        self._tab.run_requested.subscribe(self.regenerate_agents)
        self._tab.shown.subscribe(self.show)
        self._tab.checked.subscribe(self._show_bar)

    def _build_model(self, gui: viser.GuiApi, catalogue: GeneratorCatalogue) -> None:
        with gui.add_folder(MODEL_SETTINGS, expand_by_default=False):
            self._model = gui.add_dropdown("Model", tuple(catalogue.offers))
            self._origin = gui.add_markdown("")
            self._unusable = [
                gui.add_markdown(
                    f"Not offered: {plain(broken.name)}: {plain(broken.reason)}"
                )
                for broken in catalogue.unusable
            ]
            self._renews = gui.add_checkbox("New seed after each run", True)
            self._steps = gui.add_slider(
                "Denoising steps", 1, MAX_STEPS, 1, 4, hint="More are slower"
            )
            self._guidance = gui.add_slider(
                "Lane guidance",
                0.0,
                1.0,
                0.05,
                0.3,
                hint="Strength of the guidance; untouched, it is stronger on warped "
                "roads",
            )
            self._tries = gui.add_slider(
                "Attempts to avoid collisions",
                0,
                MAX_TRIES,
                1,
                4,
                hint="The best of so many is taken. 0: none is avoided",
            )
            self._yields = gui.add_checkbox(
                "Slow down to avoid collisions",
                True,
                hint="Agents that would still collide yield",
            )

    def _build_resample(self, gui: viser.GuiApi) -> None:
        with gui.add_folder("Resample agents"):
            self._which = gui.add_dropdown(
                "Replace", (REPLACE_ALL, REDRAW_SELECTION, ADD_AGENTS)
            )
            self._where = gui.add_dropdown(
                "Where",
                (AROUND_TRAFFIC, AROUND_VIEW, IN_REGION),
                hint="In a region that is drawn, its agents alone are replaced",
            )
            self._draw_region = gui.add_button(
                DRAW_REGION, icon=viser.Icon.MARQUEE_2, color="gray", hint="Esc ends it"
            )
            self._fits = gui.add_checkbox(
                "As many as fit", False, hint="The model chooses how many suit the road"
            )
            with gui.add_folder("How many", expand_by_default=False):
                self._counts = {
                    kind: gui.add_number(
                        label, 0, min=0, max=MAX_AGENTS_OF_A_KIND, step=1
                    )
                    for kind, label in KIND_LABELS.items()
                }
            clear = gui.add_button("Clear the road", color="gray")
            with gui.add_folder(RESAMPLING_SETTINGS, expand_by_default=False):
                self._moving = gui.add_dropdown(
                    "Moving agents",
                    tuple(MOVING_SHARES),
                    hint="Of the agents placed",
                )
                self._only_on_road = gui.add_checkbox(
                    "Only on the road", True, hint="No parked cars far from lanes"
                )
                self._back_casts = gui.add_checkbox(
                    WITH_PAST, True, hint="Loaders look for agents in the past"
                )
                self._keeps_focal = gui.add_checkbox(
                    "Keep focal agent", True, hint="With its recorded motion"
                )
                self._keeps_ego = gui.add_checkbox(
                    "Keep ego", True, hint="With its recorded motion"
                )
                self._quality = gui.add_dropdown(
                    "Quality", tuple(QUALITIES), hint="Of the agents placed"
                )
        self._ui.on_click(self._draw_region, self._drawing.toggle)
        self._ui.on_change(self._where, lambda _value: self._where_chosen())
        self._drawing.changed.subscribe(self._region_changed)
        self._ui.on_click(clear, lambda: self._ui.apply(RemoveAllAgents()))
        self._ui.on_change(self._which, self._which_chosen)
        for handle in (self._fits, self._keeps_focal, self._keeps_ego):
            self._ui.on_change(handle, lambda _value: self._show_counts())

    def _kept_settings(self) -> KeptSettings:
        inputs: Mapping[str, Any] = {
            "model": self._model,
            "renews": self._renews,
            "steps": self._steps,
            "guidance": self._guidance,
            "tries": self._tries,
            "yields": self._yields,
            "kinds": self._kinds,
            "which": self._which,
            "fits": self._fits,
            "moving": self._moving,
            "only_on_road": self._only_on_road,
            "back_casts": self._back_casts,
            "keeps_focal": self._keeps_focal,
            "keeps_ego": self._keeps_ego,
            "where": self._where,
            "quality": self._quality,
            **self.closed_loop.inputs,
            **{kind.value: count for kind, count in self._counts.items()},
        }
        return KeptSettings(self._ui.workspace.drive_settings, inputs)

    def _restore(self) -> None:
        """Give the inputs the values that they had before the page was loaded again."""
        # Before the others: a choice of the model, and of what is replaced, sets them.
        self._settings.restore(["model", "which"])
        self._show_options()
        self._settings.restore()
        region = self._ui.workspace.drive_settings.get(_REGION)
        counts_region = self._where.value == IN_REGION
        if region is not None:
            self._drawing.take(region)
        elif counts_region or self.bar.scope == IN_REGION:
            # A region that was being drawn is gone.
            self._leave_region()
        self._show_region()
        self._show_counts()
        if region is not None or not counts_region:
            self._settings.restore(kind.value for kind in self._counts)

    def show(self) -> None:
        """Follow the session."""
        scenario = self._ui.session.scenario
        self.result.show()
        self.closed_loop.show()
        if self._which.value == REPLACE_ALL and self._counted is not scenario:
            self._show_counts()
        self._show_bar()

    def _show_bar(self) -> None:
        """Name whom runs are about, and tell how the run goes or has gone."""
        result, scenario = self.result, self._ui.session.scenario
        is_refining = self._live.is_refining
        self._tab.run = RunState(text="Refining ...") if is_refining else result.state
        said, tone = result.said, result.tone
        if not said:
            said, tone = self._before_run(), "warn"
        if not said:
            # What reacts to an edit, in its preview, would count as what it sets.
            committed = self._ui.session.committed_scenario
            said, tone = self.live_switch.silence(committed), ""
        regenerate = RunVerb(
            label="Regenerate",
            target=self._target(
                self._chosen_ids(),
                trajectory_locked_ids(scenario),
                is_region=self.bar.scope == IN_REGION,
            ),
            is_enabled=not result.is_running and bool(road_user_ids(scenario)),
        )
        verbs = regenerate, self._resampling()
        self.bar.show(verbs, self._tab.run, said, tone)

    def _resampling(self) -> RunVerb:
        which, session = self._which.value, self._ui.session
        if which == ADD_AGENTS:
            target = "as many as fit" if self._fits.value else "agents"
        else:
            target = self._target(
                session.selection if which == REDRAW_SELECTION else None,
                frozenset(session.scenario.locks),
                is_region=self._where.value == IN_REGION,
            )
        label = "Add" if which == ADD_AGENTS else "Resample"
        if which == REPLACE_ALL and not road_user_ids(session.scenario):
            label, target = "Fill", "region" if target == "region" else "road"
        return RunVerb(
            label=label,
            target=target,
            is_enabled=not self.result.is_running and self._may_resample(),
        )

    def _target(
        self, chosen: tuple[str, ...] | None, locked: frozenset[str], *, is_region: bool
    ) -> str:
        """Agents of the wanted kinds in few words: the chosen ones, or all (None)."""
        scenario, words = self._ui.session.scenario, self._kinds.value.lower()
        ids = scenario.agents.ids if chosen is None else chosen
        ids = agent_ids_of_kinds(scenario, ids, self._wanted_kinds())
        if chosen is not None:
            words = shortened(ids[0]) if len(ids) == 1 else f"{len(ids) or 'no'} agents"
        elif not self._wanted_kinds():
            words = "region" if is_region else "everybody"
        elif is_region:
            words += " in the region"
        if is_region and chosen is None and self._drawing.region is not None:
            ids = self._drawing.region.held(scenario, ids)
        kept = len(locked.intersection(ids))
        # Beside the verb there is no room for more.
        if kept and chosen is not None:
            if len(ids) == 1:
                return f"{words} (locked)"
            return (
                f"{kept} locked"
                if kept == len(ids)
                else f"{len(ids) - kept} of {words}"
            )
        if kept and words == "everybody":
            words = "all"
        return words + f" but {kept} locked" * bool(kept)

    def _chosen_ids(self) -> tuple[str, ...] | None:
        """The selection, else the guided agents, if the bar says so; None for all."""
        session = self._ui.session
        if self.bar.scope != SCOPE_USUAL:
            return None
        return steered_agent_ids(session.scenario, session.selection)

    def close(self) -> None:
        """Stop a running generation, and keep the settings for the page that comes."""
        self._settings.keep()
        self.bar.keep()
        self._ui.workspace.drive_settings[_REGION] = self._drawing.region
        self.result.close()
        self._live.close()

    def cancel(self) -> None:
        """Cancel a running generation; nothing changes.

        An edit whose final trajectories are awaited keeps those that are shown.
        """
        if self._live.is_refining:
            self._ui.commit_gesture()
        self.result.cancel()

    def regenerate(self) -> None:
        """Regenerate the trajectories of the agents that the run bar names.

        Raises:
            GenerationError: there is no agent to generate, or a run is active.
        """
        wanted, is_region = self._chosen_ids(), self.bar.scope == IN_REGION
        if wanted is None and (is_region or self._wanted_kinds()):
            scenario = self._ui.session.scenario
            wanted = drivable_agent_ids(scenario)
            if is_region:
                wanted = self._drawn_region().held(scenario, wanted)
        if wanted is not None:
            wanted = self._of_wanted_kinds(wanted)
        self.regenerate_agents(wanted)

    def regenerate_agents(
        self, wanted: tuple[str, ...] | None, is_cure: bool = False
    ) -> None:
        """Regenerate the trajectories of some agents, or of all agents.

        A cure makes one sample, and those that are chosen among stay.

        Raises:
            GenerationError: there is no agent to generate, or a run is active.
        """
        self._ui.commit_gesture()
        scenario = self._ui.session.scenario
        if not road_user_ids(scenario):
            raise GenerationError(
                "There are no agents on this road. Add some under 'Resample agents'."
            )
        ids = drivable_agent_ids(scenario, wanted)
        self._start(scenario, agent_ids=ids, is_cure=is_cure)

    def resample(self) -> None:
        """Sample initial states and trajectories of all, some, or additional agents.

        Raises:
            GenerationError: no agent is to be placed.
        """
        self._ui.commit_gesture()
        session = self._ui.session
        scenario = session.scenario
        if self._which.value == REDRAW_SELECTION:
            if not session.selection:
                raise GenerationError(
                    f"Nothing is selected. Select agents, or choose '{REPLACE_ALL}'."
                )
            wanted = self._of_wanted_kinds(session.selection)
            ids = drivable_agent_ids(scenario, wanted)
            self._start(
                scenario,
                agent_ids=ids,
                resampled_state_ids=resamplable_agent_ids(scenario, ids),
            )
            return
        counts = {
            kind: int(count.value)
            for kind, count in self._counts.items()
            if count.value and not self._fits.value
        }
        if not counts and not self._fits.value:
            raise GenerationError(
                "Enter how many agents of which kind to place, or tick 'As many as fit'."
            )
        removed: tuple[str, ...] = ()
        if self._which.value == REPLACE_ALL:
            removed = self._replaced(scenario)
        self._start(
            scenario,
            removed_ids=removed,
            num_new_agents=counts,
            samples_num_agents=bool(self._fits.value),
        )

    def _wanted_kinds(self) -> frozenset[AgentKind]:
        """Kinds of the agents that are generated; none means all."""
        return frozenset(
            kind for kind, label in KIND_LABELS.items() if label == self._kinds.value
        )

    def _of_wanted_kinds(self, agent_ids: tuple[str, ...]) -> tuple[str, ...]:
        """Those agents of the wanted kinds."""
        scenario, kinds = self._ui.session.scenario, self._wanted_kinds()
        found = agent_ids_of_kinds(scenario, agent_ids, kinds)
        if not found:
            raise GenerationError(
                "There is no such agent here. Choose other agents, another region, or "
                f"'{ALL_KINDS}'."
            )
        return found

    def _scope_chosen(self) -> None:
        """Let a region be drawn where there is none."""
        drawing = self._drawing
        is_missing = drawing.region is None and not drawing.is_active
        if self.bar.scope == IN_REGION and is_missing:
            drawing.toggle()
        self._show_region()
        self._show_bar()

    def _which_chosen(self, which: str) -> None:
        for count in self._counts.values() if which == ADD_AGENTS else ():
            set_value(count, 0)
        self._show_counts()

    def _where_chosen(self) -> None:
        """Show the region where it counts, and let it be drawn where there is none."""
        is_drawn = self._where.value == IN_REGION
        self._show_region()
        if is_drawn != self._drawing.is_active and self._drawing.region is None:
            self._drawing.toggle()
        self._show_counts()

    def _region_changed(self) -> None:
        """Follow the mode: what is drawn is where to resample, until it is cleared."""
        drawing = self._drawing
        is_active = drawing.is_active
        set_property(
            self._draw_region, "label", STOP_DRAWING if is_active else DRAW_REGION
        )
        set_property(self._draw_region, "color", "orange" if is_active else "gray")
        if is_active or drawing.region is not None:
            set_value(self._where, IN_REGION)
        else:
            self._leave_region()
        self._show_region()
        self._show_counts()

    def _leave_region(self) -> None:
        """Make other choices where a region is chosen that is gone."""
        if self._where.value == IN_REGION:
            set_value(self._where, AROUND_TRAFFIC)
        if self.bar.scope == IN_REGION:
            self.bar.scope = SCOPE_USUAL

    def _show_region(self) -> None:
        """Show the drawn region where it counts."""
        self._drawing.set_shown(IN_REGION in (self._where.value, self.bar.scope))

    def _drawn_region(self) -> Region:
        """The drawn region."""
        if self._drawing.region is None:
            raise GenerationError(
                f"There is no region yet. Press '{DRAW_REGION}' and drag on the road, "
                f"or choose something else than '{IN_REGION}'."
            )
        return self._drawing.region

    def _region(self) -> Region | None:
        """Region in which states are sampled."""
        if self._where.value == IN_REGION:
            return self._drawn_region()
        if self._where.value == AROUND_VIEW:
            x, y = map(float, self._ui.client.camera.look_at[:2])
            return Region(center_m=(x, y), half_side_m=REGION_HALF_SIDE_M)
        return None

    def _start(
        self,
        base: Scenario,
        *,
        removed_ids: tuple[str, ...] = (),
        agent_ids: tuple[str, ...] = (),
        resampled_state_ids: tuple[str, ...] = (),
        num_new_agents: Mapping[AgentKind, int] | None = None,
        samples_num_agents: bool = False,
        is_cure: bool = False,
    ) -> None:
        offer = self._generators[self._model.value]
        samples_states = bool(
            resampled_state_ids or num_new_agents or samples_num_agents
        )
        region = self._region() if samples_states else None
        request = GenerationRequest(
            scenario=base.without_agents(removed_ids),
            agent_ids=agent_ids,
            num_new_agents=num_new_agents or {},
            samples_num_agents=samples_num_agents,
            resampled_state_ids=resampled_state_ids,
            moving_share=MOVING_SHARES[self._moving.value] if samples_states else None,
            only_on_road=samples_states and bool(self._only_on_road.value),
            back_casts=bool(self._back_casts.value),
            region=region,
            quality=QUALITIES[self._quality.value] if samples_states else "fast",
            num_samples=1 if is_cure else self.bar.samples,
            num_denoising_steps=None
            if offer.default_num_steps is None
            else int(self._steps.value),
            guidance=self._guidance_settings(offer),
            seed=self.bar.seed,
        )
        check_room(request, len(removed_ids))
        task = GenerationInput(
            base=base, request=request, removed_ids=removed_ids, is_cure=is_cure
        )
        self._check_guidance(request)
        self._start_run(task)

    def _start_run(self, task: RunInput) -> None:
        name = self._model.value
        self.result.start(name, self._generators[name].make, task)
        if self._renews.value:
            self.bar.seed += 1

    def _roll_out(self, duration_s: float, policy: str) -> None:
        """Let the scene go on in closed loop; an empty name lets no policy drive.

        Raises:
            LockedAgentError: what is locked could not be kept.
        """
        self._ui.commit_gesture()
        scenario = self._ui.session.scenario
        driven = self.closed_loop.driven_ids() if policy else ()
        held = tuple(
            name
            for name, lock in scenario.locks.items()
            if name in driven and lock.keeps != "state"
        )
        if held:
            raise locked_agents_error(scenario, held)
        task = RollOutInput(
            base=scenario,
            duration_s=duration_s,
            seed=self.bar.seed,
            policy=policy,
            driven_ids=driven,
        )
        self._start_run(task)

    def _check_guidance(self, request: GenerationRequest) -> None:
        """Say before the run which guidance cannot be met, and what could be done.

        Raises:
            GenerationError: nothing of what is asked could be met at all.
        """
        scenario = request.scenario
        if (
            request.terms
            and "guidance" not in self._generators[self._model.value].supports
        ):
            self._ui.notify(
                "Guidance has no effect",
                f"{self._model.value} takes no guidance terms.",
                "warning",
            )
            return
        ids = None if request.samples_states else request.agent_ids
        found = guidance_problems(scenario, scenario.guidance, ids)
        if ids is not None:
            # What was run before, and whose agents keep their motion, is met or missed already.
            unrun = unrun_terms(scenario, self._ui.session.commands_in_force)
            found = [
                one
                for one in found
                if one.term in unrun
                or not one.term.guided_ids
                or not set(ids).isdisjoint(one.term.guided_ids)
            ]
        if not found:
            return
        impossible = {one.term for one in found if one.severity == "error"}
        if impossible.issuperset(request.terms) and not request.samples_states:
            raise GenerationError(
                f"{found[0].message} No other guidance could be met; switch it off to "
                "regenerate without it."
            )
        count = len(found)
        title = "A guidance problem" if count == 1 else f"{count} guidance problems"
        more = "" if count == 1 else " The tab Agents lists the others."
        self._ui.notify(title, f"{found[0].message}{more}", "warning")

    def _guidance_settings(self, offer: GeneratorSpec) -> tuple[GuidanceSetting, ...]:
        """Settings of lanes and of the avoidance of collisions."""
        takes_tries = offer.default_num_tries is not None
        return guidance_settings(
            self._lane_weight(offer),
            int(self._tries.value) if takes_tries else None,
            yields=not takes_tries or bool(self._yields.value),
        )

    def _live_requests(self, scenario: Scenario) -> LiveRequests | None:
        """What is generated for an edit that led to a scenario; None if nothing reacts."""
        if not self.live_switch.is_on or self.result.is_running:
            return None
        ids = self.live_switch.reacting_ids(scenario)
        if not ids:
            return None
        name = self._model.value
        offer = self._generators[name]
        has_steps = offer.default_num_steps is not None
        has_tries = offer.default_num_tries is not None
        usual = GenerationRequest(
            scenario=scenario,
            agent_ids=ids,
            num_denoising_steps=int(self._steps.value) if has_steps else None,
            guidance=self._guidance_settings(offer),
            seed=self.bar.seed,
        )
        fast = replace(
            usual,
            # Denoising steps of trajectories that are regenerated during an edit.
            num_denoising_steps=3 if has_steps else None,
            guidance=guidance_settings(
                self._lane_weight(offer), 0 if has_tries else None
            ),
            reports_cost=False,
        )
        before = self._ui.session.committed_scenario
        return LiveRequests(
            generator=LazyGenerator(name=name, make=offer.make),
            draft=lambda edited: replace(
                fast, scenario=edited, agent_ids=nearest_to_edit(before, edited, ids)
            ),
            result=lambda edited: replace(usual, scenario=edited),
        )

    def _live_switched(self) -> None:
        self._ui.end_gesture()
        self._run_changed()
        if self.live_switch.is_on:
            check_future(self._ui.session.scenario)

    def _live_failed(self, error: PdEditorError) -> None:
        self._ui.notify("Not regenerated", str(error), "error")

    def _lane_weight(self, offer: GeneratorSpec) -> float | None:
        """Weight of the guidance; None for the model's default."""
        usual, asked = offer.default_guidance, float(self._guidance.value)
        return None if usual is None or abs(asked - usual) < 1e-6 else asked

    def _model_chosen(self) -> None:
        self.result.forget()
        self._show_options()

    def _show_options(self) -> None:
        """Offer what the chosen generator understands."""
        offer = self._generators[self._model.value]
        # One line whatever it is, so that nothing below moves.
        origin = one_line(offer.origin, 44)
        set_property(self._origin, "content", plain(origin))
        # Disabled, not hidden, so that elements below do not move.
        set_property(self._steps, "disabled", offer.default_num_steps is None)
        set_property(self._guidance, "disabled", offer.default_guidance is None)
        set_property(self._tries, "disabled", offer.default_num_tries is None)
        set_property(self._yields, "disabled", offer.default_num_tries is None)
        self._show_counts()
        if offer.default_num_tries is not None:
            set_value(self._tries, offer.default_num_tries)
        if offer.default_num_steps is not None:
            set_value(self._steps, offer.default_num_steps)
        if offer.default_guidance is not None:
            set_value(self._guidance, offer.default_guidance)

    def _show_counts(self) -> None:
        supports = self._generators[self._model.value].supports
        places = not supports.isdisjoint(("states", "new-agents"))
        which = self._which.value
        of_states = (self._which, self._moving, self._only_on_road, self._where)
        of_states = (*of_states, self._quality, self._draw_region, self._back_casts)
        for handle in of_states:
            set_property(handle, "disabled", not places)
        for handle in (self._keeps_focal, self._keeps_ego):
            set_property(handle, "disabled", not places or which != REPLACE_ALL)
        if which == REPLACE_ALL:
            self._count_present(self._ui.session.scenario)
        takes_counts = "new-agents" in supports and which != REDRAW_SELECTION
        set_property(self._fits, "disabled", not takes_counts)
        for count in self._counts.values():
            set_property(count, "disabled", not takes_counts)
            set_property(count, "visible", not self._fits.value)
        self._show_bar()

    def _count_present(self, scenario: Scenario) -> None:
        """Propose as many of each kind as there are on the mapped roads.

        A bare road keeps the numbers; without any, as many as fit are proposed.
        """
        is_same, self._counted = scenario is self._counted, scenario
        agents = scenario.agents
        present = agents.is_valid[:, scenario.current_step]
        if not (present & agents.kind_mask(ROAD_USER_KINDS)).any():
            if not is_same and not any(one.value for one in self._counts.values()):
                set_value(self._fits, True)
            return
        leaving = ids_near_lanes(scenario, self._replaced(scenario))
        leaves = np.isin(agents.ids, leaving)
        present = present & leaves
        for kind, count in self._counts.items():
            number = int((present & agents.kind_mask({kind})).sum())
            set_value(count, min(number, MAX_AGENTS_OF_A_KIND))

    def _replaced(self, scenario: Scenario) -> tuple[str, ...]:
        ids = replaceable_agent_ids(
            scenario,
            keeps_ego=bool(self._keeps_ego.value),
            keeps_focal=bool(self._keeps_focal.value),
        )
        ids = agent_ids_of_kinds(scenario, ids, self._wanted_kinds())
        if self._where.value == IN_REGION and self._drawing.region is not None:
            return self._drawing.region.held(scenario, ids)
        return ids

    def _may_resample(self) -> bool:
        """Whether the generator can do what is chosen under 'Replace'."""
        needed: Capability = (
            "states" if self._which.value == REDRAW_SELECTION else "new-agents"
        )
        return needed in self._generators[self._model.value].supports

    def _run_changed(self) -> None:
        """Show and tell the state of the run."""
        self.closed_loop.set_running(self.result.is_running)
        self._show_bar()
        self._tab.run_changed.emit()
