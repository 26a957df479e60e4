"""How what another loader reads in a written scene differs from the scene."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from jaxtyping import Float
from numpy.typing import ArrayLike

from pd_editor.scene.scenario import Scenario


class Worst(dict[str, float]):
    """Largest differences by what differs."""

    def note(self, name: str, gaps: ArrayLike) -> float:
        """The largest of these differences, which is kept."""
        most = float(np.max(np.abs(gaps), initial=0.0))
        self[name] = max(self.get(name, 0.0), most)
        return most

    def turns(self, gaps_rad: ArrayLike) -> float:
        """The same of headings, in degrees."""
        turn = np.angle(np.exp(1j * np.asarray(gaps_rad)))
        return self.note("heading_deg", np.degrees(turn))


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """Largest differences, over all states and lanes that the loader has."""

    position_m: float
    heading_deg: float
    speed_mps: float
    size_m: float
    center_m: float
    """Distance of a centre line's points from the other's line."""
    aside_m: float
    """The same, but for where the lanes end."""
    num_states: int
    lanes_agree: bool
    """Whether there are the same lanes with the same successors."""


def aside_m(
    points: Float[np.ndarray, "N 2"], line: Float[np.ndarray, "M 2"]
) -> Float[np.ndarray, "N"]:
    """Distances of points from a line that goes straight on for 0.5 m at its ends.

    Lanes of warped roads end at a bend, those that are read again at the straight line
    between the ends of their bounds.
    """
    steps = line[[0, -1]] - line[[1, -2]]
    ends = line[[0, -1]] + 0.5 * steps / np.linalg.norm(steps, axis=1, keepdims=True)
    longer = shapely.LineString([ends[0], *line, ends[1]])
    return np.asarray(shapely.distance(shapely.points(points), longer))


def agreement(
    scenario: Scenario,
    read: Mapping[str, Any],
    agent_of: Mapping[str, str],
    lane_of: Mapping[str, int],
) -> Agreement:
    """Compare with what a script of ``tests/oracles`` has read.

    ``agent_of`` and ``lane_of`` tell whose track and which lane an id of the file is.
    Files hold coordinates of the city and count steps from the first one.
    """
    agents, origin = scenario.agents, scenario.origin_city_m
    gaps: list[np.ndarray] = []
    sizes: list[float] = []
    for key, track in read["tracks"].items():
        row = agents.row_of[agent_of[key]]
        step, *others = np.array(track["states"]).T
        x, y, heading, speed = others
        step = step.astype(int)
        assert agents.is_valid[row, step].all(), f"{key} is not there at these steps"
        place = agents.position_m[row, step] + origin
        turn = np.angle(np.exp(1j * (agents.heading_rad[row, step] - heading)))
        off = np.hypot(place[:, 0] - x, place[:, 1] - y)
        # Who goes backwards has a negative speed in some formats.
        slip = agents.speed_mps()[row, step] - np.abs(speed)
        gaps.append(np.abs([off, np.degrees(turn), slip]))
        asked = np.array([track["length_m"], track["width_m"]])
        sizes.append(float(np.abs(agents.size_m[row] - asked).max()))
    worst = np.concatenate(gaps, axis=1)
    centers: list[tuple[float, float]] = []
    successors: dict[int, set[int]] = {}
    own = scenario.road_map.lane_of
    for key, lane in read["lanes"].items():
        if key in lane_of:
            line = own[lane_of[key]].centerline_m + origin
            points = np.array(lane["center_m"])[:, :2]
            gaps_m = shapely.distance(shapely.LineString(line), shapely.points(points))
            centers.append((float(gaps_m.max()), float(aside_m(points, line).max())))
            after = [str(one) for one in lane["successors"]]
            successors[lane_of[key]] = {lane_of[one] for one in after if one in lane_of}
    expected = {n: set(own[n].successors).intersection(own) for n in own}
    position, heading, speed = worst.max(axis=1).tolist()
    return Agreement(
        position_m=position,
        heading_deg=heading,
        speed_mps=speed,
        size_m=max(sizes),
        center_m=max(one for one, _ in centers),
        aside_m=max(one for _, one in centers),
        num_states=worst.shape[1],
        lanes_agree=successors == expected,
    )
