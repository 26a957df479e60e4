"""Tiny scenarios on disk, generators whose answers are known, and a plain engine."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pd_editor.experiments.evaluation.evaluation import EvaluationPlan
from pd_editor.experiments.evaluation.evaluation_task import road_conditions
from pd_editor.experiments.evaluation.method import Method
from pd_editor.experiments.work_engine.work_engine import WorkResult, failure_of
from pd_editor.scene.av2_io.map_file import map_bytes
from pd_editor.scene.av2_io.write import tracks_bytes
from pd_editor.scene.generation import GeneratedTraffic, TrafficSample
from pd_editor.scene.scenario import Scenario
from tests.builders import scenario_with, straight_drivers

COLLIDING = [(0.0, 0.0, 0.0, 10.0), (20.0, 0.0, 0.0, 0.0)]
PASSING = [(0.0, 0.0, 0.0, 10.0), (0.0, 3.5, 0.0, 10.0), (30.0, 0.0, 0.0, 10.0)]


def write_scenario(root: Path, split: str, name: str, scenario: Scenario) -> Path:
    folder = root / split / name
    folder.mkdir(parents=True)
    named = replace(scenario, scenario_id=name)
    (folder / f"scenario_{name}.parquet").write_bytes(tracks_bytes(named))
    (folder / f"log_map_archive_{name}.json").write_bytes(
        map_bytes(named.road_map, named.origin_city_m)
    )
    return folder


def write_dataset(root: Path) -> Path:
    """Three scenes in two splits: one collides, two pass."""
    for split, name, states in (
        ("train", "aaa", COLLIDING),
        ("train", "bbb", PASSING),
        ("val", "ccc", PASSING),
    ):
        agents = straight_drivers(states)
        write_scenario(root, split, name, scenario_with(agents))
    return root


def without_future(scenario: Scenario) -> Scenario:
    there = scenario.agents.is_valid.copy()
    there[:, scenario.current_step + 1 :] = False
    return scenario.with_agents(replace(scenario.agents, is_valid=there))


@dataclass(frozen=True)
class Sideways:
    """Everybody stays and slides 1 m to the left at once, sample k by k m more.

    Its name says what else goes wrong.
    """

    name: str

    def generate(self, request):
        yield from ()
        if self.name == "raises":
            raise ZeroDivisionError("a generator's bug")
        if self.name == "raises-on-bbb" and request.scenario.scenario_id == "bbb":
            raise ZeroDivisionError("not this one")
        agents, axis = request.scenario.agents, request.scenario.time_axis
        rows = agents.rows(request.agent_ids)
        steps = axis.num_future_steps + (0 if self.name == "short" else 1)
        num = request.num_samples - (self.name == "few")
        samples = [self._sample(request, agents, rows, steps, k) for k in range(num)]
        return GeneratedTraffic(
            samples=tuple(samples), generator=self.name, model_sha256="abc123"
        )

    def _sample(self, request, agents, rows, steps, number):
        step = request.scenario.current_step
        position = np.repeat(agents.position_m[rows, step, None], steps, axis=1)
        position[:, 1:, 1] += 1.0 + number
        sample = TrafficSample(
            ids=request.agent_ids[::-1] if self.name == "others" else request.agent_ids,
            kinds=tuple(agents.kinds[row] for row in rows),
            size_m=agents.size_m[rows],
            position_m=position,
            heading_rad=np.repeat(agents.heading_rad[rows, step, None], steps, axis=1),
            velocity_mps=np.zeros_like(position),
        )
        if self.name == "nan":
            position[0, 1] = np.nan
        return sample


def make_sideways(name: str) -> Sideways:
    return Sideways(name)


def methods(*names: str) -> tuple[Method, ...]:
    return tuple(Method(name=name, make_generator=make_sideways) for name in names)


def plan_for(root: Path, *names: str, **changes: Any) -> EvaluationPlan:
    options: dict[str, Any] = {"num_samples": 2, "seed": 0} | changes
    conditions = road_conditions(options.pop("warps", ("none",)))
    return EvaluationPlan(
        data=(root,), methods=methods(*names), conditions=conditions, **options
    )


class OneByOne:
    """An engine in this process; stops after some items as if it were killed."""

    def __init__(self, stop_after: int | None = None) -> None:
        self.stop_after = stop_after
        self.keys: list[str] = []

    def run(
        self,
        function: Callable,
        items: Mapping,
        *,
        on_result: Callable[[WorkResult], None],
        on_wait: Callable[[], None] = lambda: None,
    ) -> None:
        for key, item in items.items():
            if self.stop_after is not None and len(self.keys) >= self.stop_after:
                raise KeyboardInterrupt
            self.keys.append(key)
            try:
                result = WorkResult(key=key, value=function(item))
            except Exception as error:  # noqa: BLE001
                result = WorkResult(key=key, failure=failure_of(error))
            on_result(result)
