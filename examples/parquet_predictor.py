"""Predictions made elsewhere, read from Parquet in Argoverse 2's submission form.

    PREDICTIONS=predictions.parquet pd-editor evaluate --data $AV2/val \
        --methods ground-truth examples.parquet_predictor:Predictor --out out

A row is one trajectory: scenario_id, track_id, probability, predicted_trajectory_x and
predicted_trajectory_y (city frame). Agents without a row keep their velocity.
"""

import os
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from pd_editor.base.errors import GenerationError
from pd_editor.scene.prediction import Prediction, PredictionRequest


class Predictor:
    """Looks trajectories up by scenario and agent."""

    name = "parquet-predictions"

    def __init__(self) -> None:
        """Read the file that the variable PREDICTIONS names."""
        path = Path(os.environ.get("PREDICTIONS", "predictions.parquet"))
        if not path.is_file():
            raise GenerationError(f"{path}: there are no predictions; set PREDICTIONS.")
        self.found: dict[tuple[str, str], list[tuple[float, np.ndarray]]] = {}
        for row in pq.read_table(path).to_pylist():
            xy = [row[f"predicted_trajectory_{axis}"] for axis in "xy"]
            key = (row["scenario_id"], row["track_id"])
            self.found.setdefault(key, []).append((row["probability"], np.array(xy).T))

    def predict(self, request: PredictionRequest) -> Prediction:
        """Trajectories of the file, cut or refused by their number of steps."""
        agents, num_modes = request.agents, request.num_modes
        shape = (len(agents.ids), num_modes, request.num_steps, 2)
        time_s = request.step_s * np.arange(1, request.num_steps + 1)[:, None]
        straight = agents.position_m[:, -1:] + time_s * agents.velocity_mps[:, -1:]
        position = np.broadcast_to(straight[:, None], shape).copy()
        probability = np.zeros(shape[:2])
        for row, name in enumerate(agents.ids):
            known = self.found.get((request.scenario_id, name), [])
            for mode, (weight, path) in enumerate(known[:num_modes]):
                position[row, mode] = path[: request.num_steps] - request.origin_city_m
                probability[row, mode] = weight
        return Prediction(position_m=position, probability=probability)
