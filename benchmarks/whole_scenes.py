"""Whole generated scenes beside recorded ones: where vehicles stand and how they move.

Four placements: all agents resampled, raw (neither guided nor repaired nor sampled again);
the agents of the square around the focal agent resampled; all agents resampled; as many
agents as fit. Only vehicles near lanes are counted: others keep their
states; pedestrians that stand have a column of their own. The scene test is given by
seed. With ``--signals`` each junction has a phase, and columns tell who obeys it.
The folders stay in ``--out`` for other programs. Needs PD_EDITOR_AV2, or ``--data``.
"""

import argparse
import functools
import os
from pathlib import Path

import numpy as np
import shapely
from jaxtyping import Bool, Float

import pd_editor
from pd_editor.analysis.metrics.box_overlaps import box_overlap, init_five_circles
from pd_editor.analysis.metrics.lanes import ids_near_lanes
from pd_editor.analysis.metrics.road import askew, is_off_road, surroundings
from pd_editor.analysis.metrics.traffic_view import recorded_traffic
from pd_editor.editor.commands.traffic import traffic_command
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.experiments.evaluation.method import Method
from pd_editor.experiments.evaluation.summary import scene_weights
from pd_editor.generation.features.map_pieces import (
    PIECE_SHAPE,
    lane_pieces,
    piece_signals,
)
from pd_editor.generation.features.scene_features import scene_center
from pd_editor.generation.generators import make_generator
from pd_editor.generation.initial_state.guidance import InitialStateGuidance
from pd_editor.generation.initial_state.placement_rules import (
    PLACEMENT_RULES,
    ConflictResampling,
    ConflictSearch,
    KeptPaths,
)
from pd_editor.scene.agent_kind import ROAD_USER_KINDS, AgentKind
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.generation import GenerationRequest, run_to_end
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.junction_phases import junctions
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.scene_cut import FUTURE_S
from pd_editor.scene.thresholds import MOVING_MPS
from scene_test import Surroundings, scene_test

loaded_generator = functools.cache(make_generator)
HALF_SIDE_M = 62.0
PAIR_RULES = ("near", "brakes", "waits", "crossing")
PLACEMENTS = ("raw", "square", "resampled", "fit")
COLUMNS = (
    "speed, m/s",
    "standing, %",
    "off drivable, %",
    "path, m",
    "askew to lane, %",
    "askew to nearest, %",
    "gap < 1 m, %",
    "3 within 4 m, %",
    "boxes overlap, %",
    "five circles, %",
    "in conflict, %",
    "crossing, %",
    "before red, %",
    "before green, %",
    "on foot, %",
)
BEFORE = 0.55
"""Nearness of a stop line from which vehicles that stand before it are counted: 36 m."""
ON_LANE_M, ALONG_RAD = 6.0, 0.5
Columns = tuple[np.ndarray, np.ndarray]
"""Sums and counts of the columns in each scene [columns, scenes]."""
SCALE = np.array([100.0 if name.endswith("%") else 1.0 for name in COLUMNS])


def generate(
    folder: Path, placement: str, model: str, seed: int, out: Path, *, signals: bool
) -> Scenario:
    """One scene with one placement."""
    scenario = open_scenario(folder, until_s=FUTURE_S)
    agents, step = scenario.agents, scenario.current_step
    rows = np.flatnonzero(agents.is_valid[:, step] & agents.kind_mask(ROAD_USER_KINDS))
    center = scene_center(scenario)
    options = {"model": model, "seed": seed, "name": folder.stem, "out": out}
    options |= {"until": FUTURE_S, "sample_signals": signals and has_phases(scenario)}
    if placement == "fit":
        return pd_editor.generate(folder, num_agents="fit", **options).scenarios[0]
    region = None
    if placement == "square":
        away = np.abs(agents.position_m[rows, step] - center).max(axis=1)
        rows = rows[away <= HALF_SIDE_M]
        region = (float(center[0]), float(center[1]), HALF_SIDE_M)
    ids = tuple(agents.ids[row] for row in rows)
    if placement == "raw":
        return raw(scenario, ids, model, seed)
    found = pd_editor.generate(
        folder, agents=ids, resample_states=True, region=region, **options
    )
    return found.scenarios[0]


def raw(scenario: Scenario, ids: tuple[str, ...], model: str, seed: int) -> Scenario:
    """The scene with states and trajectories of some agents as the networks sample them."""
    request = GenerationRequest(
        scenario=scenario, agent_ids=ids, resampled_state_ids=ids, seed=seed
    )
    method = Method(name=f"{model}:raw=1", make_generator=loaded_generator)
    request = method.with_options(request)
    traffic = run_to_end(loaded_generator(model).generate(request))
    return traffic_command(request, traffic).apply(scenario)


def has_phases(scenario: Scenario) -> bool:
    """Whether a junction of the map has lanes that cross."""
    return bool(junctions(scenario.original_road_map))


def obedience(scenario: Scenario, rows: np.ndarray) -> Float[np.ndarray, "V 2"]:
    """Whether vehicles before red and green lights stand; NaN for all others."""
    step = scenario.current_step
    pieces = lane_pieces(scenario.road_map)
    says = piece_signals(scenario, pieces)
    place = scenario.agents.position_m[rows, step]
    turn = wrap_angle(
        scenario.agents.heading_rad[rows, step][:, None] - pieces.pose[:, 2]
    )
    gap = np.linalg.norm(place[:, None] - pieces.pose[:, :2], axis=-1)
    gap = np.where((np.abs(turn) < ALONG_RAD) & (pieces.lane >= 0), gap, np.inf)
    if not gap.size:
        return np.full((len(rows), 2), np.nan)
    own = gap.argmin(axis=1)
    inside = pieces.shape[own, PIECE_SHAPE.index("is_intersection")] > 0
    counts = (gap.min(axis=1) < ON_LANE_M) & ~inside
    stands = scenario.agents.speed_mps()[rows, step] < MOVING_MPS
    most = says[own].max(axis=1) > BEFORE
    is_told = (counts & most)[:, None] & (says[own] > 2 * says[own][:, ::-1])
    return np.where(is_told, stands[:, None], np.nan)


def path_m(
    position_m: Float[np.ndarray, "A T 2"], is_valid: Bool[np.ndarray, "A T"]
) -> Float[np.ndarray, "A"]:
    """Path length over all steps, at the mean speed of the observed ones.

    Fast vehicles leave the observed area first: the mean over those that are observed to
    the end would be too short. NaN for agents that are observed at one step only.
    """
    is_observed = is_valid[:, 1:] & is_valid[:, :-1]
    step_m = np.linalg.norm(np.diff(position_m, axis=1), axis=-1)
    count = is_observed.sum(axis=1)
    total_m = np.where(is_observed, step_m, 0.0).sum(axis=1)
    mean_m = total_m / np.where(count > 0, count, np.nan)
    return mean_m * is_observed.shape[1]


def in_conflict(
    agents: AgentTracks, scenario: Scenario, names: tuple[str, ...]
) -> Bool[np.ndarray, "A A"]:
    """Which pairs of agents break some placement rules."""
    rules = [one for one in PLACEMENT_RULES if one.name in names]
    search = ConflictSearch.of(ConflictResampling(), InitialStateGuidance(), rules)
    nothing = KeptPaths.of(scenario, scenario.agents.ids)
    return search.conflicts(agents, scenario, nothing)


def vehicle_rows(scenario: Scenario) -> np.ndarray:
    """A row for each vehicle near lanes at the current step; NaN where a column is unknown."""
    view = recorded_traffic(scenario)
    agents = view.agents
    speed = np.hypot(*agents.velocity_mps[:, 0].T)
    path = path_m(agents.position_m, agents.is_valid)
    columns = [
        speed,
        speed < MOVING_MPS,
        is_off_road(scenario, agents.position_m[:, 0]),
        path,
        *(np.where(one.is_valid, one.value, np.nan) for one in askew(view)),
    ]
    is_vehicle = np.array([kind == AgentKind.VEHICLE for kind in agents.kinds], bool)
    now = agents.taken(is_vehicle).at_steps(np.array([0])).boxes
    shapes = np.asarray(shapely.polygons(now.corners_m()[:, 0]))
    gap = shapely.distance(shapes[:, None], shapes[None])
    np.fill_diagonal(gap, np.inf)
    tracks = scenario.agents.taken(scenario.agents.rows(agents.ids))
    pairs = in_conflict(tracks, scenario, PAIR_RULES)
    crossing = in_conflict(tracks, scenario, ("crossing",))
    near = [
        (gap < 1.0).any(axis=1),
        (gap < 4.0).sum(axis=1) >= 3,
        box_overlap(view).at_state().value[is_vehicle],
        init_five_circles(view).value[is_vehicle],
        pairs[is_vehicle][:, is_vehicle].any(axis=1),
        crossing[is_vehicle].any(axis=1),
    ]
    ids = [name for name, is_it in zip(agents.ids, is_vehicle, strict=True) if is_it]
    obeys = obedience(scenario, scenario.agents.rows(ids))
    nobody = np.full(len(ids), np.nan)
    table = [np.column_stack(columns)[is_vehicle], *near, obeys, nobody]
    found = np.column_stack(table)[np.isin(ids, ids_near_lanes(scenario, ids))]
    walks = np.array([kind == AgentKind.PEDESTRIAN for kind in agents.kinds], bool)
    afoot = np.full((walks.sum(), found.shape[1]), np.nan)
    afoot[:, -1] = speed[walks] < MOVING_MPS
    return np.concatenate([found, afoot])


def columns_of(scenes: list[tuple[str, Scenario]]) -> Columns:
    """Sum the number of vehicles and the columns in each scene, over all seeds."""
    names = sorted({name for name, _ in scenes})
    sums = np.zeros((len(COLUMNS) + 1, len(names)))
    counts = np.zeros_like(sums)
    for name, scenario in scenes:
        table = vehicle_rows(scenario)
        known = np.isfinite(table)
        scene = names.index(name)
        sums[0, scene] += known[:, 0].sum()
        counts[0, scene] += 1
        sums[1:, scene] += SCALE * np.where(known, table, 0.0).sum(axis=0)
        counts[1:, scene] += known.sum(axis=0)
    return sums, counts


def means(
    columns: Columns, weights: Float[np.ndarray, "R N"]
) -> Float[np.ndarray, "C R"]:
    """Means of the columns; each scene counts as often as a row of weights says."""
    sums, counts = columns
    with np.errstate(invalid="ignore"):
        return (sums @ weights.T) / (counts @ weights.T)


def lines(name: str, columns: Columns, recorded: Columns) -> str:
    """Means over all vehicles, and how far they are from the recorded ones.

    Intervals hold 95 % of bootstrap resamples of scenes, the same for both.
    """
    once = np.ones((1, columns[0].shape[1]))
    found = f"{name:10}" + "".join(f"{one:20.2f}" for one in means(columns, once)[:, 0])
    if columns is recorded:
        return found
    weights = scene_weights(columns[0].shape[1], seed=0)
    apart = means(columns, weights) - means(recorded, weights)
    ends = np.nanquantile(apart, [0.025, 0.975], axis=1).T
    cells = (f"[{low:+.1f}, {high:+.1f}]" for low, high in ends)
    return f"{found}\n{'- recorded':10}" + "".join(f"{cell:>20}" for cell in cells)


def vehicles_of(scenes: list[tuple[str, Scenario]]) -> Surroundings:
    """Surroundings of all vehicles near lanes."""
    found, names = [], []
    for name, scenario in scenes:
        view = recorded_traffic(scenario)
        values = surroundings(view)
        ids = list(view.agents.ids)
        chosen = values.is_valid.all(axis=1)
        chosen &= np.isin(ids, ids_near_lanes(scenario, ids))
        found.append(values.value[chosen])
        names += [name] * int(chosen.sum())
    return Surroundings(features=np.concatenate(found), scene=np.array(names))


def main() -> None:
    """Print the means of the recordings, and of each placement over all seeds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", default="path-diffuser")
    parser.add_argument("--split", default="val")
    parser.add_argument("--data", type=Path, nargs="+", help="scenes instead")
    parser.add_argument("--signals", action="store_true")
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    if options.data:
        folders = sorted(options.data)
    else:
        root = Path(os.environ["PD_EDITOR_AV2"]) / options.split
        folders = sorted(path.parent for path in root.glob("*/scenario*.parquet"))
    log = [(one.name, open_scenario(one, until_s=FUTURE_S)) for one in folders]
    heads = ("vehicles", *COLUMNS)
    print(" " * 10 + "".join(f"{name:>20}" for name in heads))
    recorded, vehicles = columns_of(log), vehicles_of(log)
    print(lines("recorded", recorded, recorded))
    for placement in PLACEMENTS:
        made: list[tuple[str, Scenario]] = []
        tests = []
        for seed in range(options.seeds):
            out = options.out / f"{placement}-{seed}"
            own = [
                (
                    folder.name,
                    generate(
                        folder,
                        placement,
                        options.model,
                        seed,
                        out,
                        signals=options.signals,
                    ),
                )
                for folder in folders
            ]
            tests.append(scene_test(vehicles, vehicles_of(own)))
            made += own
        print(lines(placement, columns_of(made), recorded), flush=True)
        found = [one.auc for one in tests if one is not None]
        each = ", ".join(f"{auc:.2f}" for auc in found)
        print(f"scene test {np.mean(found):.2f} ({each})", flush=True)


if __name__ == "__main__":
    main()
