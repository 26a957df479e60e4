"""Pipeline of the first stage: samples initial states on a scenario and repairs them."""

from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final, TypeVar

import numpy as np
import torch
from jaxtyping import Float, Int

from pd_editor.analysis.metrics.road import is_off_road
from pd_editor.analysis.repair.state_repairs import (
    project_to_lanes,
    separate_overlaps,
    slow_for_gaps,
)
from pd_editor.base.errors import GenerationError
from pd_editor.generation.core.random_streams import SceneStreams
from pd_editor.generation.core.sampler import Sampler, sample_steps, sampling_mode
from pd_editor.generation.features.map_pieces import CROSSWALK_KIND, lane_pieces
from pd_editor.generation.features.scene_features import (
    AGENT_KINDS,
    PackedScene,
    SceneFeatures,
    packed,
    scene_features,
)
from pd_editor.generation.features.scene_fields import LATENT_SIZE
from pd_editor.generation.initial_state.attributes import (
    AttributeRequest,
    with_attributes,
    with_attributes_of,
)
from pd_editor.generation.initial_state.guidance import InitialStateGuidance
from pd_editor.generation.initial_state.network.agent_count_prior import (
    cells_of,
    lane_length_m,
)
from pd_editor.generation.initial_state.network.conditioning import (
    CONDITIONED_NO,
    REACH_M,
    Conditioning,
    sampling_conditioning,
)
from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.initial_state.network.map_tokens import EncodedMap
from pd_editor.generation.initial_state.network.state_encoding import POSITION_UNIT_M
from pd_editor.generation.initial_state.placement_rules import ConflictSearch, KeptPaths
from pd_editor.generation.initial_state.sampler import (
    InitialStateGuide,
    InitialStateSamplerConfig,
    finished_activity,
    finished_states,
    sample_initial_states,
)
from pd_editor.generation.inputs import SceneTensors, batch_of, padded_size
from pd_editor.scene.agent_kind import (
    LANE_FOLLOWER_KINDS,
    ROAD_USER_KINDS,
    AgentCategory,
    AgentKind,
    default_sizes_m,
    sampled_sizes_m,
)
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.generation import MAX_SEED, Region
from pd_editor.scene.geometry.angles import unit_vector
from pd_editor.scene.scenario import Scenario

_KIND_INDEX: Final = {kind: index for index, kind in enumerate(AGENT_KINDS)}
_LEAST_HALF_SIDE_M: Final = 5.0
_MOST_ROWS_AT_ONCE: Final = 255
"""Largest number of agents times samples in a batch, for which one thread is used."""
_MOST_GPU_PAIRS: Final = 1_000_000
"""The same on a GPU: pairs of agents, each of which takes about a kilobyte."""
_Progress = TypeVar("_Progress")
_PLACE_DIGITS: Final = 2
_HEADING_DIGITS: Final = 3
_SPEED_DIGITS: Final = 2
"""Sampled states are rounded to a centimetre, a milliradian and a centimetre a second."""
_VERSION_STEP: Final = 1_000_003
"""Difference of the sample indices of the versions of a sample."""


@dataclass(frozen=True, kw_only=True)
class InitialStateOptions:
    """Options of the sampling of initial states."""

    sampler: InitialStateSamplerConfig = field(
        default_factory=InitialStateSamplerConfig
    )
    steps: Sampler = sample_steps
    """The sampler itself."""
    guidance: InitialStateGuidance | None = field(default_factory=InitialStateGuidance)
    """None leaves states as they are predicted."""
    conflicts: ConflictSearch | None = None
    """Which placed agents are sampled again; None leaves all as they are."""


@dataclass(frozen=True, kw_only=True)
class SquarePlacement:
    """Agents to place in one square, and how."""

    resampled_ids: tuple[str, ...]
    """Agents of the scenario whose states are resampled."""
    new_kinds: tuple[AgentKind, ...]
    new_ids: tuple[str, ...]
    region: Region
    """The square; at most as large as in training."""
    traits: AttributeRequest = field(default_factory=AttributeRequest)
    repairs: bool = True
    """Whether sampled agents are snapped to lanes and separated afterwards."""
    square: int = 0
    """Index of the square in the scene; each has separate random numbers."""
    turn: int | None = None
    """Squares of one turn are sampled in one batch, given those of earlier turns; None:
    each square is sampled alone, in order."""
    is_again: bool = False
    """Whether the agents were placed before; they keep the attributes that ``traits``
    gave them."""

    @property
    def ids(self) -> tuple[str, ...]:
        """Ids of all agents that are placed."""
        return self.resampled_ids + self.new_ids


def new_agent_kinds(numbers: Mapping[AgentKind, int]) -> tuple[AgentKind, ...]:
    """Kinds of agents, given their numbers by kind."""
    return tuple(kind for kind in AGENT_KINDS for _ in range(numbers.get(kind, 0)))


def new_agent_ids(scenario: Scenario, number: int) -> tuple[str, ...]:
    """Unused ids for new agents."""
    ids: list[str] = []
    index = 0
    while len(ids) < number:
        index += 1
        if f"new-{index}" not in scenario.agents.row_of:
            ids.append(f"new-{index}")
    return tuple(ids)


@dataclass(frozen=True, kw_only=True, eq=False)
class SquareContent:
    """Lanes and agents of a square of a scene."""

    half_side_m: float
    lane_m: float
    """Length of vehicle lanes."""
    num_present: Int[np.ndarray, "K"]
    """Number of agents of each of ``AGENT_KINDS``."""

    @classmethod
    def of(
        cls, scenario: Scenario, region: Region, *, only_on_road: bool
    ) -> "SquareContent":
        """Count lanes and agents of a scenario; ``only_on_road`` for agents on the road."""
        center, half_side = _square(region)
        features = scene_features(scenario, with_candidates=False, center_m=center)
        is_inside = (np.abs(features.agent_pose[:, :2]) <= half_side).all(axis=1)
        scene = batch_of([packed(features, _no_latents)])
        cells = cells_of(scene, np.resize(is_inside, scene.has_agent.shape))[0]
        present = cells[..., 1] if only_on_road else cells.sum(axis=-1)
        return cls(
            half_side_m=half_side,
            lane_m=lane_length_m(
                features.piece_pose,
                features.piece_shape,
                features.piece_kind,
                half_side,
            ),
            num_present=present.sum(axis=-1),
        )


def sample_agent_counts(
    model: InitialStateDenoiser,
    square: SquareContent,
    random: np.random.Generator,
    *,
    only_on_road: bool,
) -> Mapping[AgentKind, int]:
    """Sample the total number of agents of each kind, as in similar training squares.

    Raises:
        GenerationError: the model has no counts of its training data.
    """
    counts = model.agent_counts
    if not len(counts.lane_m):
        raise GenerationError(
            "These weights do not tell how many agents a road has; give numbers."
        )
    return counts.sample(
        square.lane_m, square.half_side_m, random, only_on_road=only_on_road
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class SquareTask:
    """Agents to place in one square of one sample."""

    sample: int
    kept: Scenario
    """The scenario without the agents to place."""
    placing: SquarePlacement
    placed: AgentTracks
    """Tracks of the agents to place, without any state."""
    features: SceneFeatures
    """Of the kept agents."""
    rows: Int[np.ndarray, "K"]
    """Agents that are within reach of the network: kept ones, then all to place."""

    @classmethod
    def of(
        cls, scenario: Scenario, kept: Scenario, sample: int, placing: SquarePlacement
    ) -> "SquareTask":
        """Make a task; ``kept`` is the scenario without the agents to place.

        Raises:
            GenerationError: there is no road, or an agent is no road user.
        """
        center, _ = _square(placing.region)
        around = kept if placing.turn is None else _around(kept, center)
        features = scene_features(around, with_candidates=False, center_m=center)
        is_near = (np.abs(features.piece_pose[:, :2]) <= REACH_M).all(axis=1)
        if not (is_near & (features.piece_kind < CROSSWALK_KIND)).any():
            raise GenerationError(no_lanes(kept, center))
        placed = _agents_to_place(scenario, placing)
        # Others only take time: they are masked, and too far away for guidance.
        reached = (np.abs(features.agent_pose[:, :2]) <= REACH_M).all(axis=1)
        return cls(
            sample=sample,
            kept=kept,
            placing=placing,
            placed=placed,
            features=features,
            rows=np.flatnonzero(np.append(reached, np.ones(len(placed), bool))),
        )

    def for_sample(self, sample: int, seed: int) -> "SquareTask":
        """The task of a sample, whose new agents have sizes of their own."""
        kinds = self.placing.new_kinds
        # Key of the random numbers of the sizes of new agents.
        random = np.random.default_rng([seed, sample, 3, self.placing.square])
        rows = np.arange(len(self.placed) - len(kinds), len(self.placed))
        sizes = sampled_sizes_m(kinds, random)
        placed = self.placed.with_rows(rows, size_m=sizes)
        return replace(self, sample=sample, placed=placed)

    @property
    def num_agents(self) -> int:
        """Number of kept agents and agents to place."""
        return len(self.features.agent_row) + len(self.placed)

    @property
    def num_given(self) -> int:
        """Number of kept agents within reach."""
        return len(self.rows) - len(self.placed)

    def packed(self) -> PackedScene:
        """The agents within reach; of those to place, only kinds and sizes are known."""
        kinds = np.array([_KIND_INDEX[kind] for kind in self.placed.kinds], int)
        scene = packed(self.features, _no_latents).with_agents(
            len(self.placed), agent_size=self.placed.size_m, agent_kind=kinds
        )
        return scene.only_agents(self.rows)


def place_in_squares(
    model: InitialStateDenoiser,
    scenario: Scenario,
    placings: Mapping[int, Sequence[SquarePlacement]],
    *,
    seed: int,
    options: InitialStateOptions | None = None,
    generated_ids: Sequence[str] = (),
    progress: Callable[[float], _Progress] = lambda share: share,
) -> Generator[_Progress, None, list[Scenario]]:
    """Sample initial states square by square; returns each sample's scenario.

    All samples of a square, or of the squares of a turn, are denoised in one batch. Each is
    conditioned on the agents of the sample that were placed before. Then agents that break a placement rule
    are sampled again, in several versions of which the best is taken, given all others;
    those whose trajectories are to be generated keep no path that others must leave free.
    Placed agents exist at the current step only.
    Yields ``progress`` of the share that is done.

    Raises:
        GenerationError: there is no road where agents are to be placed.
    """
    options = InitialStateOptions() if options is None else options
    share = 1.0 if options.conflicts is None else 0.5
    place = partial(_place_once, model, maps={})
    found = yield from place(
        dict.fromkeys(placings, scenario),
        placings,
        seed=seed,
        options=options,
        progress=lambda part: progress(share * part),
    )
    if options.conflicts is not None:
        own = {
            name for squares in placings.values() for one in squares for name in one.ids
        }
        own |= set(generated_ids)
        kept = KeptPaths.of(scenario, [n for n in scenario.agents.ids if n in own])
        found |= yield from _placed_anew(
            partial(place, progress=lambda part: progress((1 + part) / 2)),
            found,
            placings,
            options.conflicts,
            kept,
            seed=seed,
            options=options,
        )
    return [_slowed(found[sample], squares) for sample, squares in placings.items()]


def _placed_anew(
    place: Callable[..., Generator[_Progress, None, dict[int, Scenario]]],
    scenes: Mapping[int, Scenario],
    placings: Mapping[int, Sequence[SquarePlacement]],
    conflicts: ConflictSearch,
    kept: KeptPaths,
    *,
    seed: int,
    options: InitialStateOptions,
) -> Generator[_Progress, None, dict[int, Scenario]]:
    """Scenes in which agents break a placement rule, with these placed again."""
    offenders: dict[int, tuple[str, ...]] = {}
    for sample, squares in placings.items():
        placed = [name for one in squares for name in one.ids]
        # Key of the random numbers that choose among agents in conflict.
        random = np.random.default_rng([seed, sample, 2, 0])
        if ids := conflicts.conflicting(scenes[sample], placed, random, kept):
            offenders[sample] = ids
    if not offenders:
        return {}
    num_versions = conflicts.settings.num_versions
    num_steps = max(options.sampler.num_steps // num_versions, 1)
    # Difference of the seed with which agents are placed again.
    versions = yield from _versions(
        partial(
            place,
            seed=(seed + 1_000_033) % MAX_SEED,
            options=replace(
                options, sampler=replace(options.sampler, num_steps=num_steps)
            ),
        ),
        scenes,
        {key: placed_again(placings[key], ids) for key, ids in offenders.items()},
        num_versions,
    )
    return {
        sample: conflicts.best_of(versions[sample], ids, kept)
        for sample, ids in offenders.items()
    }


def _versions(
    place: Callable[..., Generator[_Progress, None, dict[int, Scenario]]],
    scenes: Mapping[int, Scenario],
    placings: Mapping[int, Sequence[SquarePlacement]],
    count: int,
) -> Generator[_Progress, None, dict[int, list[Scenario]]]:
    """Some versions of each sample, all in one batch, each with its own random numbers."""
    keys = {one: [one + n * _VERSION_STEP for n in range(count)] for one in placings}
    sample_of = {key: sample for sample, own in keys.items() for key in own}
    placed = yield from place(
        {key: scenes[sample] for key, sample in sample_of.items()},
        {key: placings[sample] for key, sample in sample_of.items()},
    )
    return {sample: [placed[key] for key in own] for sample, own in keys.items()}


def _place_once(
    model: InitialStateDenoiser,
    scenes: Mapping[int, Scenario],
    placings: Mapping[int, Sequence[SquarePlacement]],
    *,
    seed: int,
    maps: dict[int, EncodedMap],
    options: InitialStateOptions,
    progress: Callable[[float], _Progress],
) -> Generator[_Progress, None, dict[int, Scenario]]:
    """Scenes of some samples with their agents placed, square by square or in turns."""
    bare: dict[tuple[int, tuple[str, ...]], Scenario] = {}
    found: dict[int, Scenario] = {}
    for sample, squares in placings.items():
        resampled = tuple(name for one in squares for name in one.resampled_ids)
        # Samples of one scene share the scenario without these agents, and its features.
        key = id(scenes[sample]), resampled
        if key not in bare:
            bare[key] = scenes[sample].without_agents(resampled)
        found[sample] = bare[key]
    by_turn: dict[int, list[tuple[int, SquarePlacement]]] = {}
    for sample, squares in placings.items():
        for one in squares:
            turn = one.square if one.turn is None else one.turn
            by_turn.setdefault(turn, []).append((sample, one))
    total, done = sum(map(len, by_turn.values())), 0
    for turn in sorted(by_turn):
        alike: dict[tuple[int, SquarePlacement], SquareTask] = {}
        tasks: list[SquareTask] = []
        for sample, placing in by_turn[turn]:
            key = id(found[sample]), placing
            if key not in alike:
                alike[key] = SquareTask.of(
                    scenes[sample], found[sample], sample, placing
                )
            tasks.append(alike[key].for_sample(sample, seed))
        for batch in _batches(tasks, model.get_buffer("counted").device):
            share = partial(_share_of, done, len(batch), total)
            placed = yield from place_agents(
                model,
                [replace(one, kept=found[one.sample]) for one in batch],
                seed=seed,
                maps=maps,
                options=options,
                progress=lambda part, share=share: progress(share(part)),
            )
            own = dict.fromkeys(one.sample for one in batch)
            found.update(zip(own, placed, strict=True))
            done += len(batch)
    return found


def placed_again(
    placings: Sequence[SquarePlacement], agent_ids: Collection[str]
) -> tuple[SquarePlacement, ...]:
    """Placements of some agents that were placed before, each in its square."""
    again = [
        replace(
            one,
            resampled_ids=tuple(name for name in one.ids if name in agent_ids),
            new_ids=(),
            new_kinds=(),
            is_again=True,
        )
        for one in placings
    ]
    return tuple(one for one in again if one.ids)


def _share_of(done: int, count: int, total: int, part: float) -> float:
    return (done + count * part) / total


def _batches(
    tasks: Sequence[SquareTask], device: torch.device
) -> Iterator[list[SquareTask]]:
    """Tasks that are denoised together: of equal size, and few enough for one thread.

    Sums over agents are then in the same order as in a batch of one, and so are most
    products of matrices. That matters, since differences in the last digits grow from step
    to step: some agents were metres away from those of the sample alone. The squares of a
    turn are together whatever their size: each sample has the same ones.
    """
    alike: dict[tuple[int, ...], list[SquareTask]] = {}
    for task in tasks:
        size = padded_size(len(task.rows))
        in_turn = task.placing.turn is not None
        key = (task.sample % _VERSION_STEP, 0) if in_turn else (0, size)
        alike.setdefault(key, []).append(task)
    for together in alike.values():
        left = sorted(together, key=lambda one: -padded_size(len(one.rows)))
        while left:
            size = padded_size(len(left[0].rows))
            most = (
                _MOST_ROWS_AT_ONCE if device.type == "cpu" else _MOST_GPU_PAIRS // size
            )
            count = max(1, most // size)
            yield left[:count]
            del left[:count]


def place_agents(
    model: InitialStateDenoiser,
    tasks: Sequence[SquareTask],
    *,
    seed: int,
    maps: dict[int, EncodedMap],
    options: InitialStateOptions,
    progress: Callable[[float], _Progress],
) -> Generator[_Progress, None, list[Scenario]]:
    """Sample the initial states of one square of several samples, in one batch.

    The tasks are of one square, or of squares of one turn, which do not touch. Returns
    each sample's scenario with the agents. A sample does not depend on the others, apart
    from rounding. ``maps`` are encoded maps by square; that of a new square is added.

    Raises:
        GenerationError: there is no road where agents are to be placed.
    """
    placing = tasks[0].placing
    device = model.get_buffer("counted").device
    scenes_of_square = batch_of([one.packed() for one in tasks], pads_single=True)
    square, samples = placing.square, [one.sample for one in tasks]
    if placing.turn is None:
        # The tokens of the map, which all samples share, are encoded once.
        scenes_of_square = scenes_of_square.with_one_map()
    else:
        square, maps = 0, {}
        samples = [one.sample + one.placing.square * _VERSION_STEP**2 for one in tasks]
    scene = scenes_of_square.to(device)
    further = [square] if square else []
    # Key of the random numbers of attributes, different from those of agent counts.
    randoms = [np.random.default_rng([seed, one, 1, *further]) for one in samples]
    task = _conditioning(model, scene, tasks, randoms)
    if square not in maps:
        with sampling_mode(scene.has_agent.numel()):
            maps[square] = model.encode_map(scene)
    name = f"states-{square}" if square else "states"
    rows = [(one.num_agents, one.rows) for one in tasks]
    steps = sample_initial_states(
        model,
        scene,
        SceneStreams(seed, name, samples, rows),
        task,
        config=options.sampler,
        sampler=options.steps,
        guide=_guide(model, scene, task, tasks, randoms, options.guidance),
        road_map=maps[square],
    )
    clean = None
    for step in steps:
        clean = step.clean
        yield progress((step.index + 1) / step.num_steps)
    assert clean is not None, "there is at least one step"
    return _placed(tasks, scene, task, clean)


def _guide(
    model: InitialStateDenoiser,
    scene: SceneTensors,
    task: Conditioning,
    tasks: Sequence[SquareTask],
    randoms: Sequence[np.random.Generator],
    guidance: InitialStateGuidance | None,
) -> InitialStateGuide | None:
    """Guide of predicted states; which agents may stand in a junction is random."""
    if guidance is None:
        return None
    if tasks[0].placing.traits.only_on_road:
        guidance = guidance.within_lanes()
    may_stop = np.zeros(scene.has_agent.shape, bool)
    for stops, one, random in zip(may_stop, tasks, randoms, strict=True):
        numbers = random.random(one.num_agents)[one.rows]
        stops[: len(numbers)] = numbers < guidance.stopped_in_junctions
    here = torch.from_numpy(may_stop).to(scene.has_agent.device)
    return guidance.of(scene, model.schedule, task, here)


def _conditioning(
    model: InitialStateDenoiser,
    scene: SceneTensors,
    tasks: Sequence[SquareTask],
    randoms: Sequence[np.random.Generator],
) -> Conditioning:
    """What the network is told of the agents to place."""
    placing = tasks[0].placing
    _, half_side = _square(placing.region)
    device = scene.has_agent.device
    row = torch.arange(scene.has_agent.shape[1], device=device)
    num_given = torch.tensor([one.num_given for one in tasks], device=device)
    task = sampling_conditioning(
        scene,
        row < num_given[:, None],
        scene.agent_speed.new_full((len(tasks),), half_side),
        within_kinds=not model.config.orders_all_kinds,
    )
    if placing.traits == AttributeRequest():
        return task
    if placing.is_again:
        kept = [(one.kept, one.placed) for one in tasks]
        return with_attributes_of(task, scene, kept)
    return with_attributes(task, scene, model.agent_counts, randoms, placing.traits)


def _placed(
    tasks: Sequence[SquareTask],
    scene: SceneTensors,
    task: Conditioning,
    clean: Float[torch.Tensor, "S B A P"],
) -> list[Scenario]:
    """Scenarios of samples with their states, repaired where that is wanted."""
    states = finished_states(scene, task, clean)[0].double().cpu().numpy()
    activity = finished_activity(scene, task, clean)[0].cpu().numpy()
    on_road = task.on_road.cpu().numpy()
    scenes: dict[int, Scenario] = {}
    repaired: dict[int, list[tuple[SquarePlacement, np.ndarray]]] = {}
    for index, one in enumerate(tasks):
        own = slice(one.num_given, len(one.rows))
        tracks = _with_states(
            one.placed,
            states[index, own],
            activity[index, own],
            _square(one.placing.region)[0],
            one.kept.current_step,
        )
        kept = scenes.get(one.sample, one.kept)
        scenes[one.sample] = kept.with_agents(kept.agents.joined(tracks))
        if one.placing.repairs:
            more = one.placing, on_road[index, own]
            repaired.setdefault(one.sample, []).append(more)
    for sample, placed in repaired.items():
        placings, codes = zip(*placed, strict=True)
        scenes[sample] = _repaired(scenes[sample], placings, np.concatenate(codes))
    return list(scenes.values())


def _repaired(
    scenario: Scenario,
    placings: Sequence[SquarePlacement],
    on_road: Int[np.ndarray, "N"],
) -> Scenario:
    """Repair sampled states: snap to lanes, separate boxes, limit speeds to gaps.

    Agents conditioned off-road are not snapped, and no agent leaves its square.
    """
    ids = [name for one in placings for name in one.ids]
    follows = [
        name for name, code in zip(ids, on_road, strict=True) if code != CONDITIONED_NO
    ]
    on_lanes = project_to_lanes(scenario, follows)
    left = _outside(on_lanes, placings) - _outside(scenario, placings)
    if left:
        follows = [name for name in follows if name not in left]
        on_lanes = project_to_lanes(scenario, follows)
    scenario = separate_overlaps(on_lanes, ids)
    if placings[0].traits.only_on_road:
        scenario = _back_on_road(scenario, placings)
    return slow_for_gaps(scenario, ids)


def _slowed(scenario: Scenario, placings: Sequence[SquarePlacement]) -> Scenario:
    """Limit speeds to gaps to agents that were placed later, in other squares or again."""
    repaired = {name for one in placings if one.repairs for name in one.ids}
    return slow_for_gaps(scenario, repaired)


def _back_on_road(scenario: Scenario, placings: Sequence[SquarePlacement]) -> Scenario:
    """Placed agents beside the drivable area on their lanes, standing ones as well.

    An agent near a lane may be beside the road all the same: next to a narrow lane, or
    at a kerb. An agent stays where its lane has no free place, or leaves the square.
    """
    off = _off_road(scenario, [name for one in placings for name in one.ids])
    for _ in range(2):
        back = project_to_lanes(scenario, off, max_offset_m=0.0, moves_stationary=True)
        left = _outside(back, placings) - _outside(scenario, placings)
        if not left:
            return back
        off = [name for name in off if name not in left]
    return scenario


def _off_road(scenario: Scenario, agent_ids: Sequence[str]) -> list[str]:
    """Those whose kind belongs on the road, and whose centre is off the drivable area."""
    agents = scenario.agents
    rows = agents.rows(agent_ids)
    place = agents.position_m[rows, scenario.current_step]
    is_off = is_off_road(scenario, place) & agents.kind_mask(LANE_FOLLOWER_KINDS)[rows]
    return [name for name, off in zip(agent_ids, is_off, strict=True) if off]


def _outside(scenario: Scenario, placings: Sequence[SquarePlacement]) -> set[str]:
    """Ids of the placed agents outside their squares."""
    found: set[str] = set()
    for one in placings:
        center, half_side = _square(one.region)
        rows = scenario.agents.rows(one.ids)
        place = scenario.agents.position_m[rows, scenario.current_step]
        is_out = np.any(np.abs(place - center) > half_side, axis=1)
        found.update(name for name, out in zip(one.ids, is_out, strict=True) if out)
    return found


def _around(scenario: Scenario, center_m: Float[np.ndarray, "2"]) -> Scenario:
    """The scenario with the agents within reach of a square only."""
    place = scenario.agents.position_m[:, scenario.current_step]
    near = np.flatnonzero((np.abs(place - center_m) <= REACH_M).all(axis=1))
    return scenario.with_agents(scenario.agents.taken(near))


def _square(region: Region) -> tuple[Float[np.ndarray, "2"], float]:
    if region.half_side_m < _LEAST_HALF_SIDE_M:
        raise GenerationError(
            f"The square to place agents in reaches {region.half_side_m:g} m to each "
            f"side; expected {_LEAST_HALF_SIDE_M:g} m or more."
        )
    return np.array(region.center_m, float), min(region.half_side_m, POSITION_UNIT_M)


def no_lanes(scenario: Scenario, place_m: Float[np.ndarray, "2"]) -> str:
    """Message that there are no lanes at a position, and where they are."""
    pieces = lane_pieces(scenario.road_map)
    points = pieces.pose[pieces.kind < CROSSWALK_KIND, :2]
    here = f"There are no lanes around ({place_m[0]:.0f}, {place_m[1]:.0f}) m"
    if not len(points):
        return f"{here}, nor anywhere in this scene; expected a road there."
    low, high = points.min(axis=0), points.max(axis=0)
    near = points[np.hypot(*(points - place_m).T).argmin()]
    return (
        f"{here}; lanes lie at x from {low[0]:.0f} to {high[0]:.0f} m and y from "
        f"{low[1]:.0f} to {high[1]:.0f} m, the nearest one at "
        f"({near[0]:.0f}, {near[1]:.0f}) m."
    )


def _agents_to_place(scenario: Scenario, placing: SquarePlacement) -> AgentTracks:
    agents, steps = scenario.agents, scenario.time_axis.num_steps
    old = agents.taken(agents.rows(placing.resampled_ids))
    strange = [kind for kind in old.kinds if kind not in ROAD_USER_KINDS]
    if strange:
        raise GenerationError(
            f"The model places road users only, not {strange[0].value.replace('_', ' ')}."
        )
    count = len(placing.new_ids)
    new = AgentTracks(
        ids=placing.new_ids,
        kinds=placing.new_kinds,
        categories=(AgentCategory.UNSCORED,) * count,
        size_m=default_sizes_m(placing.new_kinds),
        has_known_size=np.zeros(count, bool),
        position_m=np.zeros((count, steps, 2)),
        heading_rad=np.zeros((count, steps)),
        velocity_mps=np.zeros((count, steps, 2)),
        is_valid=np.zeros((count, steps), bool),
        observed=np.zeros((count, steps), bool),
    )
    return old.joined(new)


def _no_latents(
    future_m: Float[np.ndarray, "*s H 2"], speed_mps: np.ndarray, /
) -> Float[np.ndarray, "*s 10"]:
    """Zero latents: the first stage does not use trajectories."""
    del speed_mps
    return np.zeros((*future_m.shape[:-2], LATENT_SIZE))


def _with_states(
    placed: AgentTracks,
    states: Float[np.ndarray, "N 5"],
    activity: Int[np.ndarray, "N"],
    center_m: Float[np.ndarray, "2"],
    step: int,
) -> AgentTracks:
    steps = placed.num_steps
    now = np.arange(steps) == step
    # Rounding errors of a batch would grow from round to round; so they mostly vanish.
    place = np.round(states[:, :2], _PLACE_DIGITS) + center_m
    heading = np.round(np.arctan2(states[:, 3], states[:, 2]), _HEADING_DIGITS)
    speed = np.round(states[:, 4:], _SPEED_DIGITS)

    def at_step(values: np.ndarray) -> np.ndarray:
        table = np.zeros((len(placed), steps, *values.shape[1:]), values.dtype)
        table[:, step] = values
        return table

    return replace(
        placed,
        position_m=at_step(place),
        heading_rad=at_step(heading),
        velocity_mps=at_step(unit_vector(heading) * speed),
        is_valid=np.broadcast_to(now, (len(placed), steps)).copy(),
        observed=placed.observed & now,
        activity=activity.astype(placed.activity.dtype),
    )
