"""The shipped model as planner: ``examples.policies.model_as_planner:ModelPlanner``."""

from dataclasses import replace

import numpy as np

from pd_editor.generation.generators import make_generator
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.agent_tracks import AgentCategory, AgentTracks
from pd_editor.scene.generation import GenerationRequest, run_to_end
from pd_editor.scene.policy import Observation, Plan
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.time_axis import TimeAxis

NUM_FUTURE = 60
ARRAYS = ("position_m", "heading_rad", "velocity_mps", "is_valid")


class ModelPlanner:
    """Samples what all agents do next; the driven one does its part."""

    name = "model-as-planner"

    def __init__(self) -> None:
        self._generator = make_generator("path-diffuser")  # Or a predictor's name.

    def reset(
        self, scene: Scenario, ego_id: str, route_m: np.ndarray, seed: int
    ) -> None:
        """Keep the map and the seed; the recorded future is not looked at."""
        self._scene, self._seed = scene, seed

    def plan(self, observation: Observation) -> Plan:
        """Six seconds from the present states, since the model knows no history."""
        both = observation.ego, observation.others
        tracks = {}
        for name in ARRAYS:
            now = np.concatenate([getattr(one, name)[:, -1:] for one in both])
            tracks[name] = np.pad(now, [(0, 0), (0, NUM_FUTURE), (0, 0)][: now.ndim])
        ids = (*observation.ego.ids, *observation.others.ids)
        agents = AgentTracks(
            ids=ids,
            kinds=(*observation.ego.kinds, *observation.others.kinds),
            categories=(AgentCategory.UNSCORED,) * len(ids),
            size_m=np.concatenate([one.size_m for one in both]),
            has_known_size=np.ones(len(ids), bool),
            observed=tracks["is_valid"],
            **tracks,
        )
        axis = TimeAxis(num_steps=1 + NUM_FUTURE, current_step=0)
        cleared = replace(self._scene, locks={}, guidance=(), signals=())
        scene = replace(cleared, agents=agents, focal_id=ids[0], time_axis=axis)
        rows = np.flatnonzero(agents.kind_mask(ROAD_USER_KINDS))
        request = GenerationRequest(
            scenario=scene, agent_ids=tuple(ids[row] for row in rows), seed=self._seed
        )
        (sample,) = run_to_end(self._generator.generate(request)).samples
        position, heading = sample.position_m[0, 1:], sample.heading_rad[0, 1:]
        return Plan(position_m=position, heading_rad=heading)
