"""The intelligent driver model on the route: ``examples.policies.idm_on_route:Idm``."""

import numpy as np

from pd_editor.scene.policy import Controls, Observation
from pd_editor.scene.scenario import Scenario

WISH_MPS, HEADWAY_S, LEAST_GAP_M = 12.0, 1.5, 2.0
ACCELERATION_MPS2, BRAKING_MPS2 = 1.5, 2.0
HALF_LANE_M = 1.7


class Idm:
    """Steers to a point of the route, and keeps its distance (Treiber et al., 2000)."""

    name = "idm-example"

    def reset(
        self, scene: Scenario, ego_id: str, route_m: np.ndarray, seed: int
    ) -> None:
        """Nothing is remembered."""

    def plan(self, observation: Observation) -> Controls:
        """One acceleration and curvature for two seconds."""
        ego, route = observation.ego, observation.route_m
        place, heading = ego.position_m[0, -1], ego.heading_rad[0, -1]
        speed = float(np.hypot(*ego.velocity_mps[0, -1]))
        here = int(np.linalg.norm(route - place, axis=-1).argmin())

        # Pure pursuit of a point that is 0.8 s, at least 4 m ahead; points are 1 m apart.
        aim = route[min(here + max(round(0.8 * speed), 4), len(route) - 1)] - place
        left = np.cos(heading) * aim[1] - np.sin(heading) * aim[0]
        curvature = 2 * left / max(float(aim @ aim), 1.0)

        # The nearest agent on the next 60 m of the route.
        others, ahead = observation.others, route[here : here + 60]
        distance = np.linalg.norm(others.position_m[:, -1, None] - ahead, axis=-1)
        at = distance.argmin(axis=1)
        gap = at - (others.size_m[:, 0] + ego.size_m[0, 0]) / 2
        leads = (distance.min(axis=1) < HALF_LANE_M) & (at > 0)
        acceleration = 1 - (speed / WISH_MPS) ** 4
        if leads.any():
            leader = int(np.where(leads, gap, np.inf).argmin())
            closing = speed - float(np.hypot(*others.velocity_mps[leader, -1]))
            brake = 2 * np.sqrt(ACCELERATION_MPS2 * BRAKING_MPS2)
            wish = LEAST_GAP_M + max(speed * HEADWAY_S + speed * closing / brake, 0.0)
            acceleration -= (wish / max(float(gap[leader]), 0.5)) ** 2
        acceleration = float(np.clip(ACCELERATION_MPS2 * acceleration, -7.0, 2.0))
        count = round(2.0 / observation.step_s)
        return Controls(
            acceleration_mps2=np.full(count, acceleration),
            curvature_1pm=np.full(count, curvature),
        )
