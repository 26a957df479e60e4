"""Initial states sampled on real maps: how good they are, and how long they take.

Reads full scenes under PD_EDITOR_AV2; recorded counts and kinds in the square of
half side 62 m around the focal agent. Beside samples stand the recorded agents of the
other split, which is how far real traffic is from other real traffic. ``python -m benchmarks.initial_states
[--model FOLDER] [--split train|val|all] [--samples 3] [--steps 10]``.
"""

import argparse
import os
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from pd_editor.analysis.metrics.box_overlaps import (
    box_overlap,
    init_collision_2m,
    local_density,
    nearest_distance,
)
from pd_editor.analysis.metrics.distribution_distance import HISTOGRAMS, noise_floor
from pd_editor.analysis.metrics.lanes import nearest_edge, off_lane_values
from pd_editor.analysis.metrics.motion import motion_values
from pd_editor.analysis.metrics.traffic_view import (
    TrafficView,
    generated_traffic,
    recorded_traffic,
)
from pd_editor.analysis.metrics.values import MetricValues
from pd_editor.analysis.repair.state_repairs import (
    project_to_lanes,
    separate_overlaps,
    slow_for_gaps,
)
from pd_editor.base.installed_files import models_folder
from pd_editor.experiments.evaluation.evaluation_task import paper_init_agents
from pd_editor.experiments.evaluation.report.realism import STATE_METRICS
from pd_editor.generation.checkpoints.model_folder import load_model
from pd_editor.generation.core.devices import keep_freed_memory, lay_out_weights
from pd_editor.generation.core.random_streams import RandomStreams
from pd_editor.generation.features.scene_features import (
    packed,
    scene_center,
    scene_features,
)
from pd_editor.generation.features.scene_fields import LATENT_SIZE
from pd_editor.generation.generators import SHIPPED_MODEL
from pd_editor.generation.initial_state.attributes import (
    AttributeRequest,
    with_attributes,
)
from pd_editor.generation.initial_state.guidance import InitialStateGuidance
from pd_editor.generation.initial_state.network.conditioning import (
    CONDITIONED_NO,
    sampling_conditioning,
)
from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.initial_state.network.state_encoding import POSITION_UNIT_M
from pd_editor.generation.initial_state.sampler import (
    InitialStateSamplerConfig,
    finished_states,
    sample_initial_states,
)
from pd_editor.generation.inputs import SceneTensors, batch_of
from pd_editor.generation.stages import INITIAL_STATES, STAGE_KINDS
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.generation import TrafficSample, scene_seed
from pd_editor.scene.scenario import Scenario

Values = dict[str, MetricValues]


@dataclass(frozen=True, kw_only=True, eq=False)
class RealScene:
    """A recorded scene with the road users in its square only."""

    scenario: Scenario
    tensors: SceneTensors
    center_m: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled:
    """A sample, and who of it was not meant to be off the road."""

    sample: TrafficSample
    may_be_projected: tuple[str, ...]


def pooled(values: Iterable[MetricValues]) -> np.ndarray:
    """Valid values of several scenes, concatenated."""
    return np.concatenate([np.zeros(0), *(one.valid() for one in values)])


def real_scenes(split: str, *, only_paper_agents: bool) -> list[RealScene]:
    """Full scenes of one split, or of all."""
    root = Path(os.environ["PD_EDITOR_AV2"])
    splits = ("train", "val") if split == "all" else (split,)
    folders = sorted(
        path.parent
        for name in splits
        for path in (root / name).glob("*/scenario*.parquet")
    )
    scenes = []
    for folder in folders:
        scenario = read_scenario(folder)
        scene = _real_scene(scenario, only_paper_agents)
        if scene is not None:
            scenes.append(scene)
    return scenes


def _real_scene(scenario: Scenario, only_paper_agents: bool) -> RealScene | None:
    view = recorded_traffic(scenario)
    center = scene_center(scenario)
    offset = np.abs(view.agents.position_m[:, 0] - center).max(axis=1)
    kept = offset <= POSITION_UNIT_M
    if only_paper_agents:
        kept &= paper_init_agents(view)
    if not kept.any():
        return None
    ids = [name for name, keep in zip(view.agents.ids, kept, strict=True) if keep]
    rows = scenario.agents.rows(ids)
    scenario = replace(
        scenario, agents=scenario.agents.taken(rows), focal_id=scenario.focal_id
    )
    found = scene_features(scenario, with_candidates=False, center_m=center)
    return RealScene(
        scenario=scenario,
        tensors=batch_of([packed(found, _no_latents)]),
        center_m=center,
    )


def _no_latents(future_m: np.ndarray, speed_mps: np.ndarray) -> np.ndarray:
    """The stage of initial states reads no futures."""
    return np.zeros((*future_m.shape[:-2], LATENT_SIZE))


def sampled(
    model: InitialStateDenoiser,
    scene: RealScene,
    samples: int,
    config: InitialStateSamplerConfig,
    guidance: InitialStateGuidance | None,
    attributes: AttributeRequest,
) -> list["Sampled"]:
    """Samples of the states of everybody in a scene."""
    found = [
        _sampled_states(model, scene, sample, config, guidance, attributes)
        for sample in range(samples)
    ]
    agents = scene.scenario.agents
    return [
        Sampled(
            may_be_projected=tuple(
                name
                for name, code in zip(agents.ids, on_road, strict=True)
                if code != CONDITIONED_NO
            ),
            sample=TrafficSample(
                ids=agents.ids,
                kinds=agents.kinds,
                size_m=agents.size_m,
                position_m=(one[:, None, :2] + scene.center_m),
                heading_rad=np.arctan2(one[:, 3], one[:, 2])[:, None],
                velocity_mps=(one[:, 2:4] * one[:, 4:])[:, None],
            ),
        )
        for one, on_road in found
    ]


def _sampled_states(
    model: InitialStateDenoiser,
    real: RealScene,
    sample: int,
    config: InitialStateSamplerConfig,
    guidance: InitialStateGuidance | None,
    attributes: AttributeRequest,
) -> tuple[np.ndarray, list[int]]:
    """States, and what was told of being on the road."""
    scene = real.tensors
    key = scene_seed(0, real.scenario.scenario_id)
    random = np.random.default_rng([key, sample])
    task = with_attributes(
        sampling_conditioning(scene), scene, model.agent_counts, [random], attributes
    )
    steps = sample_initial_states(
        model,
        scene,
        RandomStreams(key, "states", [sample]),
        task,
        config=config,
        guide=None if guidance is None else guidance.of(scene, model.schedule, task),
    )
    *_, last = steps
    states = finished_states(scene, task, last.clean)[0, 0].double().numpy()
    return states, task.on_road[0].tolist()


def repaired(scenario: Scenario, found: Sampled) -> Sampled:
    """A sample after all repairs of states."""
    sample = found.sample
    agents, step = scenario.agents, scenario.current_step
    states = {
        "position_m": sample.position_m[:, 0],
        "heading_rad": sample.heading_rad[:, 0],
        "velocity_mps": sample.velocity_mps[:, 0],
    }
    arrays = {name: getattr(agents, name).copy() for name in states}
    for name, values in states.items():
        arrays[name][:, step] = values
    rows = np.arange(len(agents))
    mended = scenario.with_agents(agents.with_rows(rows, **arrays))
    mended = project_to_lanes(mended, found.may_be_projected)
    mended = separate_overlaps(mended)
    mended = slow_for_gaps(mended)
    now = mended.agents
    mended_sample = replace(
        sample,
        position_m=now.position_m[:, step : step + 1],
        heading_rad=now.heading_rad[:, step : step + 1],
        velocity_mps=now.velocity_mps[:, step : step + 1],
    )
    return replace(found, sample=mended_sample)


def load_pose_model(folder: Path) -> InitialStateDenoiser:
    """The first stage's network, prepared as by ``PathDiffuser``."""
    keep_freed_memory()
    model = load_model(folder, STAGE_KINDS).stage(INITIAL_STATES.name).model
    assert isinstance(model, InitialStateDenoiser)
    lay_out_weights(model)
    return model


def state_values(view: TrafficView) -> Values:
    """Metrics of states, one row per agent."""
    speed = motion_values(view)["speed"]
    movers = view.agents.is_in("movers")
    values = (
        init_collision_2m(view),
        box_overlap(view).at_state(),
        off_lane_values(view)["init_off_road_4m"],
        *nearest_edge(view),
        nearest_distance(view),
        local_density(view),
        speed,
    )
    # As in the reports: distributions are those of movers.
    return {
        one.name: one.taken(movers) if one.name in STATE_METRICS else one
        for one in values
    }


def summary(name: str, scenes: Sequence[Values], recorded: Sequence[Values]) -> str:
    """A line of the table."""

    def mean(metric: str) -> float:
        return 100 * float(pooled(scene[metric] for scene in scenes).mean())

    values = {key: pooled(scene[key] for scene in scenes) for key in STATE_METRICS}
    cells = [f"{mean(key):6.2f}" for key in ("init_collision_2m", "init_overlap")]
    cells.append(f"{mean('init_off_road_4m'):6.2f}")
    cells.append(f"{values['nearest_edge'].mean():6.2f}")
    cells.append(f"{np.median(np.abs(values['nearest_edge_angle'])):6.2f}")
    cells.append(f"{np.mean(np.abs(values['nearest_edge_angle'])):6.2f}")
    cells.append(f"{100 * np.mean(values['speed'] > 0.5):6.1f}")
    moving = values["speed"][values["speed"] > 0.5]
    cells.append(f"{np.median(moving) if len(moving) else 0:6.2f}")
    for histogram in HISTOGRAMS:
        if histogram.metric in STATE_METRICS and histogram.source == "ours":
            real = pooled(scene[histogram.metric] for scene in recorded)
            found = histogram.distance(values[histogram.metric], real)
            cells.append(f"{found.root:6.3f}")
    return f"{name:22s}" + " ".join(cells)


def floor_line(recorded: Sequence[Values]) -> str:
    """Distances between recordings and recordings."""
    cells = []
    for histogram in HISTOGRAMS:
        if histogram.metric in STATE_METRICS and histogram.source == "ours":
            scenes = [scene[histogram.metric] for scene in recorded]
            agents = sum(len(scene) for scene in scenes)
            floor = noise_floor(
                scenes,
                lambda one, two, bins=histogram: bins.distance(one, two).root,
                num_agents=agents,
            )
            cells.append(f"{floor:6.3f}")
    return f"{'noise floor':22s}" + " " * 56 + " ".join(cells)


def print_table(
    model: InitialStateDenoiser,
    scenes: Sequence[RealScene],
    others: Sequence[RealScene],
    samples: int,
    configs: dict[str, InitialStateSamplerConfig],
    attributes: AttributeRequest,
    *,
    repairs: bool,
) -> None:
    """Everything beside the recordings."""
    print(f"{len(scenes)} scenes, {sum(len(s.scenario.agents) for s in scenes)} agents")
    print(
        " " * 22 + " coll2 overlp off4m%   edge medang meanan  move%  speed"
        "   near   dens   edge  angle  speed (JSD roots)"
    )
    recorded = [state_values(recorded_traffic(scene.scenario)) for scene in scenes]
    print(summary("recorded", recorded, recorded))
    # The bound for states whose boxes do not overlap.
    apart = [separate_overlaps(scene.scenario) for scene in scenes]
    line = [state_values(recorded_traffic(one)) for one in apart]
    print(summary("recorded, slid apart", line, recorded))
    if others:
        line = [state_values(recorded_traffic(one.scenario)) for one in others]
        print(summary("recorded, other split", line, recorded))
    print(floor_line(recorded))
    for name, config in configs.items():
        for guidance in (
            None,
            InitialStateGuidance().within_lanes()
            if attributes.only_on_road
            else InitialStateGuidance(),
        ):
            label = name if guidance is None else f"{name} guided"
            found = [
                sampled(model, scene, samples, config, guidance, attributes)
                for scene in scenes
            ]
            print(summary(label, _measured(scenes, found), recorded), flush=True)
            if repairs:
                found = [
                    [repaired(scene.scenario, one) for one in some]
                    for scene, some in zip(scenes, found, strict=True)
                ]
                line = summary(f"{label} repaired", _measured(scenes, found), recorded)
                print(line, flush=True)


def _measured(
    scenes: Sequence[RealScene], found: Sequence[Sequence[Sampled]]
) -> list[Values]:
    return [
        state_values(generated_traffic(scene.scenario, one.sample))
        for scene, some in zip(scenes, found, strict=True)
        for one in some
    ]


def print_times(
    model: InitialStateDenoiser, scenes: Sequence[RealScene], num_steps: int
) -> None:
    """Milliseconds for one sample of 32 agents, raw and guided."""
    scene = max(scenes, key=lambda one: len(one.scenario.agents)).tensors
    rows = torch.arange(32) % scene.has_agent.shape[1]
    names = ("pose", "speed", "size", "kind", "activity")
    fields = ("has_agent", *(f"agent_{name}" for name in names))
    scene = replace(scene, **{name: getattr(scene, name)[:, rows] for name in fields})
    config = InitialStateSamplerConfig(num_steps=num_steps)
    for guidance in (None, InitialStateGuidance()):
        spent = []
        for repeat in range(15):
            start = time.perf_counter()
            guide = None if guidance is None else guidance.of(scene, model.schedule)
            streams = RandomStreams(0, "states", [repeat])
            for _ in sample_initial_states(
                model, scene, streams, config=config, guide=guide
            ):
                pass
            spent.append(1e3 * (time.perf_counter() - start))
        quarters = np.quantile(spent, [0.25, 0.5, 0.75])
        print(
            f"32 agents, {scene.has_piece.sum()} pieces, {num_steps} steps"
            f"{'' if guidance is None else ', guided'}: median {quarters[1]:.1f} ms, "
            f"quartiles {quarters[0]:.1f} - {quarters[2]:.1f}, min {min(spent):.1f}"
        )


def main() -> None:
    """Print the table and the time."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--model", type=Path, default=models_folder() / SHIPPED_MODEL)
    parser.add_argument("--split", default="train")
    parser.add_argument("--samples", type=int, default=3)
    parser.add_argument(
        "--steps", type=int, nargs="+", default=[InitialStateSamplerConfig().num_steps]
    )
    parser.add_argument("--paper-agents", action="store_true")
    parser.add_argument("--no-repair", action="store_true")
    options = parser.parse_args()
    model = load_pose_model(options.model)
    scenes = real_scenes(options.split, only_paper_agents=options.paper_agents)
    other = {"train": "val", "val": "train"}.get(options.split)
    others = real_scenes(other, only_paper_agents=options.paper_agents) if other else []
    configs = {
        f"{steps} steps": InitialStateSamplerConfig(num_steps=steps)
        for steps in options.steps
    }
    # The agents that the paper's filter keeps are on the road.
    attributes = AttributeRequest(only_on_road=options.paper_agents)
    repairs = not options.no_repair
    print_table(
        model, scenes, others, options.samples, configs, attributes, repairs=repairs
    )
    for steps in options.steps:
        print_times(model, scenes, steps)


if __name__ == "__main__":
    main()
