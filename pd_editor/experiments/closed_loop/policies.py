"""Policies that ship, and those of one's own by name."""

import os
from collections.abc import Callable
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
from jaxtyping import Float

from pd_editor.base.errors import GenerationError
from pd_editor.base.foreign_code import asked, is_reference, object_of_reference
from pd_editor.base.plain_text import nearest_or_all
from pd_editor.generation.plugins import (
    checked_name,
    is_of,
    object_of_folder,
)
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.geometry.angles import heading_of, unit_vector
from pd_editor.scene.geometry.polyline import arc_length, point_at
from pd_editor.scene.paths.car_following import following_acceleration
from pd_editor.scene.policy import Controls, Observation, Plan, Policy
from pd_editor.scene.scenario import Scenario

ENTRY_POINTS: Final = "pd_editor.policies"
FOLDER_MODULE: Final = "policy.py"
_PLAN_S: Final = 3.0
_LOOKAHEAD_S: Final = 0.8
_LEAST_LOOKAHEAD_M: Final = 4.0
_SIDE_M: Final = 0.4
"""Room beside a box that the route must leave free."""
_SEEN_M: Final = 80.0
_LATERAL_MPS2: Final = 3.0


class LogReplay:
    """Drives as recorded; it ends where the recording does."""

    name = "log-replay"

    def reset(
        self, scene: Scenario, ego_id: str, route_m: Float[np.ndarray, "N 2"], seed: int
    ) -> None:
        """Take the recorded track."""
        del route_m, seed
        agents, now = scene.agents, scene.current_step
        row = agents.row_of[ego_id]
        there = agents.is_valid[row, now:]
        count = len(there) if there.all() else int(np.argmin(there))
        self._position_m = agents.position_m[row, now : now + count]
        self._heading_rad = agents.heading_rad[row, now : now + count]

    def plan(self, observation: Observation) -> Plan:
        """What is left of the track."""
        first = round(observation.time_s / observation.step_s) + 1
        return Plan(
            position_m=self._position_m[first:], heading_rad=self._heading_rad[first:]
        )


class ConstantVelocity:
    """Drives straight on at the speed that it has."""

    name = "constant-velocity"

    def reset(
        self, scene: Scenario, ego_id: str, route_m: Float[np.ndarray, "N 2"], seed: int
    ) -> None:
        """Nothing is remembered."""

    def plan(self, observation: Observation) -> Controls:
        """No acceleration, no curvature."""
        count = round(_PLAN_S / observation.step_s)
        return Controls(
            acceleration_mps2=np.zeros(count), curvature_1pm=np.zeros(count)
        )


class IdmOnRoute:
    """Follows the route at the speed of traffic, behind who is on it (IDM)."""

    name = "idm"

    def __init__(self, desired_mps: float = 13.0) -> None:
        self._desired_mps = desired_mps

    def reset(
        self, scene: Scenario, ego_id: str, route_m: Float[np.ndarray, "N 2"], seed: int
    ) -> None:
        """Nothing is remembered."""

    def plan(self, observation: Observation) -> Controls:
        """Acceleration by the car-following model, curvature by pure pursuit."""
        ego, route = observation.ego, observation.route_m
        position, heading = ego.position_m[0, -1], float(ego.heading_rad[0, -1])
        speed = float(np.hypot(*ego.velocity_mps[0, -1]))
        along = arc_length(route)
        here = float(along[np.linalg.norm(route - position, axis=-1).argmin()])
        gap, leader_mps = self._leader(observation, along, here)
        given = (np.array([one]) for one in (speed, gap, leader_mps))
        acceleration = float(following_acceleration(*given)[0])
        reach = max(speed * _LOOKAHEAD_S, _LEAST_LOOKAHEAD_M)
        aim = point_at(route, here + reach) - position
        aside = float(np.cos(heading) * aim[1] - np.sin(heading) * aim[0])
        curvature = 2 * aside / max(float(aim @ aim), 1.0)
        limit = min(self._desired_mps, self._curve_limit(route, here, speed))
        acceleration = min(acceleration, (limit - speed) / 1.0)
        count = round(_PLAN_S / observation.step_s)
        return Controls(
            acceleration_mps2=np.full(count, max(acceleration, -7.0)),
            curvature_1pm=np.full(count, curvature),
        )

    def _leader(
        self, observation: Observation, along: np.ndarray, here: float
    ) -> tuple[float, float]:
        """Gap to the nearest box on the route, and its speed along it."""
        others, route = observation.others, observation.route_m
        users = others.kind_mask(ROAD_USER_KINDS)
        if not users.any():
            return np.inf, 0.0
        position = others.position_m[users, -1]
        distance = np.linalg.norm(position[:, None] - route, axis=-1)
        at = distance.argmin(axis=1)
        way = unit_vector(_headings(route))[at]
        turn = others.heading_rad[users, -1] - _headings(route)[at]
        length, width = others.size_m[users].T / 2
        wide = np.abs(np.sin(turn)) * length + np.abs(np.cos(turn)) * width
        long = np.abs(np.cos(turn)) * length + np.abs(np.sin(turn)) * width
        own_length, own_width = observation.ego.size_m[0] / 2
        gap = along[at] - here - long - own_length
        offset = distance[np.arange(len(at)), at]
        leads = (along[at] > here) & (offset < wide + own_width + _SIDE_M)
        leads &= gap < _SEEN_M
        if not leads.any():
            return np.inf, 0.0
        nearest = int(np.where(leads, gap, np.inf).argmin())
        velocity = others.velocity_mps[users, -1][nearest]
        return float(gap[nearest]), float(velocity @ way[nearest])

    def _curve_limit(self, route: np.ndarray, here: float, speed: float) -> float:
        """Speed at which the curve ahead is comfortable."""
        ahead = here + np.linspace(0.0, max(2 * speed, 10.0), 9)
        heading = heading_of(np.diff(point_at(route, ahead), axis=0))
        turn = np.abs(np.diff(np.unwrap(heading)))
        bend = float((turn / np.diff(ahead)[0]).max())
        return float(np.sqrt(_LATERAL_MPS2 / max(bend, 1e-4)))


_SHIPPED: Final[dict[str, Callable[[], Policy]]] = {
    one.name: one for one in (LogReplay, ConstantVelocity, IdmOnRoute)
}


@lru_cache(maxsize=1)
def installed_policies() -> dict[str, EntryPoint]:
    """Entry points of installed packages, by name."""
    return {one.name: one for one in entry_points(group=ENTRY_POINTS)}


def policy_of(given: str | Policy | Callable[[], Policy]) -> Policy:
    """The policy of a name: a shipped or installed one, a folder, or a reference.

    An object is taken as it is, a class or function is called.

    A folder has ``policy.py``, which defines ``make_policy(folder)`` and is run as a
    module: name only folders that you trust.

    Raises:
        GenerationError: there is none, or it cannot be made.
    """
    name = given if isinstance(given, str) else type(given).__name__
    if not isinstance(given, str):
        found: Any = given
    elif name in _SHIPPED:
        return _SHIPPED[name]()
    elif name in installed_policies():
        found = asked(installed_policies()[name].load, name, ": cannot be loaded")
    elif os.path.isfile(Path(name) / FOLDER_MODULE):
        folder = Path(os.path.realpath(name))
        found = object_of_folder(folder, FOLDER_MODULE)
    elif is_reference(name):
        found = object_of_reference(name)
    else:
        known = [*_SHIPPED, *installed_policies()]
        raise GenerationError(
            f"There is no policy {name!r}; {nearest_or_all(name, known)} "
            "(a folder with policy.py and package.module:attribute are taken as well)."
        )
    if isinstance(found, type) or (callable(found) and not is_of(found, Policy, name)):
        found = asked(found, name, ": making the policy failed")
    if not is_of(found, Policy, name):
        raise GenerationError(
            f"{name}: is a {type(found).__name__}; expected an object with a name, "
            "reset(scene, ego_id, route_m, seed) and plan(observation)."
        )
    policy = cast("Policy", found)
    asked(lambda: checked_name(policy.name), name, " has no usable name")
    return policy


def _headings(line: np.ndarray) -> np.ndarray:
    """Heading at each point of a line, towards the next one."""
    step = np.diff(line, axis=0, append=2 * line[-1:] - line[-2:-1])
    return np.arctan2(step[:, 1], step[:, 0])
