"""The paper's figures, drawn from samples of our own systems on one scene."""

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pd_editor.base.errors import PdEditorError
from pd_editor.experiments.evaluation.evaluation_task import (
    EvaluationTask,
    RoadCondition,
)
from pd_editor.experiments.evaluation.method import (
    GROUND_TRUTH,
    REFERENCE_METHODS,
    Method,
)
from pd_editor.generation.features.scene_features import scene_center
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.generation import (
    GenerationRequest,
    Region,
    ScenarioGenerator,
    TrafficSample,
    run_to_end,
)
from pd_editor.scene.paths.motion_primitives import candidates
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario
from reproduction.systems import STATES, TRAJECTORIES, Trained, in_table_order, label_of
from reproduction.top_view import (
    COLORS,
    draw_paths,
    draw_road,
    draw_states,
    draw_trajectories,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

_HALF_SIDE_M: Final = 65.0
_SIDE_INCHES: Final = 3.0
_DPI: Final = 110
_COUNTS: Final = (4, 10, 20)
"""Numbers of agents on one map."""
_NUM_SAMPLES: Final = 3
_BENT: Final = (
    RoadCondition(terms=(("smooth-turn", 6.0),)),
    RoadCondition(terms=(("double-turn", 6.0),)),
    RoadCondition(terms=(("ripple-road", 6.0),)),
)
_SEED: Final = 1


@dataclass(frozen=True, kw_only=True)
class PaperPicture:
    """A figure in two formats, with its caption."""

    name: str
    caption: str
    png: bytes
    pdf: bytes


@dataclass(frozen=True, kw_only=True, eq=False)
class PictureBook:
    """Draws the figures of one scene with some trained systems."""

    scenario: Scenario
    trained: Sequence[Trained]
    make_generator: Callable[[str], ScenarioGenerator]

    def pictures(self) -> Iterator[PaperPicture]:
        """All figures that the systems allow."""
        for name, draw in (
            ("initial-states", self._states),
            ("candidates", self._candidates),
            ("trajectories", self._trajectories),
            ("diversity", self._diversity),
            ("warped", self._warped),
        ):
            try:
                picture = draw(name)
            except PdEditorError as error:
                picture = _note(name, str(error))
            if picture is not None:
                yield picture

    def _models(self, stage: str) -> Mapping[str, Trained]:
        """The first training of each system with an own stage, in table order."""
        own = [one for one in self.trained if stage in one.stages]
        first = {one.system: one for one in reversed(own)}
        return {name: first[name] for name in in_table_order(first)}

    def _sampled(
        self, one: Trained, request: GenerationRequest, *, raw: bool
    ) -> Sequence[TrafficSample]:
        method = Method(
            name=one.method + (":raw=1" if raw else ""),
            make_generator=self.make_generator,
        )
        generator = self.make_generator(one.method)
        asked = method.with_options(request)
        return run_to_end(generator.generate(asked)).samples

    def _states(self, name: str) -> PaperPicture | None:
        models = self._models(STATES)
        if not models:
            return None
        request = EvaluationTask(states="sampled").request(
            self.scenario, self.scenario, num_samples=1, seed=_SEED
        )
        drawing, axes = _panels(1, 1 + len(models))
        self._panel(axes[0], label_of(GROUND_TRUTH))
        rows = replace(request, resampled_state_ids=(), region=None)
        draw_states(axes[0], _logged(rows), COLORS[0])
        for axis, (system, one) in zip(axes[1:], models.items(), strict=True):
            self._panel(axis, label_of(system))
            draw_states(axis, self._sampled(one, request, raw=True)[0], COLORS[0])
        return _saved(
            drawing,
            name,
            "Initial states of as many agents of each kind as the log has in the square: "
            "raw samples, without guidance and repair.",
        )

    def _candidates(self, name: str) -> PaperPicture | None:
        ids = drivable_agent_ids(self.scenario)
        rows = self.scenario.agents.rows(ids)
        found = candidates(self.scenario, rows)
        count = found.is_valid.sum(axis=1)
        speed = self.scenario.agents.speed_mps()[rows, self.scenario.current_step]
        chosen = int(np.lexsort((speed, count))[-1])
        paths = found.position_m[chosen][found.is_valid[chosen]]
        drawing, axes = _panels(1, 1, side=5.0)
        middle = paths.reshape(-1, 2).mean(axis=0)
        draw_road(axes[0], self.scenario.road_map, middle, _HALF_SIDE_M)
        draw_paths(axes[0], list(paths))
        axes[0].plot(*paths[0, 0], "o", color="#333333", markersize=4)
        return _saved(
            drawing, name, f"The {len(paths)} Frenet candidates of one agent."
        )

    def _trajectories(self, name: str) -> PaperPicture | None:
        models = self._models(TRAJECTORIES)
        if not models:
            return None
        request = EvaluationTask().request(
            self.scenario, self.scenario, num_samples=1, seed=_SEED
        )
        drawing, axes = _panels(1, 1 + len(models))
        self._panel(axes[0], label_of(GROUND_TRUTH))
        draw_states(axes[0], _logged(request))
        draw_trajectories(axes[0], _logged(request))
        for axis, (system, one) in zip(axes[1:], models.items(), strict=True):
            self._panel(axis, label_of(system))
            sample = self._sampled(one, request, raw=True)[0]
            draw_states(axis, sample)
            draw_trajectories(axis, sample)
        return _saved(
            drawing,
            name,
            "Trajectories of 6 s from the recorded initial states: raw samples, without "
            "guidance and yielding.",
        )

    def _diversity(self, name: str) -> PaperPicture | None:
        models = self._models(STATES)
        one = models.get("pd") or next(iter(models.values()), None)
        if one is None:
            return None
        drawing, axes = _panels(3, max(len(_COUNTS), _NUM_SAMPLES))
        bare = self.scenario.without_agents(self.scenario.agents.ids)
        x, y = scene_center(self.scenario).tolist()
        for axis, count in zip(axes[: len(_COUNTS)], _COUNTS, strict=True):
            request = GenerationRequest(
                scenario=bare,
                agent_ids=(),
                num_new_agents={AgentKind.VEHICLE: count},
                region=Region(center_m=(x, y), half_side_m=_HALF_SIDE_M - 5),
                seed=_SEED,
            )
            self._panel(axis, f"(a) {count} agents")
            draw_states(axis, self._sampled(one, request, raw=False)[0], COLORS[0])
        request = EvaluationTask().request(
            self.scenario, self.scenario, num_samples=_NUM_SAMPLES, seed=_SEED
        )
        width = max(len(_COUNTS), _NUM_SAMPLES)
        for index, sample in enumerate(self._sampled(one, request, raw=False)):
            axis = axes[width + index]
            self._panel(axis, f"(b) trajectories, sample {index + 1}")
            draw_states(axis, sample)
            draw_trajectories(axis, sample)
        request = EvaluationTask(states="sampled").request(
            self.scenario, self.scenario, num_samples=_NUM_SAMPLES, seed=_SEED
        )
        for index, sample in enumerate(self._sampled(one, request, raw=False)):
            axis = axes[2 * width + index]
            self._panel(axis, f"(c) end to end, sample {index + 1}")
            draw_states(axis, sample)
            draw_trajectories(axis, sample)
        return _saved(
            drawing,
            name,
            f"{label_of(one.system)} on one map: (a) initial states of several numbers of "
            "agents, (b) trajectories from the recorded states, (c) both stages.",
        )

    def _warped(self, name: str) -> PaperPicture | None:
        models = self._models(TRAJECTORIES)
        chosen = [one for one in ("vd", "pd_minus_p", "pd") if one in models]
        chosen = chosen or list(models)[:3]
        if not chosen:
            return None
        drawing, axes = _panels(len(_BENT), 1 + 2 * len(chosen))
        width = 1 + 2 * len(chosen)
        for row, condition in enumerate(_BENT):
            scenario = condition.applied_to(self.scenario)
            request = EvaluationTask().request(
                self.scenario, scenario, num_samples=1, seed=_SEED
            )
            own = axes[row * width : (row + 1) * width]
            self._panel(
                own[0], f"{label_of(GROUND_TRUTH)}, {condition.label}", scenario
            )
            draw_states(own[0], _logged(request))
            draw_trajectories(own[0], _logged(request))
            for index, system in enumerate(chosen):
                for raw in (True, False):
                    axis = own[1 + 2 * index + (not raw)]
                    mode = "unguided" if raw else "guided"
                    self._panel(axis, f"{label_of(system)}, {mode}", scenario)
                    sample = self._sampled(models[system], request, raw=raw)[0]
                    draw_states(axis, sample)
                    draw_trajectories(axis, sample)
        return _saved(
            drawing,
            name,
            "Trajectories on perturbed maps (Scene-Attack, power 6), unguided and guided.",
        )

    def _panel(
        self, axes: "Axes", title: str, scenario: Scenario | None = None
    ) -> None:
        scenario = self.scenario if scenario is None else scenario
        draw_road(axes, scenario.road_map, scene_center(scenario), _HALF_SIDE_M)
        axes.set_title(title, fontsize=8)


def _logged(request: GenerationRequest) -> TrafficSample:
    """The recorded trajectories of the requested agents; gaps repeat the last place."""
    (view,) = REFERENCE_METHODS[GROUND_TRUTH].traffic(request)
    agents = view.agents
    step = np.where(agents.is_valid, np.arange(agents.is_valid.shape[1]), 0)
    last = np.maximum.accumulate(step, axis=1)
    row = np.arange(len(last))[:, None]
    return TrafficSample(
        ids=agents.ids,
        kinds=agents.kinds,
        size_m=agents.size_m,
        position_m=agents.position_m[row, last],
        heading_rad=agents.heading_rad[row, last],
        velocity_mps=agents.velocity_mps[row, last],
    )


def _panels(
    rows: int, columns: int, side: float = _SIDE_INCHES
) -> "tuple[Drawing, list[Any]]":
    from matplotlib.figure import Figure

    drawing = Figure(figsize=(side * columns, (side + 0.2) * rows), layout="tight")
    axes = drawing.subplots(rows, columns, squeeze=False).ravel()
    for one in axes:
        one.set_axis_on()
    return drawing, list(axes)


def _saved(drawing: "Drawing", name: str, caption: str) -> PaperPicture:
    files = {}
    for kind in ("png", "pdf"):
        file = io.BytesIO()
        # No date, so that equal figures have equal bytes.
        about = {"CreationDate": None} if kind == "pdf" else {"Software": None}
        drawing.savefig(file, format=kind, dpi=_DPI, metadata=about)
        files[kind] = file.getvalue()
    return PaperPicture(name=name, caption=caption, **files)


def _note(name: str, reason: str) -> PaperPicture:
    """A figure that could not be drawn, with the reason."""
    drawing, axes = _panels(1, 1)
    axes[0].set_axis_off()
    axes[0].text(0.5, 0.5, "not drawn", ha="center")
    return _saved(drawing, name, f"Not drawn: {reason}")
