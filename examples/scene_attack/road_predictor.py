r"""A small predictor that sees its route, for the worked example of docs/studies.md.

    python -m examples.scene_attack.road_predictor --data AV2/train --out plain.pt
    python -m examples.scene_attack.road_predictor --data AV2/train --bent --start plain.pt --out bent.pt
    pd-editor study --data AV2/val --methods examples.scene_attack.road_predictor:plain \
        examples.scene_attack.road_predictor:bent constant-velocity --out study
    # with ROAD_PREDICTOR naming the folder of both files

It is trained on recorded vehicles of plain roads; ``--bent`` goes on with roads that are
warped as in Scene-Attack.
"""

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import nn

from pd_editor.experiments.evaluation.evaluation_task import road_conditions
from pd_editor.scene.agent_kind import MOTOR_VEHICLE_KINDS
from pd_editor.scene.formats.dataset import DatasetIndex
from pd_editor.scene.formats.registry import read_scene
from pd_editor.scene.paths.driving_paths import paths_along_routes
from pd_editor.scene.paths.lanes.route_choice import choose_routes
from pd_editor.scene.prediction import (
    AgentHistory,
    Prediction,
    PredictionRequest,
    prediction_request,
)
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario

PAST_STEPS = np.array([-6, -11, -16, -21])
AHEAD_M = np.arange(4.0, 84.0, 4.0)
CURRENT_STEPS = (25, 30, 35, 40, 45, 50)
NUM_KNOTS = 12
KNOT_STEPS = 5
BENT = tuple(
    f"{kind}:{power}"
    for kind in ("smooth-turn", "double-turn", "ripple-road")
    for power in (-8, -4, 4, 8)
)


def features(agents: AgentHistory, road_map: RoadMap) -> np.ndarray:
    """Speed, past and route ahead of each agent, in its own frame [A N], scaled to 1."""
    count, now = len(agents.ids), agents.position_m[:, -1]
    speed = np.hypot(*agents.velocity_mps[:, -1].T)
    heading = agents.heading_rad[:, -1]
    steps = np.maximum(PAST_STEPS, -agents.position_m.shape[1])
    known = agents.is_valid[:, steps][..., None]
    past = np.where(known, local(agents.position_m[:, steps], now, heading), 0.0)
    reach = np.full(count, AHEAD_M[-1])
    choice = choose_routes(road_map, now, heading, agents.kinds, reach)
    agent, first = np.unique(choice.agent, return_index=True)
    route = np.zeros((count, len(AHEAD_M), 2))
    if len(agent):
        num_points = int(AHEAD_M[-1] / 2) + 8
        paths = paths_along_routes(
            choice, first, now, heading, speed, choice.offset_m[first], num_points
        )
        index = np.arange(len(agent))
        points = paths.position_at(index, np.tile(AHEAD_M, (len(agent), 1)))
        route[agent] = local(points, now[agent], heading[agent])
    has_route = np.isin(np.arange(count), agent)[:, None]
    parts = (speed[:, None] / 10, past.reshape(count, -1) / 20, has_route,
             route.reshape(count, -1) / 40)  # fmt: skip
    return np.concatenate(parts, axis=1).astype(np.float32)


def local(points: np.ndarray, origin: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Points [A K 2] in the frames of A poses."""
    x, y = np.moveaxis(points - origin[:, None], -1, 0)
    cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
    return np.stack([cos * x + sin * y, cos * y - sin * x], axis=-1)


def network() -> nn.Sequential:
    """Features to knots of the trajectory."""
    num_inputs = 2 + 2 * len(PAST_STEPS) + 2 * len(AHEAD_M)
    return nn.Sequential(
        nn.Linear(num_inputs, 128), nn.ReLU(), nn.Dropout(0.2),
        nn.Linear(128, 128), nn.ReLU(), nn.Linear(128, 2 * NUM_KNOTS),
    )  # fmt: skip


class RoadPredictor:
    """One trajectory for each agent: constant velocity plus what the network adds."""

    def __init__(self, name: str, weights: Path) -> None:
        """Read the weights of a training."""
        self.name = name
        self._network = network()
        self._network.load_state_dict(torch.load(weights, weights_only=True))
        self._network.eval()

    def predict(self, request: PredictionRequest) -> Prediction:
        """Predict all agents in one batch."""
        agents = request.agents
        with torch.inference_mode():
            inputs = torch.from_numpy(features(agents, request.road_map))
            knots = self._network(inputs).numpy().reshape(-1, NUM_KNOTS, 2)
        knots = np.concatenate([np.zeros_like(knots[:, :1]), 10 * knots], axis=1)
        time = (1 + np.arange(request.num_steps)) / KNOT_STEPS
        before = np.minimum(time.astype(int), NUM_KNOTS - 1)
        share = np.minimum(time - before, 1.0)[:, None]
        added = knots[:, before] * (1 - share) + knots[:, before + 1] * share
        speed = np.hypot(*agents.velocity_mps[:, -1].T)
        reached = request.step_s * (1 + np.arange(request.num_steps)) * speed[:, None]
        own = added + np.stack([reached, np.zeros_like(reached)], axis=-1)
        cos, sin = (f(agents.heading_rad[:, -1])[:, None] for f in (np.cos, np.sin))
        x, y = own[..., 0], own[..., 1]
        position = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
        position = position + agents.position_m[:, -1:]
        return Prediction(
            position_m=position[:, None], probability=np.ones((len(position), 1))
        )


def plain() -> RoadPredictor:
    """The predictor that was trained on plain roads."""
    return RoadPredictor("road-plain", Path(os.environ["ROAD_PREDICTOR"]) / "plain.pt")


def bent() -> RoadPredictor:
    """The predictor after fine-tuning on bent roads."""
    return RoadPredictor("road-bent", Path(os.environ["ROAD_PREDICTOR"]) / "bent.pt")


def samples(folder: Path, roads: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Features and knots of the moving vehicles of all scenes, and their mirror images."""
    found = [
        windows(road.applied_to(read_scene(card.folder)))
        for card in DatasetIndex(folder).filter()
        for road in road_conditions(roads)
    ]
    inputs, targets = (
        np.concatenate([one for part in found for one in part[which]])
        for which in (0, 1)
    )
    mirrored = inputs.copy()
    mirrored[:, 2 : 1 + 2 * len(PAST_STEPS) : 2] *= -1
    mirrored[:, 3 + 2 * len(PAST_STEPS) :: 2] *= -1
    other = targets * np.tile([1.0, -1.0], NUM_KNOTS)
    return np.concatenate([inputs, mirrored]), np.concatenate([targets, other])


def windows(scenario: Scenario) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Features and knots of vehicles at several current steps of a scene."""
    inputs, targets = [], []
    for now in CURRENT_STEPS:
        axis = replace(scenario.time_axis, current_step=now)
        at_now = replace(scenario, time_axis=axis)
        steps = np.minimum(
            now + KNOT_STEPS * (1 + np.arange(NUM_KNOTS)), axis.num_steps - 1
        )
        agents = scenario.agents
        moves = np.hypot(*agents.velocity_mps[:, now].T) > 1.0
        moves &= agents.is_valid[:, now] & agents.is_valid[:, steps].all(axis=1)
        rows = np.flatnonzero(moves & agents.kind_mask(MOTOR_VEHICLE_KINDS))
        if not len(rows):
            continue
        ids = tuple(agents.ids[row] for row in rows)
        request = prediction_request(at_now, ids, num_modes=1, seed=0)
        here, heading = (
            request.agents.position_m[:, -1],
            request.agents.heading_rad[:, -1],
        )
        knots = local(agents.position_m[rows][:, steps], here, heading)
        speed = np.hypot(*request.agents.velocity_mps[:, -1].T)
        knots[..., 0] -= speed[:, None] * (steps - now) * request.step_s
        inputs.append(features(request.agents, request.road_map))
        targets.append((knots.reshape(len(ids), -1) / 10).astype(np.float32))
    return inputs, targets


def train(options: argparse.Namespace) -> float:
    """Train and save the network; the mean squared error at the end."""
    torch.manual_seed(0)
    found = samples(options.data, ("none", *BENT) if options.bent else ("none",))
    inputs, targets = (torch.from_numpy(one.astype(np.float32)) for one in found)
    model = network()
    if options.start:
        model.load_state_dict(torch.load(options.start, weights_only=True))
    optimizer = torch.optim.AdamW(model.parameters(), 1e-3, weight_decay=0.1)
    loss = torch.zeros(())
    for _ in range(options.steps):
        pick = torch.randint(len(inputs), (128,))
        loss = nn.functional.smooth_l1_loss(model(inputs[pick]), targets[pick])
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    torch.save(model.state_dict(), options.out)
    return float(loss.detach())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--start", type=Path)
    parser.add_argument("--bent", action="store_true")
    parser.add_argument("--steps", type=int, default=3000)
    sys.stdout.write(f"loss {train(parser.parse_args()):.4f}\n")
