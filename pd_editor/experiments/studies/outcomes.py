"""What a study finds: worst cases by search, avoidable danger, severity curves.

Scene-Attack searches a grid of 18 powers for each kind of warp. The black-box search
samples the powers of all kinds together, with the paper's penalty for each kind beyond
the first, by Optuna's tree-structured Parzen estimator.
"""

import math
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pyarrow as pa
from jaxtyping import Bool, Float, Int

from pd_editor.analysis.metrics.box_overlaps import boxes_collide, first_collisions
from pd_editor.base.errors import EditError, InputError
from pd_editor.editor.commands import AdoptTrajectory
from pd_editor.editor.scenario_store import scene_part
from pd_editor.editor.variant import short_id
from pd_editor.experiments.evaluation.evaluation_task import (
    DEFAULT_ANCHOR,
    PLAIN,
    RoadCondition,
)
from pd_editor.experiments.evaluation.summary import (
    Estimate,
    mean_over_scenes,
    scene_weights,
)
from pd_editor.experiments.studies.study_plan import (
    STUDY_AGENTS,
    STUDY_METRICS,
    StudyAgents,
    StudyItem,
    recorded_scenario,
    variant_of,
)
from pd_editor.scene.agent_kind import MOTOR_VEHICLE_KINDS
from pd_editor.scene.base_reference import SceneCut
from pd_editor.scene.geometry.oriented_box import Boxes
from pd_editor.scene.paths.motion_primitives import CandidateSet, candidates
from pd_editor.scene.road_warp import MAX_POWER, WARP_KINDS, WarpKind
from pd_editor.scene.scenario import EGO_ID, Scenario

if TYPE_CHECKING:
    from optuna.trial import Trial

PENALTY: Final = 10.0
"""Scene-Attack's penalty for each active kind of warp beyond the first."""
GRID_SIZE: Final = 54
"""Number of variants of Scene-Attack's grid: 18 powers of three kinds."""
_FIRST_POWERS: Final = (-10.0, 10.0, -7.0, 7.0, -4.0, 4.0)
"""Powers of each kind that the search tries first."""


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """Settings of a worst-case search."""

    metric: str = "off_drivable_steps"
    """The study metric to maximise."""
    agents: StudyAgents = STUDY_AGENTS[0]
    num_trials: int = GRID_SIZE
    penalty: float = PENALTY
    """Penalty for each active kind beyond the first; 0 searches sums as well."""
    kinds: tuple[WarpKind, ...] = WARP_KINDS


@dataclass(frozen=True, kw_only=True)
class WorstCase:
    """The worst variant that was found for one scene, method and seed."""

    scenario: str
    folder: Path
    """``StudyItem.place``, which alone tells scenarios of one id apart."""
    method: str
    seed: int
    condition: str
    """Label of the road condition; empty if no trial had a value."""
    value: float
    """The metric there; NaN if no trial had a value."""
    num_trials: int
    """Number of trials of a search; 0 for a grid."""

    @property
    def title(self) -> str:
        """Scene, road and method in one line."""
        return f"{short_id(self.scenario)} \N{MIDDLE DOT} {self.condition} \N{MIDDLE DOT} {self.method}"


@dataclass(frozen=True, kw_only=True)
class SearchItem:
    """Work item: a search on one scene."""

    variant: StudyItem
    """Scene, method and seed; its conditions are not used."""
    settings: SearchSettings


def search_scene(item: SearchItem) -> WorstCase:
    """Search the worst warp of a scene; the same item gives the same result.

    Raises:
        InputError: the scenario cannot be read, or Optuna is not installed.
    """
    try:
        import optuna
    except ImportError as error:
        raise InputError(
            'The worst-case search needs Optuna; install the extra "study" '
            "(pip install 'pd-editor[study]')."
        ) from error
    settings, variant = item.settings, item.variant
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    sampler = optuna.samplers.TPESampler(seed=variant.seed % 2**32)
    study = optuna.create_study(direction="maximize", sampler=sampler)
    for power in _FIRST_POWERS:
        for kind in settings.kinds:
            study.enqueue_trial({"kinds": kind, kind: power})
    best = (-math.inf, "", math.nan)

    def objective(trial: "Trial") -> float:
        nonlocal best
        terms = _terms_of(trial, settings.kinds)
        condition = RoadCondition(terms=terms)
        value = _value_of(variant, condition, settings)
        if not math.isfinite(value):
            raise optuna.TrialPruned
        score = value - settings.penalty * max(len(terms) - 1, 0)
        if score > best[0]:
            best = score, condition.label, value
        return score

    study.optimize(objective, n_trials=settings.num_trials)
    return WorstCase(
        scenario=variant.place.name,
        folder=variant.place,
        method=variant.method.name,
        seed=variant.seed,
        condition=best[1],
        value=best[2],
        num_trials=settings.num_trials,
    )


def _terms_of(
    trial: "Trial", kinds: tuple[WarpKind, ...]
) -> tuple[tuple[WarpKind, float], ...]:
    """Kinds and powers that a trial proposes; powers up to 0.5 count as none."""
    sets = [one for n in range(1, len(kinds) + 1) for one in combinations(kinds, n)]
    names: dict[str, tuple[WarpKind, ...]] = {"+".join(one): one for one in sets}
    chosen = names[trial.suggest_categorical("kinds", list(names))]
    powers: list[tuple[WarpKind, float]] = [
        (k, trial.suggest_float(k, -MAX_POWER, MAX_POWER)) for k in chosen
    ]
    # A kind of warp is active above this power.
    return tuple((k, power) for k, power in powers if abs(power) > 0.5)


def _value_of(
    variant: StudyItem, condition: RoadCondition, settings: SearchSettings
) -> float:
    """The metric under a road condition; NaN if the method fails there."""
    found = variant_of(
        variant, recorded_scenario(variant.folder, variant.cut), condition
    )
    return found.sums[settings.agents][settings.metric].mean


def grid_worst_cases(rows: pa.Table, settings: SearchSettings) -> tuple[WorstCase, ...]:
    """The worst variant of each scene, method and seed among the rows of a study."""
    agents = np.array(rows["agents"].to_pylist(), object)
    has_value = rows[f"{settings.metric}_count"].to_numpy() > 0
    rows = rows.filter(pa.array((agents == settings.agents) & has_value))
    total = rows[f"{settings.metric}_sum"].to_numpy()
    value = total / rows[f"{settings.metric}_count"].to_numpy()
    names = ("folder", "method", "seed", "condition")
    keys = list(zip(*(rows[name].to_pylist() for name in names), strict=True))
    found: dict[tuple[str, str, int], WorstCase] = {}
    for index in np.argsort(-value, kind="stable").tolist():
        place, method, seed, condition = keys[index]
        found.setdefault(
            (place, method, seed),
            WorstCase(
                scenario=Path(place).name,
                folder=Path(place),
                method=method,
                seed=seed,
                condition=condition,
                value=float(value[index]),
                num_trials=0,
            ),
        )
    return tuple(found.values())


REACH_M: Final = 60.0
"""Agents farther from the ego at the current step are not searched."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AvoidableDanger:
    """A behaviour of an agent that the ego hits, and one of the ego that avoids it."""

    agent_id: str
    ego_id: str
    time_s: float
    """Time of the collision after the current step."""
    impact_mps: float
    """Relative speed at the collision."""
    num_avoiding: int
    """Number of the ego's candidates that collide with nothing."""
    behaviour: AdoptTrajectory
    escape: AdoptTrajectory
    """The first, most natural of the ego's candidates that avoid the collision."""


def ego_of(scenario: Scenario) -> str:
    """Id of the ego vehicle, or of the focal agent where there is none.

    Raises:
        EditError: neither is there at the current step.
    """
    agents, now = scenario.agents, scenario.current_step
    for name in (EGO_ID, scenario.focal_id):
        row = agents.row_of.get(name)
        if row is not None and agents.is_valid[row, now]:
            return name
    raise EditError("There is neither an ego vehicle nor a focal agent at t = 0.")


def avoidable_dangers(scenario: Scenario) -> tuple[AvoidableDanger, ...]:
    """The most dangerous avoidable behaviour of each agent, the hardest impact first.

    A behaviour is one of the agent's Frenet candidates. It is dangerous if the ego collides
    with it on the trajectory that it has, and avoidable if one of the ego's own candidates
    collides with nothing. All others move as in the scenario. Motor vehicles within 60 m of
    the ego are searched.

    Raises:
        EditError: there is no ego.
    """
    agents, now = scenario.agents, scenario.current_step
    (ego_row,) = agents.rows([ego_of(scenario)])
    escapes = candidates(scenario, np.array([ego_row]))
    if not agents.is_valid[ego_row, now:].all() or not escapes.is_valid[0].any():
        return ()
    rows = _near_vehicles(scenario, int(ego_row))
    found = (_worst(scenario, int(ego_row), int(row), escapes) for row in rows)
    return tuple(
        sorted((one for one in found if one is not None), key=lambda d: -d.impact_mps)
    )


def dangers_of_part(part: tuple[Path, SceneCut]) -> tuple[AvoidableDanger, ...]:
    """``avoidable_dangers`` of what is used of a recorded scene, as a work item.

    Raises:
        InputError: the scenario cannot be read.
        EditError: there is no ego.
    """
    return avoidable_dangers(scene_part(*part))


def _near_vehicles(scenario: Scenario, ego_row: int) -> Int[np.ndarray, "N"]:
    agents, now = scenario.agents, scenario.current_step
    offset = agents.position_m[:, now] - agents.position_m[ego_row, now]
    is_near = np.hypot(*offset.T) <= REACH_M
    is_near &= agents.is_valid[:, now] & agents.kind_mask(MOTOR_VEHICLE_KINDS)
    is_near[ego_row] = False
    return np.flatnonzero(is_near)


def _worst(
    scenario: Scenario, ego_row: int, row: int, escapes: CandidateSet
) -> AvoidableDanger | None:
    """The avoidable behaviour of one agent with the hardest impact."""
    agents, now = scenario.agents, scenario.current_step
    without_ego = scenario.without_agents([agents.ids[ego_row]])
    behaviours = candidates(scenario, np.array([row]))
    is_free = behaviours.is_valid[0] & _collides_with_none(
        without_ego, agents.ids[row], behaviours
    )
    if not is_free.any():
        return None
    behaved = _boxes_of(scenario, row, behaviours)
    hits, step = _collisions(agents.boxes[[ego_row], now:], behaved)
    hits, step = hits[0] & (step[0] > 0), step[0]
    # Of the ego's candidates, those that avoid all others, whatever the agent does.
    without_agent = scenario.without_agents([agents.ids[row]])
    is_safe = escapes.is_valid[0] & _collides_with_none(
        without_agent, agents.ids[ego_row], escapes
    )
    meets, _ = _collisions(_boxes_of(scenario, ego_row, escapes), behaved)
    avoids = is_safe[:, None] & ~meets
    index = np.flatnonzero(is_free & hits & avoids.any(axis=0))
    if not len(index):
        return None
    at = now + step[index]
    relative = (
        behaviours.velocity_mps[0, index, step[index]]
        - agents.velocity_mps[ego_row, at]
    )
    impact = np.hypot(*relative.T)
    best = int(np.argmax(impact))
    chosen = int(index[best])
    return AvoidableDanger(
        agent_id=agents.ids[row],
        ego_id=agents.ids[ego_row],
        time_s=float(step[chosen] * scenario.time_axis.step_s),
        impact_mps=float(impact[best]),
        num_avoiding=int(avoids[:, chosen].sum()),
        behaviour=_adopted(agents.ids[row], behaviours, chosen),
        escape=_adopted(
            agents.ids[ego_row], escapes, int(np.argmax(avoids[:, chosen]))
        ),
    )


def _collides_with_none(
    scenario: Scenario, agent_id: str, found: CandidateSet
) -> Bool[np.ndarray, "C"]:
    (row,) = scenario.agents.rows([agent_id])
    collisions = first_collisions(
        scenario, int(row), found.position_m[0], found.heading_rad[0], found.is_valid[0]
    )
    return np.array([one is None for one in collisions], bool)


def _boxes_of(scenario: Scenario, row: int, found: CandidateSet) -> Boxes:
    """Boxes [K H] of an agent on each of its candidates."""
    return Boxes(
        position_m=found.position_m[0],
        heading_rad=found.heading_rad[0],
        size_m=scenario.agents.size_m[row],
    )


def _collisions(
    one: Boxes, other: Boxes
) -> tuple[Bool[np.ndarray, "K L"], Int[np.ndarray, "K L"]]:
    """Whether K paths of an agent collide with L of another one, and the first step."""
    hit = boxes_collide(one[:, None], other[None])
    num_steps = hit.shape[-1]
    first = np.where(hit.any(axis=-1), hit.argmax(axis=-1), num_steps)
    return first < num_steps, np.minimum(first, num_steps - 1)


def _adopted(agent_id: str, found: CandidateSet, index: int) -> AdoptTrajectory:
    return AdoptTrajectory.of_arrays(
        agent_id=agent_id,
        position_m=found.position_m[0, index],
        heading_rad=found.heading_rad[0, index],
        velocity_mps=found.velocity_mps[0, index],
    )


_SEED: Final = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class SeverityCurve:
    """Means of all study metrics at P powers of a kind of warp; 0 is the plain road."""

    method: str
    kind: str
    anchor: str
    agents: StudyAgents
    power: Float[np.ndarray, "P"]
    estimates: dict[str, Estimate]
    """Means [P] with intervals, by metric."""
    num_scenes: Int[np.ndarray, "P"]
    """Number of scenes with values of the first metric."""

    @property
    def road(self) -> str:
        """Kind of warp, and its anchor if it is not the focal agent."""
        return road_title(self.kind, self.anchor)


def road_title(kind: str, anchor: str) -> str:
    """Kind of warp, and its anchor if it is not the focal agent."""
    return kind if anchor == DEFAULT_ANCHOR else f"{kind} ahead of the {anchor}"


def severity_curves(
    rows: pa.Table, agents: StudyAgents = STUDY_AGENTS[0]
) -> tuple[SeverityCurve, ...]:
    """One curve for each method, kind of warp and anchor, in the order of the rows.

    Failed variants have no values. Scenes are resampled for the intervals, since seeds
    and agents of one scene are correlated.
    """
    wanted = np.array(rows["agents"].to_pylist(), object) == agents
    rows = rows.filter(pa.array(wanted))
    if not len(rows):
        return ()
    names = ("method", "condition", "kind", "anchor", "folder")
    columns = {name: np.array(rows[name].to_pylist(), object) for name in names}
    power = rows["power"].to_numpy()
    scenes, scene = np.unique(columns["folder"].astype(str), return_inverse=True)
    weights = scene_weights(len(scenes), _SEED)
    sums = np.stack([rows[f"{name}_sum"].to_numpy() for name in STUDY_METRICS])
    counts = np.stack([rows[f"{name}_count"].to_numpy() for name in STUDY_METRICS])
    is_plain = columns["condition"] == PLAIN
    curves = []
    for method, kind, anchor in _families(columns, is_plain):
        here = (columns["method"] == method) & (
            is_plain | ((columns["kind"] == kind) & (columns["anchor"] == anchor))
        )
        powers, cell = np.unique(power[here], return_inverse=True)
        table = np.zeros((2, len(STUDY_METRICS), len(powers), len(scenes)))
        for target, values in zip(table, (sums, counts), strict=True):
            for metric in range(len(STUDY_METRICS)):
                np.add.at(target[metric], (cell, scene[here]), values[metric, here])
        estimates = {
            name: mean_over_scenes(table[0, index], table[1, index], weights)
            for index, name in enumerate(STUDY_METRICS)
        }
        curves.append(
            SeverityCurve(
                method=method,
                kind=kind,
                anchor=anchor,
                agents=agents,
                power=powers,
                estimates=estimates,
                num_scenes=(table[1, 0] > 0).sum(axis=-1),
            )
        )
    return tuple(curves)


def _families(
    columns: dict[str, np.ndarray], is_plain: np.ndarray
) -> list[tuple[str, str, str]]:
    """Methods, kinds and anchors of warped rows, each once."""
    keys = zip(columns["method"], columns["kind"], columns["anchor"], strict=True)
    return list(
        dict.fromkeys(
            key for key, plain in zip(keys, is_plain.tolist(), strict=True) if not plain
        )
    )
