"""A predictor in a few lines: each agent keeps its velocity, or brakes to a stop.

pd-editor generate signalised-junction --model examples.constant_velocity:Predictor --out out
pd-editor evaluate --data $AV2/val --methods ground-truth examples.constant_velocity:Predictor --out out
"""

import numpy as np

from pd_editor.scene.prediction import Prediction, PredictionRequest

BRAKING_MPS2 = 3.0


class Predictor:
    """Two trajectories of each agent: constant velocity (70 %) and braking (30 %)."""

    name = "constant-velocity-or-braking"

    def predict(self, request: PredictionRequest) -> Prediction:
        """Predict from the state at the current step alone."""
        agents = request.agents
        time_s = request.step_s * np.arange(1, request.num_steps + 1)
        velocity = agents.velocity_mps[:, -1]
        speed = np.maximum(np.hypot(*velocity.T), 1e-6)[:, None]
        stops_s = np.minimum(time_s, speed / BRAKING_MPS2)
        braked_s = stops_s - BRAKING_MPS2 * stops_s**2 / (2 * speed)
        driven_s = np.stack([np.broadcast_to(time_s, stops_s.shape), braked_s], axis=1)
        return Prediction(
            position_m=agents.position_m[:, -1, None, None]
            + driven_s[..., None] * velocity[:, None, None],
            probability=np.tile([0.7, 0.3], (len(agents.ids), 1)),
        )
