"""Input features of both stages of the model, as NumPy arrays."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from pd_editor.generation.features.map_pieces import (
    boundary_pieces,
    lane_pieces,
    piece_signals,
)
from pd_editor.generation.features.scene_fields import (
    CANDIDATE_FIELDS,
    LATENT_SIZE,
    NUM_NEAR_AGENTS,
    NUM_NEAR_BOUNDARY,
    NUM_NEAR_PIECES,
    SCENE_FIELDS,
    SceneTokens,
)
from pd_editor.scene.agent_kind import ROAD_USER_KINDS, AgentKind, activity_at
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.paths.motion_primitives import candidate_positions
from pd_editor.scene.scenario import EGO_ID, Scenario

AGENT_KINDS: Final = (
    AgentKind.VEHICLE,
    AgentKind.BUS,
    AgentKind.MOTORCYCLIST,
    AgentKind.CYCLIST,
    AgentKind.PEDESTRIAN,
)
PEDESTRIAN: Final = AGENT_KINDS.index(AgentKind.PEDESTRIAN)
"""Index of the pedestrian kind, which follows no lane."""
NUM_CANDIDATES: Final = 24
NUM_FUTURE_STEPS: Final = 60
STEP_S: Final = 0.1
PIECE_REACH_M: Final = 130.0
"""Pieces further from the scene's centre are left out, unless an agent is near."""
MOST_PIECES: Final = 512
"""Limit of lane pieces, and of boundary pieces, besides those near an agent."""
_KIND_INDEX: Final = {
    kind: AGENT_KINDS.index(kind if kind in ROAD_USER_KINDS else AgentKind.PEDESTRIAN)
    for kind in AgentKind
}
"""Static objects, where they are included, count as the kind nearest in size."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneFeatures(SceneTokens):
    """Tokens of a scene, with what is recorded and possible at the H future steps.

    Agents are all road users present at the current step, in the order of the scenario.
    """

    center_m: Float[np.ndarray, "2"]
    """Where poses are counted from."""
    agent_row: Int[np.ndarray, "A"]
    candidate_m: Float[np.ndarray, "A C H 2"]
    """Candidates at the H future steps, in the frame of the agent's current pose."""
    has_candidate: Bool[np.ndarray, "A C"]
    future_m: Float[np.ndarray, "A H 2"]
    """Recorded positions at the future steps, in the frame of the agent's pose."""
    has_future: Bool[np.ndarray, "A"]


def scene_features(
    scenario: Scenario,
    *,
    with_candidates: bool = True,
    knows_leaders: bool = True,
    agents: np.ndarray | None = None,
    center_m: Float[np.ndarray, "2"] | None = None,
) -> SceneFeatures:
    """Compute the features of a scene at the current step.

    ``agents`` are rows with a finite state; None means all road users that have one.
    Without candidates, C is 0; with ``knows_leaders``, some candidates follow the agent
    ahead. The horizon is always ``NUM_FUTURE_STEPS`` steps of ``STEP_S``, whatever the
    scenario's time axis is.
    """
    rows = _road_users(scenario) if agents is None else np.asarray(agents, int)
    center = scene_center(scenario) if center_m is None else np.asarray(center_m, float)
    tracks, step = scenario.agents, scenario.current_step
    position, heading = tracks.position_m[rows, step], tracks.heading_rad[rows, step]
    velocity = tracks.velocity_mps[rows, step]
    pieces = lane_pieces(scenario.road_map)
    kept, near_pieces = _near_pieces(
        pieces.pose[:, :2], position, center, NUM_NEAR_PIECES
    )
    boundary = boundary_pieces(scenario)
    seen, near_boundary = _near_pieces(
        boundary.pose[:, :2], position, center, NUM_NEAR_BOUNDARY
    )
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    num_candidates = NUM_CANDIDATES if with_candidates else 0
    candidate, has_candidate = _candidates(
        scenario, rows, num_candidates, knows_leaders=knows_leaders
    )
    future, has_future = _futures(scenario, rows)
    middle = np.append(center, 0.0)
    return SceneFeatures(
        center_m=center,
        piece_pose=_single(pieces.pose[kept] - middle),
        piece_shape=_single(pieces.shape[kept]),
        piece_kind=pieces.kind[kept],
        piece_signal=_single(piece_signals(scenario, pieces)[kept]),
        boundary_pose=_single(boundary.pose[seen] - middle),
        boundary_shape=_single(boundary.shape[seen]),
        agent_row=rows,
        agent_pose=_single(np.column_stack([position - center, wrap_angle(heading)])),
        agent_speed=_single(speed),
        agent_size=_single(tracks.size_m[rows]),
        agent_kind=np.array([_KIND_INDEX[tracks.kinds[row]] for row in rows], int),
        agent_activity=activity_at(tracks.activity[rows], speed).astype(int),
        near_pieces=near_pieces,
        near_boundary=near_boundary,
        near_agents=_nearest(position, position, NUM_NEAR_AGENTS, but_itself=True),
        candidate_m=candidate,
        has_candidate=has_candidate,
        future_m=future,
        has_future=has_future,
    )


def seen_agents(
    scenario: Scenario,
    rows: Int[np.ndarray, "G"],
    is_open: Bool[np.ndarray, "A"],
    num_near: int,
    num_layers: int,
) -> tuple[Int[np.ndarray, "K"], Int[np.ndarray, "U"]]:
    """Rows of the agents that trajectories at ``rows`` depend on, and of all road users.

    In each layer of a network an agent sees its ``num_near`` neighbours. ``is_open`` are
    agents without a known trajectory: theirs is sampled as well, and depends on others.
    """
    users = _road_users(scenario)
    position = scenario.agents.position_m[users, scenario.current_step]
    sampled = np.isin(users, rows)
    while True:
        seen = sampled.copy()
        for _ in range(0 if seen.all() else num_layers):
            # Each is nearest to itself; -1 (none) is the last of so few that all are seen.
            seen[_nearest(position[seen], position, num_near + 1)] = True
        more = seen & is_open[users] & ~sampled
        if not more.any():
            return users[seen], users
        sampled |= more


def scene_center(scenario: Scenario) -> Float[np.ndarray, "2"]:
    """Centre of a scene: position of the focal agent, else of ego, agents or road."""
    tracks, step = scenario.agents, scenario.current_step
    there = tracks.is_valid[:, step]
    there = there & np.isfinite(tracks.position_m[:, step]).all(axis=-1)
    for name in (scenario.focal_id, EGO_ID):
        row = tracks.row_of.get(name)
        if row is not None and there[row]:
            return tracks.position_m[row, step].copy()
    points = tracks.position_m[there, step]
    if not len(points):
        points = lane_pieces(scenario.road_map).pose[:, :2]
    return points.mean(axis=0) if len(points) else np.zeros(2)


def _road_users(scenario: Scenario) -> Int[np.ndarray, "A"]:
    """Rows of the road users with a finite state at the current step."""
    tracks, step = scenario.agents, scenario.current_step
    usable = tracks.is_valid[:, step].copy()
    for values in (tracks.position_m, tracks.velocity_mps):
        usable &= np.isfinite(values[:, step]).all(axis=-1)
    usable &= np.isfinite(tracks.heading_rad[:, step])
    return np.flatnonzero(usable & tracks.kind_mask(ROAD_USER_KINDS))


def _near_pieces(
    points_m: Float[np.ndarray, "P 2"],
    position_m: Float[np.ndarray, "A 2"],
    center_m: Float[np.ndarray, "2"],
    most: int,
) -> tuple[Int[np.ndarray, "N"], Int[np.ndarray, "A {most}"]]:
    """Rows of the selected pieces, in order, and indices of those near each agent."""
    near = _nearest(position_m, points_m, most)
    distance = np.hypot(*(points_m - center_m).T)
    wanted = distance <= PIECE_REACH_M
    if wanted.sum() > MOST_PIECES:
        wanted &= distance <= np.partition(distance, MOST_PIECES - 1)[MOST_PIECES - 1]
    wanted[near[near >= 0]] = True
    place = np.cumsum(wanted) - 1
    if len(points_m):
        near = np.where(near >= 0, place[near], -1)
    return np.flatnonzero(wanted), near


def _nearest(
    from_m: Float[np.ndarray, "A 2"],
    points_m: Float[np.ndarray, "P 2"],
    most: int,
    *,
    but_itself: bool = False,
) -> Int[np.ndarray, "A {most}"]:
    """Indices of the nearest points, nearest first; ties in the order of the points."""
    near = np.full((len(from_m), most), -1)
    count = min(most, len(points_m) - but_itself)
    if count <= 0:
        return near
    gap = (from_m[:, None, 0] - points_m[:, 0]) ** 2
    gap += (from_m[:, None, 1] - points_m[:, 1]) ** 2
    np.sqrt(gap, out=gap)
    # Both directions of a crosswalk have the same midpoint: ties keep their order.
    gap += np.arange(len(points_m)) * 1e-7
    if but_itself:
        np.fill_diagonal(gap, np.inf)
    found = np.argpartition(gap, count - 1, axis=1)[:, :count]
    order = np.take_along_axis(gap, found, axis=1).argsort(axis=1)
    near[:, :count] = np.take_along_axis(found, order, axis=1)
    return near


def _candidates(
    scenario: Scenario,
    rows: Int[np.ndarray, "A"],
    most: int,
    *,
    knows_leaders: bool,
) -> tuple[Float[np.ndarray, "A C H 2"], Bool[np.ndarray, "A C"]]:
    """Candidates of agents, in the agents' frames."""
    local = np.zeros((len(rows), most, NUM_FUTURE_STEPS, 2), np.float32)
    is_valid = np.zeros((len(rows), most), bool)
    if most:
        position, agent, slot = candidate_positions(
            scenario,
            rows,
            max_candidates=most,
            num_steps=NUM_FUTURE_STEPS,
            step_s=STEP_S,
            knows_leaders=knows_leaders,
        )
        is_valid[agent, slot] = True
        local[agent, slot] = _in_frames(position, scenario, rows[agent])[:, 1:]
    return local, is_valid


def _futures(
    scenario: Scenario, rows: Int[np.ndarray, "A"]
) -> tuple[Float[np.ndarray, "A H 2"], Bool[np.ndarray, "A"]]:
    """Recorded trajectories in the agents' frames, where they are complete."""
    tracks, step, axis = scenario.agents, scenario.current_step, scenario.time_axis
    future = np.zeros((len(rows), NUM_FUTURE_STEPS, 2), np.float32)
    if axis.num_future_steps < NUM_FUTURE_STEPS or abs(axis.step_s - STEP_S) > 1e-6:
        return future, np.zeros(len(rows), bool)
    steps = slice(step + 1, step + 1 + NUM_FUTURE_STEPS)
    points = tracks.position_m[rows, steps]
    known = tracks.is_valid[rows, steps] & np.isfinite(points).all(axis=-1)
    has_future = np.asarray(known.all(axis=1))
    future[has_future] = _in_frames(points[has_future], scenario, rows[has_future])
    return future, has_future


def _in_frames(
    points_m: Float[np.ndarray, "N H 2"],
    scenario: Scenario,
    rows: Int[np.ndarray, "N"],
) -> Float[np.ndarray, "N H 2"]:
    """Transform points of the scene frame to the frames of agents' current poses."""
    agents, step = scenario.agents, scenario.current_step
    origin = agents.position_m[rows, step].view(np.complex128)
    # With complex numbers, translation and rotation take one pass each.
    local = np.ascontiguousarray(points_m).view(np.complex128)[..., 0] - origin
    local *= np.exp(-1j * agents.heading_rad[rows, step])[:, None]
    return local.view(float).reshape(points_m.shape)


def _single(values: np.ndarray) -> np.ndarray:
    return np.asarray(values, np.float32)


@dataclass(frozen=True, kw_only=True, eq=False)
class PackedScene(SceneTokens):
    """Tokens of a scene, with trajectories and C candidates as D numbers each, their latents.

    Valid candidates come first in each row.
    """

    candidates: Float[np.ndarray, "A C D"]
    """Zero where ``has_candidate`` is false."""
    has_candidate: Bool[np.ndarray, "A C"]
    future: Float[np.ndarray, "A D"]
    """Zero where ``has_future`` is false."""
    has_future: Bool[np.ndarray, "A"]

    def with_agents(self, count: int, **known: np.ndarray) -> "PackedScene":
        """Append agents of which only some fields are known, by their names."""
        changed = {}
        for field in (*SCENE_FIELDS, *CANDIDATE_FIELDS):
            if field.axis == "agent":
                old = getattr(self, field.name)
                new = np.full((count, *old.shape[1:]), field.fill, old.dtype)
                new[:] = known.get(field.name, new)
                changed[field.name] = np.concatenate([old, new])
        return replace(self, **changed)

    def only_agents(self, rows: Int[np.ndarray, "K"]) -> "PackedScene":
        """Keep some agents only; the nearest tokens and agents of each become unset."""
        changed = {}
        for field in (*SCENE_FIELDS, *CANDIDATE_FIELDS):
            if field.axis == "agent":
                values = getattr(self, field.name)[rows]
                if field.name in _NEAREST:
                    values = np.full_like(values, field.fill)
                changed[field.name] = values
        return replace(self, **changed)


_NEAREST: Final = ("near_pieces", "near_boundary", "near_agents")

Encoder = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Encoder of trajectories [.. H 2] at speeds; see ``TrajectoryBasis.encode``."""


def packed(features: SceneFeatures, encode: Encoder) -> PackedScene:
    """Encode the candidates and trajectories of a scene."""
    speed = features.agent_speed
    has_candidate, has_future = features.has_candidate, features.has_future
    candidates = np.zeros((*has_candidate.shape, LATENT_SIZE), np.float32)
    agent, slot = np.nonzero(has_candidate)
    candidates[agent, slot] = encode(features.candidate_m[agent, slot], speed[agent])
    future = np.zeros((len(speed), LATENT_SIZE), np.float32)
    future[has_future] = encode(features.future_m[has_future], speed[has_future])
    return PackedScene(
        **{one.name: getattr(features, one.name) for one in fields(SceneTokens)},
        candidates=candidates,
        has_candidate=has_candidate,
        future=future,
        has_future=has_future,
    )
