"""A small torch network as a predictor: displacements out of an agent's last second.

    pd-editor generate signalised-junction --model examples.torch_predictor:Predictor \
        --out out

The network is not trained: put your own in its place and load its weights in
``__init__``, which runs once in each process.
"""

import numpy as np
import torch
from torch import nn

from pd_editor.scene.prediction import Prediction, PredictionRequest

NUM_PAST, NUM_FUTURE, NUM_MODES = 10, 60, 6


class Network(nn.Module):
    """Displacements [A, P, 2] to future displacements [A, K, F, 2] and logits [A, K]."""

    def __init__(self) -> None:
        """One hidden layer."""
        super().__init__()
        self.body = nn.Sequential(nn.Linear(2 * NUM_PAST, 64), nn.ReLU())
        self.head = nn.Linear(64, NUM_MODES * (2 * NUM_FUTURE + 1))

    def forward(self, past: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Predict what is added to the last displacement."""
        out = self.head(self.body(past.flatten(1))).unflatten(1, (NUM_MODES, -1))
        added = out[..., 1:].unflatten(-1, (NUM_FUTURE, 2))
        return past[:, None, -1:] + 0.01 * added, out[..., 0]


class Predictor:
    """Wraps the network: into each agent's frame, and back into the scene's."""

    name = "torch-example"

    def __init__(self) -> None:
        """Make the network; real ones load their weights here."""
        torch.manual_seed(0)
        self.network = Network().eval()

    def predict(self, request: PredictionRequest) -> Prediction:
        """Predict all agents in one batch; steps after the 60th repeat it."""
        agents, turn = request.agents, request.agents.heading_rad[:, -1]
        axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        past = request.step_s * agents.velocity_mps[:, -NUM_PAST:]
        past = np.einsum("ijA,AHj->AHi", axes, past).astype(np.float32)
        with torch.inference_mode():
            moves, logits = self.network(torch.from_numpy(past))
        steps = np.minimum(np.arange(request.num_steps), NUM_FUTURE - 1)
        moves_m = np.einsum("ijA,AKFi->AKFj", axes, moves.numpy()[:, :, steps])
        position = agents.position_m[:, -1, None, None] + moves_m.cumsum(axis=2)
        return Prediction(position_m=position, probability=logits.softmax(-1).numpy())
