"""A policy whose acceleration a torch network decides: ``examples.policies.torch_policy:TorchPolicy``."""

import numpy as np
import torch

from pd_editor.scene.policy import Controls, Observation
from pd_editor.scene.scenario import Scenario


class TorchPolicy:
    """Steers to the route; a network of five numbers (untrained here) gives the speed."""

    name = "torch-policy"

    def __init__(self) -> None:
        torch.manual_seed(0)
        self._net = torch.nn.Sequential(
            torch.nn.Linear(5, 16), torch.nn.Tanh(), torch.nn.Linear(16, 1)
        )

    def reset(
        self, scene: Scenario, ego_id: str, route_m: np.ndarray, seed: int
    ) -> None:
        """Forget the former drive."""

    def plan(self, observation: Observation) -> Controls:
        """One decision that holds for two seconds."""
        ego = observation.ego
        place, heading = ego.position_m[0, -1], ego.heading_rad[0, -1]
        speed = float(np.hypot(*ego.velocity_mps[0, -1]))
        cos, sin = np.cos(heading), np.sin(heading)

        def seen(points: np.ndarray) -> np.ndarray:
            gap = points - place
            return np.stack([gap @ (cos, sin), gap @ (-sin, cos)], axis=-1)

        route = seen(observation.route_m)
        here = int(np.linalg.norm(route, axis=-1).argmin())
        aim = route[min(here + 4 + int(speed), len(route) - 1)]
        others = seen(observation.others.position_m[:, -1])
        ahead = others[(others[:, 0] > 0) & (np.abs(others[:, 1]) < 2.0)]
        gap = float(ahead[:, 0].min(initial=60.0))
        features = torch.tensor([speed / 10, gap / 60, *aim / 10, 1.0]).float()
        with torch.no_grad():
            wish = 2.0 * float(torch.tanh(self._net(features)))
        safe = min(wish, (0.5 * max(gap - 8.0, 0.0) - speed) / 1.0)
        count = round(2.0 / observation.step_s)
        return Controls(
            acceleration_mps2=np.full(count, max(safe, -6.0)),
            curvature_1pm=np.full(count, 2 * aim[1] / max(aim @ aim, 1.0)),
        )
