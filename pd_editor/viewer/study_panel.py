"""The study panel: perturbation studies on many scenes, with live curves."""

import html
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import viser

from pd_editor.base.errors import FolderInUseError, InputError
from pd_editor.base.installed_files import ALL_DEMOS
from pd_editor.editor.commands.road import WARP_NAME
from pd_editor.experiments.evaluation.evaluation import scenes_of
from pd_editor.experiments.evaluation.evaluation_task import (
    ANCHORS,
    DEFAULT_ANCHOR,
    RoadCondition,
    road_conditions,
)
from pd_editor.experiments.evaluation.method import REFERENCE_METHODS, Method
from pd_editor.experiments.evaluation.scene_rows import RowsFolder
from pd_editor.experiments.report import REPORT_PAGE
from pd_editor.experiments.studies.outcomes import (
    GRID_SIZE,
    SearchSettings,
    SeverityCurve,
    WorstCase,
)
from pd_editor.experiments.studies.study_plan import (
    GRID_POWERS,
    StudyPlan,
    grid_conditions,
)
from pd_editor.experiments.studies.study_report import SHOWN
from pd_editor.experiments.studies.whole_study import Study, StudyExtras
from pd_editor.scene.generation import GeneratorSpec, ScenarioGenerator
from pd_editor.scene.road_warp import WARP_KINDS, WarpKind
from pd_editor.viewer.tab.panel_style import FixedText, KeptSettings
from pd_editor.viewer.tab.ui_context import UiContext, set_property, set_value

_COLORS: Final = ("#1c6fd1", "#d1600c")
_WIDTH, _HEIGHT, _LEFT, _TOP, _BOTTOM = 330, 170, 34, 8, 18
_TICKS: Final = (-9, -6, -3, 0, 3, 6, 9)


def severity_svg(
    curves: Sequence[SeverityCurve], methods: Sequence[str], name: str, title: str
) -> str:
    """Curves of one metric with bands of their 95 % intervals over scenes.

    A method has its colour by its place among ``methods``, whichever curves there are.
    """
    colored = [
        (curve, color)
        for method, color in zip(methods, _COLORS, strict=False)
        for curve in curves
        if curve.method == method
    ]
    scale = 100.0 if "%" in title else 1.0
    known = [
        scale * float(np.nanmax(values, initial=0.0))
        for curve in curves
        for values in (curve.estimates[name].value, curve.estimates[name].high)
    ]
    most = _rounded_up(max(known, default=0.0) or 1.0)
    parts = [_axes(most)]
    for curve, color in colored:
        found = curve.estimates[name]
        low, high = (
            np.where(np.isfinite(bound), bound, found.value)
            for bound in (found.low, found.high)
        )
        band = [
            *_points(curve.power, scale * high, most),
            *_points(curve.power, scale * low, most)[::-1],
        ]
        line = _points(curve.power, scale * found.value, most)
        parts.append(
            f'<polygon fill="{color}" fill-opacity="0.16" points="{" ".join(band)}"/>'
            f'<polyline fill="none" stroke="{color}" stroke-width="1.8" '
            f'points="{" ".join(line)}"/>' + _dots(line, color)
        )
    legend = "&ensp;".join(
        f'<span style="color:{color};font-weight:700">\u2014</span> '
        f"{html.escape(curve.method)}"
        for curve, color in colored
    )
    return (
        '<div style="margin:0 0.75em 0.6em;font-size:12px">'
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" style="display:block;width:100%" '
        f'role="img" aria-label="{html.escape(title)} by power">{"".join(parts)}</svg>'
        f"{legend and f'{legend} by power of the warp'}</div>"
    )


def _dots(points: list[str], color: str) -> str:
    """Dots at the powers; the curve of a sum has one power beside the plain road."""
    places = (point.split(",") for point in points)
    return "".join(
        f'<circle cx="{x}" cy="{y}" r="2.2" fill="{color}"/>' for x, y in places
    )


def _axes(most: float) -> str:
    parts = []
    for value in (0.0, most / 2, most):
        y = _y(value, most)
        parts.append(
            f'<line x1="{_LEFT}" x2="{_WIDTH}" y1="{y:.1f}" y2="{y:.1f}" '
            'stroke="currentColor" stroke-opacity="0.18"/>'
            f'<text x="{_LEFT - 5}" y="{y + 3.5:.1f}" text-anchor="end" font-size="10" '
            f'fill="currentColor" fill-opacity="0.75">{value:g}</text>'
        )
    parts += (
        f'<text x="{_x(power):.1f}" y="{_HEIGHT - 3}" text-anchor="middle" '
        f'font-size="10" fill="currentColor" fill-opacity="0.75">{power}</text>'
        for power in _TICKS
    )
    return "".join(parts)


def _points(power: np.ndarray, value: np.ndarray, most: float) -> list[str]:
    return [
        f"{_x(p):.1f},{_y(v, most):.1f}"
        for p, v in zip(power.tolist(), value.tolist(), strict=True)
        if math.isfinite(v)
    ]


def _x(power: float) -> float:
    return _LEFT + (power + 10) / 20 * (_WIDTH - _LEFT)


def _y(value: float, most: float) -> float:
    return _TOP + (1 - value / most) * (_HEIGHT - _TOP - _BOTTOM)


def _rounded_up(value: float) -> float:
    """The next of 1, 2 and 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= value)


POWERS: Final[Mapping[str, tuple[float, ...]]] = {
    "\u00b13, \u00b16, \u00b19": (-9.0, -6.0, -3.0, 3.0, 6.0, 9.0),
    "-9 to 9 (Scene-Attack's grid)": GRID_POWERS,
}
ANCHOR_CHOICES: Final[Mapping[str, tuple[str, ...]]] = {
    "Focal agent": (DEFAULT_ANCHOR,),
    "Ego vehicle": ("ego",),
    "Both": ANCHORS,
}
ROADS: Final[list[str]] = [*WARP_KINDS]
"""What a chart can be chosen for before a study."""
NO_METHOD: Final[str] = "None"
NOT_THERE: Final[str] = "-"
MAX_SCENES: Final = 10_000
ROADS_AND_FOLDER: Final = "Roads, results folder, resume"


@dataclass(frozen=True)
class _MadeBy:
    """Makes the generator of an offer, in whatever process it is called."""

    make: Callable[[], ScenarioGenerator]

    def __call__(self, _name: str) -> ScenarioGenerator:
        return self.make()


def _study_folder(path: Path, plan: StudyPlan, *, resumes: bool) -> RowsFolder:
    """The folder for the results; a refusal says what can be done in the panel."""
    try:
        return plan.folder(path, resume=resumes)
    except FolderInUseError as error:
        raise FolderInUseError(
            f"{path}: already holds files; enter a new results folder, or press Resume "
            "to go on with the study in it."
        ) from error


def _title(kind: WarpKind) -> str:
    """Name of a warp in the tab Road, and that of Scene-Attack."""
    name = WARP_NAME[kind]
    return f"{name[0].upper()}{name[1:]} ({kind.replace('-', ' ')})"


class StudyPanel:
    """Set up, run and cancel a study; curves while it runs; its worst scenes."""

    def __init__(self, ui: UiContext, generators: Mapping[str, GeneratorSpec]) -> None:
        """Build it into the current tab."""
        self._ui = ui
        self._generators = generators
        self._study = ui.workspace.study
        self._shown: Study | None = None
        self._gallery: dict[str, Path] = {}
        self._report = Path()
        self._add_plan(ui.client.gui)
        self._add_results(ui.client.gui)
        ui.on_click(self._run, self.run, failure="Study not started")
        ui.on_click(self._resume, self.resume, failure="Study not resumed")
        ui.on_click(self._download, self._download_report)
        ui.on_click(self._cancel, self.cancel)
        ui.on_click(self._open, self._open_chosen)
        for handle in (self._metric, self._kind):
            ui.on_change(handle, lambda _value: self._draw())
        self._settings = self._kept_settings()
        self._settings.restore()
        self._study.on_change = self._listener = lambda: ui.post(self._show, "study")
        self._show()

    def _add_plan(self, gui: viser.GuiApi) -> None:
        """What is studied, and the run."""
        names = (*self._generators, *REFERENCE_METHODS)
        dataset = self._ui.workspace.dataset
        with gui.add_folder("Perturbation study"):
            self._data = gui.add_text(
                "Data",
                ALL_DEMOS if dataset is None else str(dataset.root),
                hint="Folder of Argoverse 2 scenarios, name of a demo, or demos for all",
            )
            self._limit = gui.add_number(
                "Scenes",
                12,
                min=1,
                max=MAX_SCENES,
                step=1,
                hint="The first N of the dataset",
            )
            self._method = gui.add_dropdown("Method", names)
            self._other = gui.add_dropdown(
                "Compare with", (NO_METHOD, *names), initial_value="constant-velocity"
            )
            with gui.add_folder(ROADS_AND_FOLDER, expand_by_default=False):
                self._kinds = {
                    kind: gui.add_checkbox(_title(kind), True) for kind in WARP_KINDS
                }
                self._powers = gui.add_dropdown("Strengths", tuple(POWERS))
                self._anchors = gui.add_dropdown(
                    "Warp anchor", tuple(ANCHOR_CHOICES), hint="Where the warps begin"
                )
                self._sums = gui.add_text(
                    "Sums of warps",
                    "",
                    hint="Such as smooth-turn:6+ripple-road:2; @ego warps ahead of the ego",
                )
                self._out = gui.add_text(
                    "Results folder", "study", hint="A new folder, or one to resume"
                )
                self._seed = gui.add_number("Seed", 0, min=0, max=2**31 - 1, step=1)
                self._searches = gui.add_checkbox(
                    "Search worst warps",
                    False,
                    hint="Of each scene; needs the extra 'study' (Optuna)",
                )
                self._resume = gui.add_button(
                    "Resume",
                    color="gray",
                    hint="Go on with the study of these settings in the results folder",
                )
            self._run = gui.add_button("Run the study", icon=viser.Icon.CHART_LINE)
            self._cancel = gui.add_button("Cancel", color="gray", visible=False)
            self._bar = gui.add_progress_bar(0.0, visible=False)
            self._note = FixedText(gui, 2, grows=True)

    def _add_results(self, gui: viser.GuiApi) -> None:
        """Curves, worst scenes and the report."""
        self._curves = gui.add_folder("Severity curves", visible=False)
        with self._curves:
            self._metric = gui.add_dropdown(
                "Metric",
                tuple(t for _, t in SHOWN),
                hint="SOR, soft off-road rate: share of steps off the drivable area. "
                "HOR, hard off-road rate: share of agents that are off it at any step",
            )
            self._kind: viser.GuiDropdownHandle[str] = gui.add_dropdown(
                "Warp", ROADS, hint="; ".join(map(_title, WARP_KINDS))
            )
            self._chart = gui.add_html(severity_svg((), (), *SHOWN[0]))
        self._results = gui.add_folder("Results", visible=False)
        with self._results:
            self._worst: viser.GuiDropdownHandle[str] = gui.add_dropdown(
                "Worst scenes", [NOT_THERE]
            )
            self._open = gui.add_button("Open scene", color="gray", disabled=True)
            self._download = gui.add_button(
                "Download the report", icon=viser.Icon.DOWNLOAD, color="gray"
            )

    def _kept_settings(self) -> KeptSettings:
        inputs: Mapping[str, Any] = {
            "data": self._data,
            "limit": self._limit,
            "method": self._method,
            "other": self._other,
            "powers": self._powers,
            "anchors": self._anchors,
            "sums": self._sums,
            "out": self._out,
            "seed": self._seed,
            "searches": self._searches,
            **self._kinds,
        }
        return KeptSettings(self._study.settings, inputs)

    def run(self) -> None:
        """Start a study with the settings of the panel in a new folder.

        Raises:
            InputError: a setting cannot be used.
            ExportError: the folder for the results is not free.
        """
        self._start(resumes=False)

    def resume(self) -> None:
        """Go on with the study in the folder, which has the settings of the panel.

        Raises:
            InputError: a setting cannot be used, or differs from that of the study.
            ExportError: the folder holds something else.
        """
        self._start(resumes=True)

    def _start(self, *, resumes: bool) -> None:
        """Start or resume a study."""
        if self._study.is_running:
            raise InputError("A study is running; cancel it first.")
        data, out = str(self._data.value).strip(), str(self._out.value).strip()
        if not data or not out:
            raise InputError(
                "Name the folder of the scenarios and one for the results."
            )
        folders = self._ui.workspace.folders
        plan = StudyPlan(
            data=(folders.scenes(data),),
            methods=self._methods(),
            conditions=self._conditions(),
            seeds=(int(self._seed.value),),
            limit=int(self._limit.value),
        )
        found = scenes_of(plan.data, plan.limit)
        folder = _study_folder(folders.results(out), plan, resumes=resumes)
        trials = GRID_SIZE if self._searches.value else 0
        search = SearchSettings(num_trials=trials)
        self._study.start(plan, StudyExtras(search=search), found, folder)

    def cancel(self) -> None:
        """Cancel a running study; what is finished stays in its folder."""
        self._study.cancel()

    def close(self) -> None:
        """Leave a running study and the settings to the page that comes next."""
        self._settings.keep()
        if self._study.on_change is self._listener:
            self._study.on_change = None

    def _show(self) -> None:
        """Show how far the study is, its curves, and its results once it is done."""
        study = self._study
        self._set_running(study.is_running)
        set_property(self._bar, "value", round(100 * study.fraction, 1))
        self._note.show("", *study.words)
        self._draw()
        if study.study is not self._shown:
            self._shown = study.study
            self._show_results(study.study)
        error = study.take_error()
        if error is not None:
            self._ui.report(error)

    def _conditions(self) -> tuple[RoadCondition, ...]:
        """The grid of the ticked kinds at each anchor, and the sums."""
        kinds = [kind for kind, box in self._kinds.items() if box.value]
        sums = str(self._sums.value).replace(",", " ").split()
        if not kinds and not sums:
            raise InputError("Tick a kind of warp, or name a sum of warps.")
        grid = grid_conditions(
            kinds, POWERS[self._powers.value], ANCHOR_CHOICES[self._anchors.value]
        )
        extra = road_conditions(sums) if sums else ()
        return tuple(dict.fromkeys((*grid, *extra)))

    def _methods(self) -> tuple[Method, ...]:
        wanted = dict.fromkeys((self._method.value, self._other.value))
        return tuple(
            Method(name=name, make_generator=_MadeBy(self._offer(name)))
            for name in wanted
            if name != NO_METHOD
        )

    def _offer(self, name: str) -> Callable[[], ScenarioGenerator]:
        # Reference methods never call it.
        offer = self._generators.get(name, next(iter(self._generators.values())))
        return offer.make

    def _set_running(self, is_running: bool) -> None:
        set_property(self._resume, "disabled", is_running)
        set_property(self._run, "visible", not is_running)
        set_property(self._cancel, "visible", is_running)
        set_property(self._bar, "visible", is_running)

    def _show_results(self, study: Study | None) -> None:
        """Offer the worst scenes and the report of a study that is done."""
        entries = () if study is None else study.findings.gallery
        self._gallery = {
            f"{number}. {one.case.title}": one.folder
            for number, one in enumerate(entries, 1)
            if isinstance(one.case, WorstCase)
        }
        self._report = Path() if study is None else study.folder / REPORT_PAGE
        self._worst.options = tuple(self._gallery) or (NOT_THERE,)
        set_value(self._worst, self._worst.options[0])
        set_property(self._open, "disabled", not self._gallery)
        set_property(self._results, "visible", study is not None)

    def _download_report(self) -> None:
        try:
            content = self._report.read_bytes()
        except OSError as error:
            raise InputError(f"{self._report}: cannot be read.") from error
        self._ui.client.send_file_download(
            self._report.name, content, save_immediately=True
        )

    def _open_chosen(self) -> None:
        folder = self._gallery.get(str(self._worst.value))
        if folder is None:
            raise InputError("There is no worst scene yet; run a study.")
        self._ui.commit_gesture()
        self._ui.workspace.open_reference(str(folder))

    def _draw(self) -> None:
        """Draw the chosen metric of the methods, with their intervals."""
        names = {title: name for name, title in SHOWN}
        title = str(self._metric.value)
        self._offer_roads()
        curves = [one for one in self._study.curves if one.road == self._kind.value]
        svg = severity_svg(curves, self._study.methods, names[title], title)
        set_property(self._chart, "content", svg)
        set_property(self._curves, "visible", bool(self._study.curves))

    def _offer_roads(self) -> None:
        """Offer the roads that have curves; the chosen one stays if it has one.

        While a study runs, more roads follow, so that none is taken away.
        """
        found = [one.road for one in self._study.curves] or ROADS
        offered = self._kind.options if self._study.is_running else ()
        roads = list(dict.fromkeys((*offered, *found)))
        if list(self._kind.options) == roads:
            return
        chosen = self._kind.value
        self._kind.options = roads
        set_value(self._kind, chosen if chosen in roads else roads[0])
