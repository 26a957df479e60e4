"""A Gymnasium environment: one agent drives among traffic that answers (extra ``gym``)."""

from pathlib import Path
from typing import Any, Final, cast

import gymnasium
import numpy as np
import shapely
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from jaxtyping import Float

from pd_editor.analysis.metrics.box_overlaps import first_overlap
from pd_editor.base.errors import InputError
from pd_editor.cli.replay import open_base, read_recipe
from pd_editor.editor.recipe import replay
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.experiments.closed_loop.roll_out import Rolling, RollOutRequest
from pd_editor.generation.generators import SHIPPED_MODEL, make_generator
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.geometry.angles import wrap_angle
from pd_editor.scene.geometry.polyline import arc_length
from pd_editor.scene.policy import LEAST_PLAN_S, Controls, Observation
from pd_editor.scene.roles.focal_agent import driven_id
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.top_view import DPI, Frame, TopView, pixels

NUM_ROUTE_POINTS: Final = 20
NUM_OTHERS: Final = 16
Seen = dict[str, Float[np.ndarray, "..."]]


class _Held:
    """The policy that holds an action until the next one."""

    name = "gym"
    action = np.zeros(2)

    def reset(self, scene: Scenario, ego_id: str, route_m: Any, seed: int) -> None:
        """Nothing is remembered."""

    def plan(self, observation: Observation) -> Controls:
        """The action at each step until the next question."""
        held = np.tile(self.action, (round(LEAST_PLAN_S / observation.step_s), 1))
        return Controls(acceleration_mps2=held[:, 0], curvature_1pm=held[:, 1])


class DriveEnv(gymnasium.Env[Seen, np.ndarray]):
    """Accelerate and steer one agent; each step is half a second of the roll-out.

    An action is an acceleration (m/s2) and a curvature (1/m, positive to the left). What
    is seen is in the agent's frame: ``ego`` speed (m/s); ``route`` points x, y (m), 2.5 m
    apart; ``others``, the nearest first, x, y, heading, speed, length, width, and 1 where
    there is one. The reward is the progress along the route (m), less 10 for a collision,
    which ends the episode, as does driving past the end of the mapped road.
    """

    metadata = {  # noqa: RUF012  (Gymnasium has it so)
        "render_modes": ["rgb_array"],
        "render_fps": round(1 / LEAST_PLAN_S),
    }

    def __init__(
        self,
        scene: str | Path = "signalised-junction",
        *,
        recipe: str | Path = "",
        ego: str = "",
        model: str = SHIPPED_MODEL,
        duration_s: float = 20.0,
        render_mode: str | None = None,
    ) -> None:
        """Set what is driven; ``reset`` opens it.

        Args:
            scene: what ``open_scenario`` takes.
            recipe: file or folder of a recipe, in place of a scene.
            ego: id of the agent that is driven; the ego, or the focal agent where there is
                none, unless given.
            model: what generates the traffic.
            duration_s: length of an episode.
            render_mode: "rgb_array" or None.
        """
        self._options = {"scene": scene, "recipe": recipe}
        self._asked, self._model, self._duration_s = ego, model, duration_s
        self.render_mode = render_mode
        limits = np.array([[-6.0, -0.2], [3.0, 0.2]], np.float32)
        self.action_space = spaces.Box(limits[0], limits[1])
        seen: dict[str, spaces.Space[Any]] = {
            "ego": spaces.Box(0.0, np.inf, (1,)),
            "route": spaces.Box(-np.inf, np.inf, (NUM_ROUTE_POINTS, 2)),
            "others": spaces.Box(-np.inf, np.inf, (NUM_OTHERS, 7)),
        }
        self.observation_space = cast("spaces.Space[Seen]", spaces.Dict(seen))
        self._held = _Held()
        self._is_over = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Seen, dict]:
        """Begin an episode; ``options`` may name another ``scene`` or ``recipe``.

        Raises:
            PdEditorError: the scene cannot be opened or driven.
        """
        super().reset(seed=seed, options=options)
        asked = {"scene": "", "recipe": "", **options} if options else self._options
        if unknown := asked.keys() - self._options.keys():
            raise InputError(
                f"There is no option {min(map(str, unknown))!r} of reset; expected scene "
                "or recipe."
            )
        scenario = _opened(**asked)
        self._ego = self._asked or driven_id(scenario)
        request = RollOutRequest(
            scenario=scenario,
            duration_s=self._duration_s,
            policies={self._ego: self._held},
            answer_s=None,
            seed=int(self.np_random.integers(2**31)),
        )
        self._rolling = Rolling.started(request, make_generator(self._model))
        self._options, self._is_over = asked, False
        self._known = self._rolling.observation(self._ego)
        return _seen(self._known), {}

    def step(self, action: np.ndarray) -> tuple[Seen, float, bool, bool, dict]:
        """Drive on for half a second; ``info`` says why an episode has ended.

        Raises:
            ResetNeeded: no episode has begun, or the last one is over.
        """
        if self._is_over:
            raise ResetNeeded("There is no episode to drive on in; call reset first.")
        space = cast("spaces.Box", self.action_space)
        self._held.action = np.clip(np.asarray(action, float), space.low, space.high)
        before, first = _progress_m(self._known), self._rolling.world.step
        list(self._rolling.next_steps())
        world, ended = self._rolling.world, self._rolling.drivers.ended
        agents = world.scenario.agents
        users = np.flatnonzero(agents.kind_mask(ROAD_USER_KINDS))
        steps = np.arange(first + 1, world.step + 1)
        pairs, _ = first_overlap(agents.taken(users), steps)
        own = np.flatnonzero(users == agents.row_of[self._ego])
        has_hit = bool(np.isin(pairs, own).any())
        if not ended:
            self._known = self._rolling.observation(self._ego)
        reward = _progress_m(self._known) - before - 10.0 * has_hit
        why = ended.get(self._ego, "It collided." if has_hit else "")
        info = {"ended": why} if why else {}
        is_over = has_hit or bool(ended), self._rolling.is_over
        self._is_over = any(is_over)
        return _seen(self._known), reward, *is_over, info

    def render(self) -> np.ndarray | None:
        """Picture of 80 m around the agent, H x W x 3, if the mode is "rgb_array"."""
        if self.render_mode is None:
            return None
        world, known = self._rolling.world, self._known
        frame = Frame(middle_m=known.ego.position_m[0, -1], half_m=np.full(2, 40.0))
        view = TopView(world.scenario, 72 * 400 / 80 / DPI)
        artists = (
            *view.road(frame),
            view.line(known.route_m),
            *view.traffic(world.step, trail_s=0.0),
        )
        return pixels(artists, frame, (400, 400), view.palette.ground)[..., :3].copy()


def _opened(scene: str | Path, recipe: str | Path) -> Scenario:
    if not recipe:
        return open_scenario(scene)
    parsed, where = read_recipe(Path(recipe))
    return replay(parsed, open_base(parsed, where, scene or None))


def _progress_m(known: Observation) -> float:
    """How far along its route the agent is."""
    place = shapely.Point(known.ego.position_m[0, -1])
    return shapely.LineString(known.route_m).project(place)


def _seen(known: Observation) -> Seen:
    """What the agent sees, in its frame."""
    ego, others = known.ego, known.others
    place, heading = ego.position_m[0, -1], ego.heading_rad[0, -1]
    turn = np.array(
        [[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]
    )
    along = _progress_m(known) + 2.5 * np.arange(1, NUM_ROUTE_POINTS + 1)
    length = arc_length(known.route_m)
    route = np.stack(
        [np.interp(along, length, one) for one in known.route_m.T], axis=-1
    )
    found = (others.position_m[:, -1] - place) @ turn
    near = np.argsort(np.linalg.norm(found, axis=-1), kind="stable")[:NUM_OTHERS]
    table = np.zeros((NUM_OTHERS, 7), np.float32)
    table[: len(near), :2] = found[near]
    table[: len(near), 2] = wrap_angle(others.heading_rad[near, -1] - heading)
    table[: len(near), 3] = np.linalg.norm(others.velocity_mps[near, -1], axis=-1)
    table[: len(near), 4:6] = others.size_m[near]
    table[: len(near), 6] = 1.0
    speed = np.linalg.norm(ego.velocity_mps[:1, -1], axis=-1)
    return {
        "ego": speed.astype(np.float32),
        "route": ((route - place) @ turn).astype(np.float32),
        "others": table,
    }


gymnasium.register("pd_editor/Drive-v0", entry_point="pd_editor.gym:DriveEnv")
