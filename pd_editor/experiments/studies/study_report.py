"""Report of a study: severity curves, tables, worst cases and their gallery."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from pd_editor.base.errors import PdEditorError
from pd_editor.editor.commands import SetRoadWarp, traffic_command
from pd_editor.editor.library.thumbnail import thumbnail
from pd_editor.editor.scenario_store import export_into, open_part
from pd_editor.editor.session import EditorSession
from pd_editor.editor.variant import (
    Variant,
    free_name,
    name_from_text,
    power_name,
    short_id,
)
from pd_editor.experiments.evaluation.evaluation_task import (
    DEFAULT_ANCHOR,
    RoadCondition,
    road_conditions,
)
from pd_editor.experiments.evaluation.method import GROUND_TRUTH
from pd_editor.experiments.evaluation.report.tables import (
    COLORS,
    Panels,
    named,
    unit_of,
)
from pd_editor.experiments.evaluation.scene_rows import RunResults
from pd_editor.experiments.report import (
    Figure,
    Report,
    ReportTable,
    Section,
    command_section,
    table_of_first,
)
from pd_editor.experiments.studies.outcomes import (
    AvoidableDanger,
    SearchSettings,
    SeverityCurve,
    WorstCase,
    road_title,
)
from pd_editor.experiments.studies.study_plan import (
    StudyItem,
    StudyPlan,
    num_failed_variants,
)
from pd_editor.scene.base_reference import SceneCut
from pd_editor.scene.generation import GeneratedTraffic, TrafficSample

GALLERY_NAME: Final = "gallery"


@dataclass(frozen=True, kw_only=True, eq=False)
class GalleryEntry:
    """A scenario of the gallery with the folder that the editor opens."""

    case: WorstCase | AvoidableDanger
    folder: Path
    thumbnail: str
    """Small top view as SVG."""


def worst_of_scenes(cases: Sequence[WorstCase], count: int) -> tuple[WorstCase, ...]:
    """The worst cases, at most one of each scene and method."""
    found: dict[tuple[Path, str], WorstCase] = {}
    for case in sorted(cases, key=lambda one: -one.value):
        if case.condition and np.isfinite(case.value):
            found.setdefault((case.folder, case.method), case)
    return tuple(found.values())[:count]


def export_case(
    case: WorstCase,
    item: StudyItem,
    out: Path,
    is_taken: Callable[[str], bool] = lambda _name: False,
) -> GalleryEntry:
    """Make a variant again from an item of its scene, method and seed, and export it.

    It gets a name that is not taken.

    Raises:
        PdEditorError: the method fails, or the folder cannot be written.
    """
    (condition,) = road_conditions([case.condition])
    session = EditorSession(open_part(item.folder, item.cut))
    road = [f"{kind}-{power_name(power)}" for kind, power in condition.terms]
    at = () if condition.anchor == DEFAULT_ANCHOR else (condition.anchor,)
    name = " ".join((short_id(case.scenario), case.method, *road, *at, f"s{case.seed}"))
    request = item.request(session.scenario, condition)
    traffic = item.method.traffic(request)
    if not condition.is_plain:
        session.apply(_warp_command(condition, session, item))
    if item.method.name != GROUND_TRUTH:
        sample = TrafficSample.of(traffic.samples[0].agents)
        generated = GeneratedTraffic(
            samples=(sample,),
            generator=item.method.generator_name,
            model_sha256=traffic.model_sha256,
            seed=request.seed,
        )
        asked = replace(request, scenario=session.scenario, num_samples=1)
        session.apply(traffic_command(asked, generated))
    name = free_name(name_from_text(name), is_taken)
    folder = _export(session, Variant(name=name), out)
    return GalleryEntry(case=case, folder=folder, thumbnail=thumbnail(session.scenario))


def export_cases(
    cases: Sequence[WorstCase], items: Sequence[StudyItem], out: Path
) -> tuple[tuple[GalleryEntry, ...], dict[str, PdEditorError]]:
    """Export several cases; returns them, and the errors of those that are left out."""
    by_scene = {(one.place, one.method.name, one.seed): one for one in items}
    entries, failures = [], {}
    for case in cases:
        item = by_scene.get((case.folder, case.method, case.seed))
        if item is None:
            continue
        try:
            names = {entry.folder.name for entry in entries}
            entries.append(export_case(case, item, out, names.__contains__))
        except PdEditorError as error:
            where = f"{case.scenario}, {case.condition}, {case.method}"
            failures[f"gallery: {where}, seed {case.seed}"] = error
    return tuple(entries), failures


def export_danger(
    danger: AvoidableDanger, source: Path, cut: SceneCut, out: Path
) -> GalleryEntry:
    """Export what is used of a scene in which an agent has a dangerous behaviour.

    Raises:
        PdEditorError: the folder cannot be written.
    """
    session = EditorSession(open_part(source, cut))
    name = f"{short_id(session.scenario.scenario_id)} danger {danger.agent_id}"
    escape = (
        f"{danger.num_avoiding} trajectories of {danger.ego_id} avoid the collision."
    )
    session.apply(danger.behaviour)
    folder = _export(session, Variant(name=name_from_text(name), note=escape), out)
    return GalleryEntry(
        case=danger, folder=folder, thumbnail=thumbnail(session.scenario)
    )


def _export(session: EditorSession, variant: Variant, out: Path) -> Path:
    """Export with a name that does not stay when a user goes on with the edits."""
    recipe = replace(
        session.recipe(), created_at="", variant=replace(variant, is_proposed=True)
    )
    return export_into(out, session.scenario, recipe, base=session.base, overwrite=True)


def _warp_command(
    condition: RoadCondition, session: EditorSession, item: StudyItem
) -> SetRoadWarp:
    return SetRoadWarp(
        warp=condition.warp_of(session.scenario),
        friction_coefficient=item.friction_coefficient,
    )


SHOWN: Final = (
    ("off_drivable_steps", "SOR, %"),
    ("off_drivable", "HOR, %"),
    ("lateral_deviation_mean", "lateral deviation, m"),
    ("new_overlap", "collisions after t = 0, %"),
    ("min_ade", "minADE, m"),
)
"""Metrics of the severity curves."""
_TICKS: Final = (-9, -6, -3, 0, 3, 6, 9)


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyFindings:
    """Results of a study."""

    curves: Sequence[SeverityCurve]
    grid: Sequence[WorstCase] = ()
    search: Sequence[WorstCase] = ()
    settings: SearchSettings = field(default_factory=SearchSettings)
    gallery: Sequence[GalleryEntry] = ()
    dangers: Sequence[GalleryEntry] = ()
    failures: Mapping[str, PdEditorError] = field(default_factory=dict)
    """Errors of searches and exports by what failed."""


def study_report(
    plan: StudyPlan,
    record: RunResults,
    findings: StudyFindings,
    num_scenes: int,
    command: str,
) -> Report:
    """Assemble the report."""
    return Report(
        title="Perturbation study",
        sections=(
            Section(
                title="What was done",
                paragraphs=_words(plan, record, findings, num_scenes),
            ),
            Section(
                title="Results",
                paragraphs=("Severity curves.",),
                figures=severity_figures(findings.curves),
            ),
            Section(
                title="By power",
                tables=tuple(_curve_table(curve) for curve in findings.curves),
            ),
            *_worst_sections(findings),
            Section(title="Dangerous but avoidable", tables=tuple(_dangers(findings))),
            Section(title="What failed", tables=_failures(record, findings)),
            command_section(command),
        ),
    )


def severity_figures(curves: Sequence[SeverityCurve]) -> tuple[Figure, ...]:
    """One figure for each metric, with a panel for each kind of warp."""
    families = list(dict.fromkeys((one.kind, one.anchor) for one in curves))
    families = [
        one
        for one in families
        if any(len(c.power) > 2 for c in curves if (c.kind, c.anchor) == one)
    ]
    if not families:
        return ()
    agents = curves[0].agents
    return tuple(
        Figure(
            data=_severity_svg(curves, families, name, title),
            caption=f"{title}, {agents}, by power of the warp (0: plain road). Bands: "
            "95 % intervals over scenes.",
        )
        for name, title in SHOWN
    )


def _severity_svg(
    curves: Sequence[SeverityCurve],
    families: Sequence[tuple[str, str]],
    name: str,
    title: str,
) -> bytes:
    methods = list(dict.fromkeys(one.method for one in curves))
    scale = 100.0 if unit_of(name) == "share" else 1.0
    panels = Panels(len(families), 2.6, columns=len(families), shares_y=True)
    for axes, (kind, anchor) in zip(panels.axes, families, strict=True):
        for curve in curves:
            if (curve.kind, curve.anchor) != (kind, anchor):
                continue
            color = COLORS[methods.index(curve.method) % len(COLORS)]
            found = curve.estimates[name]
            axes.plot(
                curve.power,
                scale * found.value,
                marker=".",
                color=color,
                label=curve.method,
            )
            axes.fill_between(
                curve.power,
                scale * found.low,
                scale * found.high,
                color=color,
                alpha=0.15,
                linewidth=0,
            )
        axes.set_title(road_title(kind, anchor), loc="left", weight="bold")
        axes.set_xlabel("power")
        axes.set_xticks(_TICKS)
        axes.grid(color="#eeeeee")
    # Last, since the limits that the curves need end here.
    panels.axes[0].set_ylim(bottom=0)
    panels.axes[0].set_ylabel(title)
    panels.legend()
    return panels.svg()


def _words(
    plan: StudyPlan, record: RunResults, findings: StudyFindings, num_scenes: int
) -> tuple[str, ...]:
    friction = plan.friction_coefficient
    slowed = (
        "Agents keep their speeds on warped roads."
        if friction is None
        else f"On warped roads, agents are slowed to the friction limit (mu {friction:g}); "
        "their histories are warped with the road."
    )
    agents = findings.curves[0].agents if findings.curves else "movers"
    words = [
        f"Scenes: {num_scenes}; methods: {len(plan.methods)}; road conditions: "
        f"{len(plan.conditions)}; seeds: {len(plan.seeds)}; in all "
        f"{plan.num_variants(num_scenes)} variants. "
        f"Figures are of {agents}. SOR and HOR are Scene-Attack's soft and hard off-road "
        "rates: the share of steps, and of agents at any step, off the drivable area.",
        slowed,
    ]
    if count := num_failed_variants(record.rows):
        words.append(
            f"**{count} variants failed** and are left out of all figures; see below."
        )
    return tuple(words)


def _curve_table(curve: SeverityCurve) -> ReportTable:
    return ReportTable(
        title=f"{curve.method}, {curve.road}, {curve.agents}",
        header=("power", "scenes", *(title for _, title in SHOWN)),
        rows=tuple(
            (
                f"{power:g}",
                str(curve.num_scenes[index]),
                *(
                    curve.estimates[name].cell((index,), unit_of(name))
                    for name, _ in SHOWN
                ),
            )
            for index, power in enumerate(curve.power.tolist())
        ),
    )


def _worst_sections(findings: StudyFindings) -> tuple[Section, ...]:
    settings = findings.settings
    title = _title(settings.metric)
    tables = []
    if findings.search:
        tables.append(_compared_table(findings))
    if findings.gallery:
        tables.append(
            ReportTable(
                title="Worst variants, to open in the editor",
                header=("method", "scene", "condition", title, "open"),
                rows=tuple(
                    (
                        one.case.method,
                        one.case.scenario,
                        one.case.condition,
                        _shown(one.case.value, settings.metric),
                        f"`pd-editor edit {Path('gallery') / one.folder.name}`",
                    )
                    for one in findings.gallery
                    if isinstance(one.case, WorstCase)
                ),
            )
        )
    words = (
        f"The variant of each scene with the highest {title.split(',')[0]} of "
        f"{settings.agents}.",
    )
    return (Section(title="Worst cases", paragraphs=words, tables=tuple(tables)),)


def _title(metric: str) -> str:
    return dict(SHOWN).get(metric, named(metric))


def _shown(value: float, metric: str) -> str:
    """Text of a value in the unit of its title: shares in per cent."""
    return f"{100 * value if unit_of(metric) == 'share' else value:.3g}"


def _compared_table(findings: StudyFindings) -> ReportTable:
    """Search against grid, scene by scene."""
    grid = {(one.folder, one.method, one.seed): one for one in findings.grid}
    metric = findings.settings.metric
    rows, num_as_bad = [], 0
    for one in findings.search:
        other = grid.get((one.folder, one.method, one.seed))
        if other is None:
            continue
        is_as_bad = one.value >= other.value
        num_as_bad += is_as_bad
        rows.append(
            (
                one.method,
                one.scenario,
                f"{other.condition}: {_shown(other.value, metric)}",
                f"{one.condition}: {_shown(one.value, metric)}",
                "yes" if is_as_bad else "no",
            )
        )
    share = 100 * num_as_bad / max(len(rows), 1)
    return ReportTable(
        title=f"Search against the grid: {_title(metric)}",
        header=(
            "method",
            "scene",
            "worst of the grid",
            "worst of the search",
            "as bad",
        ),
        rows=tuple(rows),
        note=f"The search found at least as bad a variant in {share:.0f} % of "
        f"{len(rows)} cases, with {findings.settings.num_trials} trials each.",
    )


def _dangers(findings: StudyFindings) -> list[ReportTable]:
    rows = [
        (
            one.folder.name,
            found.agent_id,
            found.ego_id,
            f"{found.time_s:.1f} s",
            f"{found.impact_mps:.1f} m/s",
            str(found.num_avoiding),
            f"`pd-editor edit {Path('gallery') / one.folder.name}`",
        )
        for one in findings.dangers
        if isinstance(found := one.case, AvoidableDanger)
    ]
    if not rows:
        return []
    header = ("scenario", "agent", "hit by", "after", "impact", "ways out", "open")
    return [
        ReportTable(
            title="Behaviours that the ego hits, and could avoid",
            header=header,
            rows=tuple(rows),
            note="A behaviour is a Frenet candidate of the agent; ways out are the ego's "
            "candidates that collide with nothing. All others move as recorded.",
        )
    ]


def _failures(record: RunResults, findings: StudyFindings) -> tuple[ReportTable, ...]:
    left_out = {**record.failures, **findings.failures}
    rows = [("-", key, str(reason)) for key, reason in left_out.items()]
    failed = record.rows.select(
        ["method", "scenario_id", "condition", "failure", "agents"]
    )
    for one in failed.to_pylist():
        if one["failure"] and one["agents"] == "focal":
            where = f"{one['scenario_id']}, {one['condition']}"
            rows.append((one["method"], where, one["failure"]))
    return table_of_first("Failed variants", ("method", "where", "why"), rows)
