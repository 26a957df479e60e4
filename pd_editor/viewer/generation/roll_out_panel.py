"""Rolls a scene out in closed loop: traffic that answers, around agents that policies drive."""

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Final

import viser

from pd_editor.base.errors import GenerationError
from pd_editor.editor.commands import Command
from pd_editor.editor.commands.command import agents_in_words
from pd_editor.experiments.closed_loop.policies import (
    ConstantVelocity,
    IdmOnRoute,
    LogReplay,
    installed_policies,
    policy_of,
)
from pd_editor.experiments.closed_loop.roll_out import (
    RollOut,
    RollOutRequest,
    roll_out,
    route_of,
)
from pd_editor.experiments.closed_loop.scores import drive_scores
from pd_editor.scene.generation import GenerationProgress
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.viewer.generation.generation_run import LazyGenerator, RunInput
from pd_editor.viewer.tab.panel_style import FixedText
from pd_editor.viewer.tab.ui_context import UiContext, set_property

NOBODY: Final = "None: traffic alone"
LENGTHS: Final = ("10 s", "30 s", "60 s")


@dataclass(frozen=True, kw_only=True, eq=False)
class RollOutInput(RunInput):
    """How long the scene is to go on, and which agents a policy drives."""

    duration_s: float
    seed: int
    policy: str
    driven_ids: tuple[str, ...]

    def steps(
        self, generator: LazyGenerator
    ) -> Generator[GenerationProgress, None, tuple[RollOut, str]]:
        """Roll out; ends with the roll-out and a report on it."""
        yield GenerationProgress(fraction=0.0, message=f"Preparing {generator.name}")
        policies = {name: policy_of(self.policy) for name in self.driven_ids}
        request = RollOutRequest(
            scenario=self.base,
            duration_s=self.duration_s,
            policies=policies,
            seed=self.seed,
        )
        rolled = yield from roll_out(request, generator.make())
        return rolled, self._report(rolled)

    def in_words(self, progress: GenerationProgress) -> str:
        """How far the roll-out is."""
        if not progress.fraction:
            return progress.message
        return f"Rolled out {progress.message}"

    def command(
        self,
        result: tuple[RollOut, str],
        index: int,  # noqa: ARG002
        edited: Scenario,  # noqa: ARG002
    ) -> Command:
        """The edit that makes the scene go on."""
        return result[0].command

    def applied(
        self,
        ui: UiContext,
        result: tuple[RollOut, str],
        index: int,  # noqa: ARG002
        command: Command,  # noqa: ARG002
        took_s: float,
    ) -> str:
        """Report on the roll-out, also in a notice: the report is far below the button."""
        rolled, report = result
        ui.workspace.driven_plans.append((rolled.command, rolled.plans_m))
        title = f"{self.duration_s:g} s rolled out"
        ui.notify(title, report, "warning" if rolled.failed else "success")
        return f"{title} in {took_s:.1f} s, seed {self.seed}: {report}"

    def _report(self, rolled: RollOut) -> str:
        """Who came and went, and how policies drove."""
        agents, now = rolled.scenario.agents, rolled.scenario.current_step
        there = agents.is_valid[:, now:]
        num_left = int((there.any(axis=1) & ~there[:, -1]).sum())
        parts = [f"{rolled.num_entered} entered, {num_left} left."]
        for name in self.driven_ids:
            if name not in rolled.failed:
                scores = drive_scores(rolled.scenario, name, route_of(self.base, name))
                parts.append(f"{self.policy} ({name}): {scores.in_words}.")
            parts.append(rolled.ended.get(name, ""))
        parts += [
            f"{one.term.in_words.capitalize()}: {one.achieved}."
            for one in rolled.guidance
        ]
        return " ".join(filter(None, parts))


class RollOutPanel:
    """The folder of roll-outs: how long, which policy, and whom it drives."""

    def __init__(self, ui: UiContext, start: Callable[[float, str], None]) -> None:
        """Build it; ``start`` is called with the seconds and the name of the policy."""
        self._ui = ui
        self._start = start
        gui = ui.client.gui
        shipped = (IdmOnRoute, LogReplay, ConstantVelocity)
        names = dict.fromkeys([*(one.name for one in shipped), *installed_policies()])
        with gui.add_folder("Roll out in closed loop", expand_by_default=False):
            self._length = gui.add_dropdown(
                "Duration", LENGTHS, hint="The scene goes on for so long"
            )
            self._policy = gui.add_dropdown(
                "Policy",
                (*names, NOBODY),
                hint="What drives; all others answer to it. idm: Intelligent Driver Model",
            )
            self._driven = FixedText(gui, 2)
            self._run = gui.add_button("Roll out", icon=viser.Icon.PLAYER_TRACK_NEXT)
        ui.on_click(self._run, self.roll_out)
        ui.on_change(self._policy, lambda _name: self.show())
        self.inputs = {"roll-out": self._length, "policy": self._policy}

    def show(self) -> None:
        """Say whom the policy drives."""
        policy, driven = self._policy.value, self.driven_ids()
        if policy == NOBODY:
            text = "The traffic goes on; nobody is driven."
        elif not driven:
            text = "There is no ego here: select the agent to be driven."
        elif self._ui.session.selection:
            each = "each of " * (len(driven) > 1)
            text = f"{policy} drives {each}{agents_in_words(driven)}: the selection."
        else:
            text = f"{policy} drives the ego, or the agents that you select."
        self._driven.show("", text)

    def driven_ids(self) -> tuple[str, ...]:
        """The selection, else the ego."""
        session = self._ui.session
        there = session.scenario.agents.row_of
        return session.selection or tuple(one for one in (EGO_ID,) if one in there)

    def set_running(self, is_running: bool) -> None:
        """Offer a roll-out unless a run is active."""
        set_property(self._run, "disabled", is_running)

    def roll_out(self) -> None:
        """Roll out with what is chosen.

        Raises:
            GenerationError: nobody is there to be driven, or a run is active.
        """
        policy = "" if self._policy.value == NOBODY else self._policy.value
        if policy and not self.driven_ids():
            raise GenerationError(
                f"Nobody is there to be driven; select an agent, or choose '{NOBODY}'."
            )
        self._start(float(self._length.value.split()[0]), policy)
