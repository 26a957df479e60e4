"""What a request asks of the two stages, checked, with the settings of a model."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Int

from pd_editor.analysis.metrics.lanes import BEYOND_ROADS_M, ids_near_lanes
from pd_editor.base.errors import GenerationError
from pd_editor.generation.checkpoints.model_folder import TrainedStage
from pd_editor.generation.defaults import NUM_TRIES
from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.initial_state.pipeline import (
    InitialStateOptions,
    SquarePlacement,
)
from pd_editor.generation.initial_state.placement_rules import (
    ConflictSearch,
    PlacementRule,
)
from pd_editor.generation.initial_state.squares import limited, placings_of
from pd_editor.generation.trajectory.pipeline import TrajectoryOptions
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.generation import AVOIDANCE, LANE_GUIDANCE, GenerationRequest
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.scene_cut import FUTURE_S, is_long
from pd_editor.scene.scene_limits import MAX_AGENTS

MOST_AGENTS: Final = 500


def check_request(request: GenerationRequest) -> None:
    """Raise for requests that cannot be met.

    Raises:
        GenerationError: numbers, agents, states or times are not valid.
        EditError: an agent is not in the scenario.
    """
    scenario, agents = request.scenario, request.scenario.agents
    if len(set(request.agent_ids)) < len(request.agent_ids):
        raise GenerationError("An agent was requested twice; each may be named once.")
    if not set(request.resampled_state_ids) <= set(request.agent_ids):
        raise GenerationError(
            "Only agents whose trajectories are generated can get another state."
        )
    for setting in request.settings:
        if setting.name == LANE_GUIDANCE and not 0 <= setting.weight <= 1:
            raise GenerationError(
                f"The strength of the guidance to the lanes is {setting.weight:g}; "
                "expected 0 to 1."
            )
    strange = [kind for kind in request.num_new_agents if kind not in ROAD_USER_KINDS]
    if strange:
        raise GenerationError(f"The model places road users only, not {strange[0]}.")
    count = num_present(scenario)
    if count > MOST_AGENTS:
        raise GenerationError(
            f"The scene has {count} agents; the model takes {MOST_AGENTS}."
        )
    axis = scenario.time_axis
    if is_long(scenario):
        raise GenerationError(
            f"The scenario's future lasts {axis.future_s:.1f} s; "
            f"the model samples {FUTURE_S:g} s. Cut it: 'Keep {FUTURE_S:g} s after t = 0' "
            "under Scene; on the shell --until 6 (open_scenario: until_s=6)."
        )
    if not scenario.road_map.lanes:
        raise GenerationError("The scenario has no lanes; the model needs a road.")
    _check_states(request, agents.rows(request.agent_ids))


def num_present(scenario: Scenario) -> int:
    """Number of agents at the current step."""
    return int(scenario.agents.is_valid[:, scenario.current_step].sum())


def _check_states(request: GenerationRequest, rows: Int[np.ndarray, "G"]) -> None:
    agents, now = request.scenario.agents, request.scenario.current_step
    for row in rows:
        name = agents.ids[row]
        if name in request.resampled_state_ids:
            continue
        if not agents.is_valid[row, now]:
            raise GenerationError(
                f"Agent {name} is not there at the current step, so it has no state "
                "to go on from."
            )
        state = (*agents.position_m[row, now], *agents.velocity_mps[row, now])
        if not np.isfinite([*state, agents.heading_rad[row, now]]).all():
            raise GenerationError(
                f"Agent {name} has no finite state at the current step; expected one."
            )


def initial_state_options(
    request: GenerationRequest, stage: TrainedStage, rules: Sequence[PlacementRule]
) -> InitialStateOptions:
    """Options of the first stage; of raw states nothing is guided or sampled again."""
    sampler, guidance = stage.sampling["sampler"], stage.sampling["guidance"]
    resampling = stage.sampling["conflicts"]
    if request.quality == "high":
        sampler = replace(sampler, num_steps=2 * sampler.num_steps)
        versions = 2 * resampling.num_versions
        resampling = replace(resampling, num_versions=versions)
    if not request.refines_states:
        return InitialStateOptions(sampler=sampler, guidance=None)
    return InitialStateOptions(
        sampler=sampler,
        guidance=guidance,
        conflicts=ConflictSearch.of(resampling, guidance, rules),
    )


def trajectory_options(
    request: GenerationRequest, stage: TrainedStage
) -> TrajectoryOptions:
    """Options of the second stage."""
    sampler, guidance = stage.sampling["sampler"], stage.sampling["guidance"]
    if request.num_denoising_steps is not None:
        sampler = replace(sampler, num_steps=request.num_denoising_steps)
    lanes = request.setting(LANE_GUIDANCE)
    if lanes:
        guidance = replace(guidance, weight=lanes.weight, warped_weight=lanes.weight)
    return TrajectoryOptions(
        sampler=sampler,
        guidance=guidance,
        lane_agent_ids=lanes.agent_ids if lanes else (),
        terms=request.terms,
        term_guidance=stage.sampling["terms"],
        avoids=all(one.weight > 0 for one in request.settings if one.name == AVOIDANCE),
        samples_unguided=request.reports_cost,
        num_tries=max(_num_tries(request), 1),
        seed=request.scene_seed,
        drift=request.drift.place if request.drift else None,
    )


def yields(request: GenerationRequest) -> bool:
    """Whether agents that would collide yield."""
    avoids = request.setting(AVOIDANCE)
    wanted = avoids.parameters.get("yields", 1.0) if avoids else 1.0
    return bool(_num_tries(request)) and wanted > 0


def near_lanes(
    request: GenerationRequest,
) -> tuple[GenerationRequest, tuple[str, ...]]:
    """The request without resampling of agents beyond the mapped roads, and a note.

    If there are no others they are resampled, and with a region wherever they are.
    """
    ids = request.resampled_state_ids
    near = ids if request.region else ids_near_lanes(request.scenario, ids)
    count = len(ids) - len(near)
    if not count or not near:
        return request, ()
    keep = "keeps its state" if count == 1 else "keep their states"
    note = (
        f"{count} of {len(ids)} agents, more than {BEYOND_ROADS_M:g} m from all mapped "
        f"lanes, {keep}."
    )
    return replace(request, resampled_state_ids=near), (note,)


def requested_placings(
    stage: TrainedStage, request: GenerationRequest, sample: int
) -> tuple[tuple[SquarePlacement, ...], int]:
    """Agents to place in a sample, and the number of new ones that was asked for.

    Each sample may have another number of agents, at most as many as the model takes.
    """
    assert isinstance(stage.model, InitialStateDenoiser)
    random = np.random.default_rng([request.scene_seed, sample])
    density = stage.sampling["sampler"].fit_density
    placings = placings_of(stage.model, request, density, random)
    number = sum(len(one.new_ids) for one in placings)
    room = min(
        MOST_AGENTS - num_present(request.scenario),
        MAX_AGENTS - len(request.scenario.agents),
    )
    fitting = limited(placings, room, random)
    return tuple(
        replace(one, repairs=request.refines_states) for one in fitting
    ), number


def _num_tries(request: GenerationRequest) -> int:
    """Number of tries per trajectory; 0 if collisions are not avoided."""
    avoids = request.setting(AVOIDANCE)
    if not avoids:
        return NUM_TRIES
    wanted = int(avoids.parameters.get("tries", NUM_TRIES))
    return max(wanted, 0) if avoids.weight > 0 else 0
