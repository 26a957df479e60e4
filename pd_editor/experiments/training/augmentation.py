"""Augmentation of scenarios, so that a model does not rely on properties of synthetic data.

In synthetic scenarios agents drive exactly on lanes, and all roads and agents are known;
recorded scenarios have none of these properties.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from pd_editor.analysis.metrics.road import is_off_road
from pd_editor.experiments.training.run_config import Augmentation
from pd_editor.scene.agent_kind import (
    ROAD_USER_KINDS,
    Activity,
    AgentCategory,
    AgentKind,
)
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.friction import DRY_ROAD_FRICTION
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.road_warp import DEFAULT_LENGTH_M, WARP_KINDS, RoadWarp, WarpTerm
from pd_editor.scene.scenario import EGO_ID, Scenario
from pd_editor.scene.thresholds import MOVING_MPS

_REACH_M: Final = 120.0
"""Median distance from the ego up to which an agent is observed.

There are fewer simulated agents than real ones. A tracker's range of 90 m and its
occlusions would leave 17 of them in a scenario, this leaves 25; Argoverse 2 has 24.
"""
_FAR_M: Final = 60.0
CRAWLING_MPS: Final = 3.0
"""Vehicles that move slower than this crawl."""
_NUM_WAVES: Final = 3
_POWERS: Final = (1.0, 9.5)

DEFAULT_AUGMENTATION: Final = Augmentation()
"""Augmentation with the default values of all fields."""


def augmented(
    scenario: Scenario,
    augmentation: Augmentation,
    random: np.random.Generator,
    *,
    hides_agents: bool,
) -> Scenario:
    """Augment a scenario and reduce it to the road users of the current step.

    ``hides_agents`` removes agents that a tracker would not observe, mostly far from the
    ego; it is for simulated scenarios. The map is a new value.
    """
    agents = _remaining(scenario, augmentation, random, hides_agents=hides_agents)
    road_map = _remaining_map(scenario.road_map, augmentation, random)
    if augmentation.jitter_m > 0 and road_map.polylines:
        road_map = road_map.moved(_waves(augmentation, random))
    signals = scenario.signals
    if signals and random.random() < augmentation.signals_dropped_share:
        signals = ()
    scenario = replace(scenario, road_map=road_map, agents=agents, signals=signals)
    if random.random() < augmentation.warp_share and road_map.polylines:
        # Without the limit, training trajectories would exceed the friction of tyres.
        scenario = warp_scenario(
            scenario,
            _warp(scenario, random),
            friction_coefficient=DRY_ROAD_FRICTION,
        )
    return scenario


def crawling_share(scenario: Scenario, center_m: Float[np.ndarray, "2"]) -> float:
    """Share of the moving vehicles around a place that crawl; 0 with too few of them."""
    agents, step = scenario.agents, scenario.current_step
    speed = np.hypot(*agents.velocity_mps[:, step].T)
    is_near = np.abs(agents.position_m[:, step] - center_m).max(axis=1) <= _FAR_M
    moves = agents.is_valid[:, step] & agents.kind_mask({AgentKind.VEHICLE}) & is_near
    moves &= speed >= MOVING_MPS
    # With fewer moving vehicles, their speeds say nothing of a scene.
    if moves.sum() < 3:
        return 0.0
    return float(np.mean(speed[moves] < CRAWLING_MPS))


def _remaining(
    scenario: Scenario,
    augmentation: Augmentation,
    random: np.random.Generator,
    *,
    hides_agents: bool,
) -> AgentTracks:
    """Road users that exist at the current step and are observed."""
    tracks, step = scenario.agents, scenario.current_step
    kept = tracks.is_valid[:, step] & tracks.kind_mask(ROAD_USER_KINDS)
    always = np.array([c >= AgentCategory.SCORED for c in tracks.categories], bool)
    always |= np.array([name == EGO_ID for name in tracks.ids], bool)
    if hides_agents:
        kept &= always | _is_seen(scenario, augmentation, random)
    if random.random() < augmentation.agents_dropped_share:
        chance = augmentation.agent_dropped * random.random()
        focal = np.array([name == scenario.focal_id for name in tracks.ids], bool)
        kept &= focal | (random.random(len(tracks)) >= chance)
    return tracks.taken(np.flatnonzero(kept))


def _is_seen(
    scenario: Scenario, augmentation: Augmentation, random: np.random.Generator
) -> np.ndarray:
    """Which agents are observed: sampled by distance to the ego, fewer parked ones."""
    tracks, step = scenario.agents, scenario.current_step
    ego = tracks.row_of.get(EGO_ID, tracks.row_of.get(scenario.focal_id))
    if ego is None:
        return np.ones(len(tracks), bool)
    place = tracks.position_m[:, step]
    gap = np.hypot(*(place - place[ego]).T)
    # Standard deviation of the logarithm of the distance.
    spread = 0.45 * random.standard_normal(len(tracks))
    chance = np.where(
        is_off_road(scenario, place),
        augmentation.parked_off_road_seen,
        augmentation.parked_seen,
    )
    chance = chance * np.where(gap > _FAR_M, augmentation.far_parked_seen, 1.0)
    is_hidden = tracks.activity == Activity.PARKED
    is_hidden &= random.random(len(tracks)) >= chance
    return (gap <= _REACH_M * np.exp(spread)) & ~is_hidden


def _remaining_map(
    road_map: RoadMap, augmentation: Augmentation, random: np.random.Generator
) -> RoadMap:
    lanes = road_map.lanes
    if random.random() < augmentation.lanes_dropped_share:
        kept = random.random(len(lanes)) >= augmentation.lane_dropped
        lanes = tuple(lane for lane, stays in zip(lanes, kept, strict=True) if stays)
    return replace(road_map, lanes=lanes)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Waves:
    """Smooth displacement of the plane: a constant and a few sine waves."""

    shift_m: Float[np.ndarray, "2"]
    amplitude_m: Float[np.ndarray, "K 2"]
    number_1pm: Float[np.ndarray, "K 2"]
    phase_rad: Float[np.ndarray, "K"]

    def __call__(self, points_m: Float[np.ndarray, "P 2"]) -> Float[np.ndarray, "P 2"]:
        waves = np.sin(points_m @ self.number_1pm.T + self.phase_rad)
        return points_m + self.shift_m + waves @ self.amplitude_m


def _waves(augmentation: Augmentation, random: np.random.Generator) -> _Waves:
    size = augmentation.jitter_m * np.sqrt(2 / (_NUM_WAVES + 1))
    length = random.uniform(*augmentation.jitter_wave_m, _NUM_WAVES)
    direction = unit_vector(random.uniform(-np.pi, np.pi, _NUM_WAVES))
    return _Waves(
        shift_m=size * np.sqrt(0.5) * random.standard_normal(2),
        amplitude_m=size * random.standard_normal((_NUM_WAVES, 2)),
        number_1pm=2 * np.pi * direction / length[:, None],
        phase_rad=random.uniform(-np.pi, np.pi, _NUM_WAVES),
    )


def _warp(scenario: Scenario, random: np.random.Generator) -> RoadWarp | None:
    """Sample a warp ahead of the focal agent; None without a focal agent."""
    tracks, step = scenario.agents, scenario.current_step
    row = tracks.row_of.get(scenario.focal_id)
    if row is None:
        return None
    kind = WARP_KINDS[int(random.integers(len(WARP_KINDS)))]
    x, y = tracks.position_m[row, step].tolist()
    term = WarpTerm(
        kind=kind,
        power=float(random.uniform(*_POWERS) * random.choice([-1.0, 1.0])),
        length_m=DEFAULT_LENGTH_M[kind] * float(random.uniform(0.8, 1.5)),
        border_m=float(random.uniform(2.0, 15.0)),
    )
    heading = float(tracks.heading_rad[row, step])
    anchor = RigidMotion(x_m=x, y_m=y, rotation_rad=heading)
    return RoadWarp(anchor=anchor, terms=(term,))
