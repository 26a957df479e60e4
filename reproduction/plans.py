"""Evaluations behind the paper's tables: which methods, on which agents and roads."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

from pd_editor.experiments.evaluation.evaluation import EvaluationPlan
from pd_editor.experiments.evaluation.evaluation_task import (
    EvaluationTask,
    RoadCondition,
)
from pd_editor.experiments.evaluation.method import GROUND_TRUTH, Method
from pd_editor.scene.generation import ScenarioGenerator
from reproduction.systems import REFERENCES, STATES, TRAJECTORIES, Trained

Mode = Literal["", "unguided", "guided"]
PLAIN_ROADS: Final = (RoadCondition(),)


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One method of an evaluation: a trained model, guided or not, or a reference."""

    system: str
    seed: int
    mode: Mode
    method: Method


@dataclass(frozen=True, kw_only=True)
class Part:
    """One of the evaluations: its folder's name, entries and plan."""

    name: str
    entries: tuple[Entry, ...]
    plan: EvaluationPlan

    def folder(self, out: Path) -> Path:
        """Folder of its results."""
        return out / self.name


@dataclass(frozen=True, kw_only=True)
class PaperPlan:
    """The three evaluations: initial states, and trajectories of two sets of agents."""

    states: Part
    """Table II: agents that the paper's code keeps, on plain roads."""
    paper: Part
    """Tables III and IV, paper-compatible columns: agents that the paper's code keeps."""
    everyone: Part
    """Tables III and IV, corrected columns: all road users."""

    @property
    def parts(self) -> tuple[Part, ...]:
        """All evaluations."""
        return self.states, self.paper, self.everyone


def paper_plan(
    base: EvaluationPlan,
    trained: Sequence[Trained],
    make_generator: Callable[[str], ScenarioGenerator],
) -> PaperPlan:
    """The evaluations of some models, each in the tables of its own stages.

    ``base`` has data, road conditions of trajectories, samples and seed.
    """

    def entries(stage: str, references: Sequence[str]) -> tuple[Entry, ...]:
        def entry(system: str, seed: int, mode: Mode, name: str) -> Entry:
            method = Method(name=name, make_generator=make_generator)
            return Entry(system=system, seed=seed, mode=mode, method=method)

        # Yielding is no part of the network: without it in both modes.
        options: dict[Mode, str] = {
            "unguided": ":raw=1",
            "guided": "" if stage == STATES else ":tries=0",
        }
        return (
            *(entry(name, 0, "", name) for name in references),
            *(
                entry(one.system, one.seed, mode, one.method + text)
                for one in trained
                if stage in one.stages
                for mode, text in options.items()
            ),
        )

    def part(
        name: str,
        entries: tuple[Entry, ...],
        task: EvaluationTask,
        roads: tuple[RoadCondition, ...],
    ) -> Part:
        methods = tuple(one.method for one in entries)
        plan = replace(base, methods=methods, task=task, conditions=roads)
        return Part(name=name, entries=entries, plan=plan)

    driven = entries(TRAJECTORIES, REFERENCES)
    return PaperPlan(
        states=part(
            "states",
            entries(STATES, (GROUND_TRUTH,)),
            EvaluationTask(states="sampled", agents="paper"),
            PLAIN_ROADS,
        ),
        paper=part(
            "trajectories-paper-agents",
            driven,
            EvaluationTask(agents="paper"),
            base.conditions,
        ),
        everyone=part(
            "trajectories-all-agents", driven, EvaluationTask(), base.conditions
        ),
    )
