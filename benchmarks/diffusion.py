"""Second stage on 32 moving agents of a real scenario: time of each part.

Parts are timed with random weights, which takes the same time. Reads the train and val folders under
PD_EDITOR_AV2.
"""

import itertools
import statistics
import time
from collections.abc import Callable

import numpy as np
import torch

from benchmarks.candidates import crowd, full_scenarios, movers_now
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.generation.features.scene_features import packed, scene_features
from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.generation.inputs import batch_of
from pd_editor.generation.trajectory.loss import trajectory_loss
from pd_editor.generation.trajectory.network.denoiser import (
    TrajectoryConfig,
    TrajectoryDenoiser,
)
from pd_editor.generation.trajectory.task import TrajectoryTask
from pd_editor.scene.generation import (
    AVOIDANCE,
    GenerationRequest,
    GuidanceSetting,
    run_to_end,
)
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario
from tests.generation.trajectory.scenes import arc_basis

NUM_AGENTS = 32
REPEATS = 40


def told(
    name: str,
    work: Callable[..., object],
    repeats: int = REPEATS,
    prepare: Callable[[], tuple] = tuple,
) -> None:
    """Print median, least and spread of the time of something.

    It takes what ``prepare`` gives before each run, which is not timed.
    """
    for _ in range(3):
        work(*prepare())
    times = []
    for _ in range(repeats):
        given = prepare()
        began = time.perf_counter()
        work(*given)
        times.append(1e3 * (time.perf_counter() - began))
    quarters = statistics.quantiles(times, n=4)
    print(
        f"{name:52s} {quarters[1]:8.2f} {min(times):8.2f} "
        f"{quarters[0]:8.2f} - {quarters[2]:.2f}"
    )


def print_parts(model: TrajectoryDenoiser, scenario: Scenario) -> None:
    """Features, context, one denoising step."""
    basis = model.decoder.basis
    rows = np.arange(NUM_AGENTS)
    told("features and candidates", lambda: scene_features(scenario))
    told(
        "the same, packed as tensors", lambda: TrajectoryTask.of(scenario, rows, basis)
    )
    scene = TrajectoryTask.of(scenario, rows, basis).scene
    with torch.inference_mode():
        told("context", lambda: model.encode_context(scene))
        context = model.encode_context(scene)
        level = model.encode_level(torch.full((1, 1, 1), 0.5))
        for samples, threads in itertools.product((1, 4, 6), (1, 2)):
            torch.set_num_threads(threads)
            noisy = torch.randn(samples, *scene.future.shape)
            told(
                f"denoising step, {samples} samples, {threads} threads",
                lambda noisy=noisy: model.denoise(noisy, level, context),
            )


def print_first_requests(scenario: Scenario) -> None:
    """Default requests for a real scene that was just opened: nothing is kept."""
    diffuser = make_generator(DEFAULT_GENERATOR)

    def opened(*, has_new_states: bool = False) -> tuple[GenerationRequest]:
        fresh = open_scenario(scenario.provenance.source)
        ids = drivable_agent_ids(fresh)
        return (
            GenerationRequest(
                scenario=fresh,
                agent_ids=ids,
                resampled_state_ids=ids if has_new_states else (),
            ),
        )

    def run(request: GenerationRequest) -> None:
        run_to_end(diffuser.generate(request))

    number = len(opened()[0].agent_ids)
    told(f"first request, trajectories of {number} agents", run, 12, opened)
    told(
        f"first request, states and trajectories of {number}",
        run,
        12,
        lambda: opened(has_new_states=True),
    )


def print_generation(scenario: Scenario) -> None:
    """From states to trajectories through the port, guided, with the default weights.

    Without tries, trajectories stay as sampled; else agents that would collide yield.
    """
    diffuser = make_generator(DEFAULT_GENERATOR)
    for tries in (0, 1, 4):
        for steps in (4, 10):
            request = GenerationRequest(
                scenario=scenario,
                agent_ids=scenario.agents.ids,
                num_denoising_steps=steps,
                guidance=(
                    GuidanceSetting(name=AVOIDANCE, parameters={"tries": float(tries)}),
                ),
            )
            told(
                f"states to trajectories, {steps} steps, {tries} tries",
                lambda request=request: run_to_end(diffuser.generate(request)),
            )


def print_training(model: TrajectoryDenoiser, scenarios: list[Scenario]) -> None:
    """A step on 16 real scenes at four noise levels, forward and backward."""
    basis = model.decoder.basis
    scenes = [packed(scene_features(one), basis.encode) for one in scenarios]
    batch = batch_of([one for one in scenes if len(one.agent_pose) <= 24][:16])
    random = torch.Generator().manual_seed(0)

    def step() -> None:
        with torch.autocast("cpu", torch.bfloat16):
            loss, _ = trajectory_loss(model, batch, random)
        loss.backward()

    told("training step, 16 scenes x 24 agents x 4 levels, bf16", step, 8)


def main() -> None:
    """Print a table of milliseconds."""
    torch.set_num_threads(2)
    scenarios = full_scenarios()
    busiest = max(scenarios, key=lambda one: len(movers_now(one, 0.5)))
    scenario = crowd(busiest, NUM_AGENTS)
    torch.manual_seed(0)
    config = TrajectoryConfig()
    model = TrajectoryDenoiser(config, arc_basis())
    print(f"{'milliseconds, 2 threads':52s} {'median':>8s} {'min':>8s} quartiles")
    print_parts(model.eval(), scenario)
    print_first_requests(busiest)
    print("Below, one request is repeated, and its features and candidates are kept:")
    print_generation(scenario)
    print_training(model, scenarios)


if __name__ == "__main__":
    main()
