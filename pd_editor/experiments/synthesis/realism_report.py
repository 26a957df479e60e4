"""Report of the distances between synthetic and real scenes, with their noise floor."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float

from pd_editor.analysis.metrics.box_overlaps import local_density, nearest_distance
from pd_editor.analysis.metrics.distribution_distance import (
    Histogram,
    histogram_of,
    noise_floor,
)
from pd_editor.analysis.metrics.lanes import nearest_edge
from pd_editor.analysis.metrics.motion import Kinematics, kinematics, motion_values
from pd_editor.analysis.metrics.traffic_view import TrafficView, recorded_traffic
from pd_editor.analysis.metrics.values import METRICS, MaskedValues
from pd_editor.base.errors import InputError
from pd_editor.experiments.recordings.clip import TrackingNoise
from pd_editor.experiments.recordings.shards import SHARD_SUFFIX, ShardReader
from pd_editor.experiments.report import NONE, Report, ReportTable, Section
from pd_editor.scene.agent_kind import AgentGroup, AgentKind
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.formats.dataset import DatasetIndex, no_scenario
from pd_editor.scene.formats.registry import is_foreign_scene
from pd_editor.scene.geometry.angles import heading_of, wrap_angle
from pd_editor.scene.geometry.polyline import arc_length
from pd_editor.scene.paths.lanes.nearest_lane import LaneMatch, nearest_lanes
from pd_editor.scene.road_map import Lane
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import MOVING_MPS

MAX_SCENES: Final = 300
"""Limit of scenes; more improve the statistics little and take a second per twenty."""


def scenario_folders(roots: Sequence[Path]) -> list[Path]:
    """Folders of Argoverse 2 scenarios below the roots, in the order of names, without duplicates.

    Raises:
        InputError: a root is no folder, or there is no scenario.
    """
    found: dict[str, Path] = {}
    for root in roots:
        for card in DatasetIndex(root).filter():
            if not is_foreign_scene(card.folder):
                found.setdefault(card.folder.name, card.folder)
    if not found:
        raise no_scenario(roots)
    return [found[name] for name in sorted(found)]


def dataset_scenes(folder: Path) -> Iterator[Scenario]:
    """Yield at most ``MAX_SCENES`` scenes of a synthetic dataset, evenly distributed.

    Scenes of shards get a tracker's noise, as real ones have.

    Raises:
        InputError: there is no scene, or one is damaged.
    """
    if any(folder.glob(f"*{SHARD_SUFFIX}")):
        reader = ShardReader(folder)
        for index in _spread(len(reader)):
            yield reader.window(index, noise=TrackingNoise())
    else:
        folders = scenario_folders((folder,))
        for index in _spread(len(folders)):
            yield read_scenario(folders[index])


def real_scenes(root: Path) -> Iterator[Scenario]:
    """Yield at most ``MAX_SCENES`` scenes of a dataset with a future, evenly distributed.

    Raises:
        InputError: there is no scene, or one is damaged.
    """
    folders = scenario_folders((root,))
    for index in _spread(len(folders)):
        scenario = read_scenario(folders[index])
        if scenario.agents.is_valid[:, scenario.current_step + 1 :].any():
            yield scenario


def _spread(count: int) -> list[int]:
    """At most ``MAX_SCENES`` evenly spaced indices below ``count``."""
    num = min(count, MAX_SCENES)
    return np.linspace(0, count - 1, num).round().astype(int).tolist()


_COMPARED_STEPS: Final = slice(10, 46, 5)
"""Steps whose accelerations are compared. Fits are one-sided at the first steps, and
tracks of Argoverse 2 decelerate to rest in their last second."""
_KINDS: Final = tuple(AgentKind)


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredScene:
    """A scene with cached intermediate values of several quantities."""

    scenario: Scenario

    @cached_property
    def everyone(self) -> TrafficView:
        """View of all road users at the current step."""
        return recorded_traffic(self.scenario)

    @cached_property
    def motor_vehicles(self) -> TrafficView:
        """View of the motor vehicles, with the other road users as context."""
        view = self.everyone
        rows = np.flatnonzero(view.agents.is_in("movers"))
        names = [view.agents.ids[row] for row in rows]
        return recorded_traffic(self.scenario, names)

    @cached_property
    def moves(self) -> Bool[np.ndarray, "A"]:
        """Which motor vehicles move at the current step."""
        velocity = self.motor_vehicles.agents.velocity_mps[:, 0]
        return np.hypot(velocity[:, 0], velocity[:, 1]) > MOVING_MPS

    @cached_property
    def motion(self) -> Kinematics:
        """Derivatives of the motor vehicles' paths."""
        return kinematics(self.motor_vehicles)

    @cached_property
    def lanes(self) -> LaneMatch:
        """Lane nearest to each motor vehicle at the current step."""
        agents = self.motor_vehicles.agents
        return nearest_lanes(
            self.scenario.road_map,
            agents.position_m[:, 0],
            heading_rad=agents.heading_rad[:, 0],
        )


_Measure = Callable[[MeasuredScene], MaskedValues]


@dataclass(frozen=True, kw_only=True, eq=False)
class Quantity:
    """Something measured, and the bins of its histogram."""

    name: str
    unit: str
    """Unit; "share" for quantities that are 0 or 1."""
    bins: Histogram
    measure: _Measure

    def distance(
        self, one: Float[np.ndarray, "N"], other: Float[np.ndarray, "M"]
    ) -> float:
        """Jensen-Shannon distance of two non-empty sets."""
        return self.bins.distance(one, other).root


def _quantities() -> tuple[Quantity, ...]:
    quantities: list[Quantity] = []

    def add(
        name: str, unit: str, low: float, high: float, num: int, measure: _Measure
    ) -> None:
        bins = Histogram(metric=name, source="ours", low=low, high=high, num_bins=num)
        quantities.append(Quantity(name=name, unit=unit, bins=bins, measure=measure))

    def as_in_tables(name: str, metric: str, measure: _Measure) -> None:
        bins, unit = histogram_of(metric, "ours"), METRICS[metric].unit
        quantities.append(Quantity(name=name, unit=unit, bins=bins, measure=measure))

    as_in_tables("speed", "speed", lambda s: _motion(s, "speed"))
    as_in_tables("speed of the moving", "speed", _speed_of_moving)
    add("standing", "share", 0, 1, 2, lambda s: _motion(s, "standing"))
    add("standing that start", "share", 0, 1, 2, _starts)
    as_in_tables(
        "nearest agent",
        "nearest_distance",
        lambda s: nearest_distance(s.motor_vehicles),
    )
    as_in_tables(
        "local density", "local_density", lambda s: local_density(s.motor_vehicles)
    )
    as_in_tables("lateral deviation", "nearest_edge", lambda s: _edge(s, 0))
    as_in_tables("angular deviation", "nearest_edge_angle", lambda s: _edge(s, 1))
    add("offset from lane, moving", "m", 0, 4, 20, lambda s: _offset(s, moving=True))
    add(
        "offset from lane, standing", "m", 0, 12, 24, lambda s: _offset(s, moving=False)
    )
    add("angle to lane, moving", "deg", 0, 30, 30, lambda s: _angle(s, moving=True))
    add("angle to lane, standing", "deg", 0, 90, 30, lambda s: _angle(s, moving=False))
    as_in_tables("path in 6 s", "path_length", lambda s: _motion(s, "path_length"))
    as_in_tables(
        "longitudinal acceleration",
        "longitudinal_acceleration",
        lambda s: _while_moving(s, s.motion.longitudinal_mps2),
    )
    as_in_tables(
        "lateral acceleration",
        "lateral_acceleration",
        lambda s: _while_moving(s, s.motion.lateral_mps2),
    )
    add("heading change in 6 s", "deg", -120, 120, 40, _heading_change)
    add("turning", "share", 0, 1, 2, _turning)
    add("agents in a scene", "", 0, 120, 24, lambda s: _count(s, None))
    add("movers in a scene", "", 0, 80, 20, lambda s: _count(s, "movers"))
    add("pedestrians in a scene", "", 0, 40, 20, lambda s: _count(s, "pedestrians"))
    add("kind", "", 0, len(_KINDS), len(_KINDS), _kind)
    add("lanes in a scene", "", 0, 160, 20, lambda s: _rows(np.array([len(_lanes(s))])))
    add("length of lanes", "m", 0, 120, 30, _lane_length)
    add("curvature of lanes", "1/m", 0, 0.2, 40, _lane_curvature)
    add("lanes in junctions", "share", 0, 1, 2, _lane_in_junction)
    return tuple(quantities)


def _rows(value: np.ndarray, is_valid: np.ndarray | None = None) -> MaskedValues:
    valid = np.ones(value.shape, bool) if is_valid is None else is_valid
    return MaskedValues(value=np.asarray(value, float), is_valid=valid)


def _motion(scene: MeasuredScene, name: str) -> MaskedValues:
    return motion_values(scene.motor_vehicles)[name]


def _speed_of_moving(scene: MeasuredScene) -> MaskedValues:
    return _rows(_motion(scene, "speed").value, scene.moves)


def _starts(scene: MeasuredScene) -> MaskedValues:
    """Whether agents that stand at the current step have started by the last step."""
    agents, stands = scene.motor_vehicles.agents, _motion(scene, "standing").value > 0
    away = np.linalg.norm(agents.position_m[:, -1] - agents.position_m[:, 0], axis=-1)
    # Least displacement of a start; tracks of parked vehicles drift by up to this.
    return _rows(away > 2.0, stands & agents.is_valid.all(axis=1))


def _edge(scene: MeasuredScene, which: int) -> MaskedValues:
    return nearest_edge(scene.motor_vehicles)[which]


def _offset(scene: MeasuredScene, *, moving: bool) -> MaskedValues:
    return _rows(scene.lanes.distance_m, scene.lanes.is_valid & (scene.moves == moving))


def _angle(scene: MeasuredScene, *, moving: bool) -> MaskedValues:
    heading = scene.motor_vehicles.agents.heading_rad[:, 0]
    angle = np.abs(np.degrees(wrap_angle(heading - scene.lanes.heading_rad)))
    return _rows(angle, scene.lanes.is_valid & (scene.moves == moving))


def _while_moving(scene: MeasuredScene, value: np.ndarray) -> MaskedValues:
    motion = scene.motion
    valid = motion.is_valid & (motion.speed_mps > MOVING_MPS)
    return _rows(value[:, _COMPARED_STEPS], valid[:, _COMPARED_STEPS])


def _heading_change(scene: MeasuredScene) -> MaskedValues:
    """Accumulated change of heading of agents with a long enough path, in degrees."""
    agents = scene.motor_vehicles.agents
    both = agents.is_valid[:, 1:] & agents.is_valid[:, :-1]
    turn = wrap_angle(np.diff(agents.heading_rad, axis=1))
    total = np.degrees(np.where(both, turn, 0.0).sum(axis=1))
    # Least length of paths whose turns are measured.
    far = _motion(scene, "path_length").value > 5.0
    return _rows(total, far & agents.is_valid.all(axis=1))


def _turning(scene: MeasuredScene) -> MaskedValues:
    change = _heading_change(scene)
    # Change of heading in the window beyond which an agent turns.
    return _rows(np.abs(change.value) > 30.0, change.is_valid)


def _count(scene: MeasuredScene, group: AgentGroup | None) -> MaskedValues:
    agents = scene.everyone.agents
    if group is None:
        return _rows(np.array([len(agents)]))
    return _rows(np.array([agents.is_in(group).sum()]))


def _kind(scene: MeasuredScene) -> MaskedValues:
    kinds = scene.everyone.agents.kinds
    return _rows(np.array([_KINDS.index(kind) + 0.5 for kind in kinds], float))


def _lanes(scene: MeasuredScene) -> tuple[Lane, ...]:
    return scene.scenario.road_map.lanes


def _lane_length(scene: MeasuredScene) -> MaskedValues:
    length = [arc_length(lane.centerline_m)[-1] for lane in _lanes(scene)]
    return _rows(np.array(length, float))


def _lane_curvature(scene: MeasuredScene) -> MaskedValues:
    """Change of direction from a lane's start to its end, divided by its length."""
    found = []
    for lane in _lanes(scene):
        steps = np.diff(lane.centerline_m, axis=0)
        turn = wrap_angle(np.diff(heading_of(steps))).sum()
        found.append(abs(turn) / max(arc_length(lane.centerline_m)[-1], 1.0))
    return _rows(np.array(found, float))


def _lane_in_junction(scene: MeasuredScene) -> MaskedValues:
    return _rows(np.array([lane.is_intersection for lane in _lanes(scene)], float))


QUANTITIES: Final[tuple[Quantity, ...]] = _quantities()
"""All compared quantities; of motor vehicles unless their names say otherwise."""


ALLOWED_RATIO: Final = 1.3
"""Largest accepted ratio of a distance to its noise floor."""
QUANTILES: Final = (10, 50, 90)

_Measured = dict[str, list[MaskedValues]]


@dataclass(frozen=True, kw_only=True)
class RealismRow:
    """Comparison of one quantity."""

    name: str
    unit: str
    distance: float
    """Jensen-Shannon distance (natural logarithm) to the real scenes."""
    noise_floor: float
    """Distance between the real scenes and as many agents resampled from them."""
    other_real: float | None
    """Distance between the real scenes and other real scenes; None without any."""
    synthetic: tuple[float, ...]
    """Quantiles at ``QUANTILES``; for a share only its mean."""
    real: tuple[float, ...]

    @property
    def ratio(self) -> float:
        """Ratio of the distance to its noise floor."""
        return self.distance / max(self.noise_floor, 1e-9)

    @property
    def passes(self) -> bool:
        """Whether the ratio is at most ``ALLOWED_RATIO``."""
        return self.ratio <= ALLOWED_RATIO


@dataclass(frozen=True, kw_only=True)
class RealismReport:
    """Comparison of all quantities."""

    rows: tuple[RealismRow, ...]
    num_synthetic: int
    num_real: int
    num_other: int

    def json(self) -> dict[str, Any]:
        """Report as JSON values."""
        return {
            "num_synthetic": self.num_synthetic,
            "num_real": self.num_real,
            "num_other": self.num_other,
            "allowed_ratio": ALLOWED_RATIO,
            "rows": [
                asdict(row) | {"ratio": row.ratio, "passes": row.passes}
                for row in self.rows
            ],
        }

    def _chance(self) -> str:
        if not self.num_other:
            return "."
        chance = np.sqrt(1 + self.num_real / self.num_other)
        return f", which is {chance:.1f} for the other real scenes."

    def report(self) -> Report:
        """Report as text and a table."""
        num_passed = sum(row.passes for row in self.rows)
        scenes = f"{self.num_synthetic} synthetic scenes, {self.num_real} real ones"
        others = f", {self.num_other} other real ones." if self.num_other else "."
        words = (
            scenes + others,
            "Distances are square roots of Jensen-Shannon divergences (natural "
            "logarithm) to the real scenes. The noise floor is that distance for as "
            "many agents of resampled real scenes, mean over resamples. A perfect "
            "generator's ratio tends to 1 as its scenes become many; of n scenes "
            "beside m real ones, chance alone makes it about sqrt(1 + m / n)"
            + self._chance(),
            f"{num_passed} of {len(self.rows)} distances are at most "
            f"{ALLOWED_RATIO:g} times the noise floor.",
        )
        rows = tuple(map(_cells, self.rows))
        table = ReportTable(title="By quantity", header=_header(), rows=rows)
        section = Section(title="Distances", paragraphs=words, tables=(table,))
        return Report(
            title="Synthetic traffic beside real traffic", sections=(section,)
        )


def realism_report(
    synthetic: Iterable[Scenario],
    real: Iterable[Scenario],
    other_real: Iterable[Scenario] = (),
) -> RealismReport:
    """Compare scenes with real ones of equal format and extent, quantity by quantity.

    The distance of ``other_real`` scenes is a reference.

    Raises:
        InputError: there are no synthetic or no real scenes.
    """
    mine, num_mine = _measured(synthetic)
    theirs, num_theirs = _measured(real)
    others, num_others = _measured(other_real)
    for number, side in ((num_mine, "synthetic"), (num_theirs, "real")):
        if not number:
            raise InputError(f"There are no {side} scenes to compare; expected some.")
    rows = [
        _row(
            quantity, mine[quantity.name], theirs[quantity.name], others[quantity.name]
        )
        for quantity in QUANTITIES
        if _num_rows(mine[quantity.name]) and _num_rows(theirs[quantity.name])
    ]
    return RealismReport(
        rows=tuple(rows), num_synthetic=num_mine, num_real=num_theirs, num_other=num_others
    )  # fmt: skip


def _measured(scenarios: Iterable[Scenario]) -> tuple[_Measured, int]:
    found: _Measured = {quantity.name: [] for quantity in QUANTITIES}
    count = 0
    for scenario in scenarios:
        scene = MeasuredScene(scenario=scenario)
        count += 1
        for quantity in QUANTITIES:
            found[quantity.name].append(quantity.measure(scene))
    return found, count


def _num_rows(scenes: Sequence[MaskedValues]) -> int:
    """Number of agents, lanes or scenes with a value."""
    return sum(int(scene.has_value().sum()) for scene in scenes if len(scene))


def _row(
    quantity: Quantity,
    synthetic: Sequence[MaskedValues],
    real: Sequence[MaskedValues],
    other_real: Sequence[MaskedValues],
) -> RealismRow:
    pool, num_rows = _pooled(real), _num_rows(real)

    def distance(scenes: Sequence[MaskedValues]) -> float:
        return quantity.distance(_pooled(scenes), pool)

    return RealismRow(
        name=quantity.name,
        unit=quantity.unit,
        distance=distance(synthetic),
        noise_floor=noise_floor(real, quantity.distance, num_agents=num_rows),
        other_real=distance(other_real) if _num_rows(other_real) else None,
        synthetic=_summary(quantity, _pooled(synthetic)),
        real=_summary(quantity, pool),
    )


def _pooled(scenes: Sequence[MaskedValues]) -> np.ndarray:
    return np.concatenate([np.zeros(0), *(scene.valid() for scene in scenes)])


def _summary(quantity: Quantity, values: np.ndarray) -> tuple[float, ...]:
    if quantity.unit == "share":
        return (float(values.mean()),)
    return tuple(float(value) for value in np.percentile(values, QUANTILES))


def _header() -> tuple[str, ...]:
    names = "/".join(map(str, QUANTILES)) + " %"
    fixed = ("quantity", "unit", "distance", "floor", "ratio", "other real", "")
    return (*fixed, f"synthetic {names}", f"real {names}")


def _cells(row: RealismRow) -> tuple[str, ...]:
    other = NONE
    if row.other_real is not None:
        other = f"{row.other_real / max(row.noise_floor, 1e-9):.2f}"
    return (
        row.name,
        row.unit or "-",
        f"{row.distance:.3f}",
        f"{row.noise_floor:.3f}",
        f"{row.ratio:.2f}",
        other,
        "pass" if row.passes else "above",
        " / ".join(f"{value:.3g}" for value in row.synthetic),
        " / ".join(f"{value:.3g}" for value in row.real),
    )
