"""FISS+ (Sun et al., 2023): ``examples.policies.fiss_plus:FissPlus``, extra ``policies``."""

import fiss_planner  # pyright: ignore[reportMissingImports]
import numpy as np

from pd_editor.scene.policy import Controls, Observation, Plan
from pd_editor.scene.scenario import Scenario

WISH_MPS, LANE_M, SEEN_M = 12.0, 3.5, 60.0


class FissPlus:
    """Plans in the Frenet frame of the route; others are expected to keep their speed."""

    name = "fiss-plus"

    def reset(
        self, scene: Scenario, ego_id: str, route_m: np.ndarray, seed: int
    ) -> None:
        """A line through every fifth point of the route, and a lane about it."""
        line = np.concatenate([route_m[:-1:5], route_m[-1:]])
        self._line = fiss_planner.ReferenceLine(*line.T)
        self._lane = fiss_planner.Corridor.parallel_lanes(
            0.0, self._line.length, LANE_M, 0, 0
        )
        self._planner = fiss_planner.make_planner(fiss_planner.make_config("fiss_plus"))

    def plan(self, observation: Observation) -> Plan | Controls:
        """The trajectory of least cost; brakes where there is none."""
        ego, others = observation.ego, observation.others
        x, y = ego.position_m[0, -1]
        heading, step_s = float(ego.heading_rad[0, -1]), observation.step_s
        speed = float(np.hypot(*ego.velocity_mps[0, -1]))
        gap = np.linalg.norm(others.position_m[:, -1] - (x, y), axis=-1)
        seen = [
            fiss_planner.predict_constant_velocity(
                int(row),
                *others.position_m[row, -1].tolist(),
                float(others.heading_rad[row, -1]),
                float(np.hypot(*others.velocity_mps[row, -1])),
                *others.size_m[row].tolist(),
                horizon=6.0,
                dt=step_s,
            )
            for row in np.flatnonzero(gap < SEEN_M)
        ]
        here = fiss_planner.EgoState(float(x), float(y), heading, speed)
        start = self._line.to_frenet(here)
        found = self._planner.plan(start, self._line, self._lane, seen, WISH_MPS)
        if not found.success:
            return Controls(
                acceleration_mps2=np.full(20, -4.0), curvature_1pm=np.zeros(20)
            )
        path = found.trajectory
        return Plan(
            position_m=np.stack([path.x, path.y], axis=-1)[1:],
            heading_rad=np.array(path.yaw)[1:],
        )
