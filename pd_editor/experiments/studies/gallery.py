"""Gallery of the worst variants of a study, exported so that the editor opens them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
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
from pd_editor.experiments.evaluation.reference_methods import GROUND_TRUTH
from pd_editor.experiments.evaluation.road_condition import (
    DEFAULT_ANCHOR,
    RoadCondition,
    road_conditions,
)
from pd_editor.experiments.studies.avoidable_danger import AvoidableDanger
from pd_editor.experiments.studies.variant_rows import StudyItem
from pd_editor.experiments.studies.worst_case import WorstCase
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
