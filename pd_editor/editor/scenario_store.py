"""Opens scenarios by name or folder, and writes them with their recipes."""

import contextlib
import dataclasses
import functools
import itertools
import logging
import os
import re
import tempfile
import zlib
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from contextvars import ContextVar
from pathlib import Path
from typing import Final

import numpy as np

from pd_editor.base.errors import (
    ExportError,
    InputError,
    LargeSceneError,
    PdEditorError,
    RecipeError,
)
from pd_editor.base.installed_files import DEMO_PREFIX, demo_folder, demo_names
from pd_editor.base.regular_file import check_path, folders_below, read_regular
from pd_editor.editor.recipe import MAX_RECIPE_BYTES, Recipe, replay
from pd_editor.scene.av2_io.file_names import map_name, tracks_name
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.av2_io.upload import (
    MAX_UNPACKED_BYTES,
    MAX_UPLOAD_BYTES,
    files_in_upload,
    scenario_from_upload,
    scenario_of_upload,
    scenarios_in_upload,
)
from pd_editor.scene.base_reference import BaseReference, SceneCut
from pd_editor.scene.bundle import RECIPE_NAME, check_place, write_files
from pd_editor.scene.formats.argoverse2 import ARGOVERSE2
from pd_editor.scene.formats.packed_file import closed_folder
from pd_editor.scene.formats.player import PLAYER
from pd_editor.scene.formats.registry import (
    foreign_scenes_among,
    format_of,
    formats,
    has_foreign_ending,
    is_foreign_scene,
    name_of_scene,
    read_scene,
    unread_file,
    writer,
)
from pd_editor.scene.formats.sumo import CONFIGS
from pd_editor.scene.road_map import Lane
from pd_editor.scene.roles.focal_agent import with_focal_category
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.scene_cut import cut_scenario, origin_of_cut, window_of

LOSSES_NAME: Final = "losses.txt"
"""File of an export that tells what its format cannot say."""
ATTRIBUTION_NAME: Final = "attribution.txt"
"""File of an export that tells who made its source, and under which licence."""
MAX_LABELS: Final = 8
"""Number of edits that a note names; further ones are counted."""
_HEAD_BYTES: Final = 1 << 16
_NAME_BYTES, _MOST_MENTIONS = 256, 10_000
SAME_M: Final = 0.02
"""Tolerance of equal positions: map files are rounded to centimetres."""
_RUN: Final = ContextVar("run", default="")
_LOG: Final = logging.getLogger(__name__)


def open_scenario(
    reference: str | Path,
    *,
    current_s: float | None = None,
    until_s: float | None = None,
    around: tuple[float, float] | None = None,
    radius_m: float | None = None,
) -> Scenario:
    """Open a demo, an Argoverse 2 scenario folder, a zip of one, or another format's file.

    Args:
        reference: name or path.
        current_s: seconds of the recording that count as observed; the last of their
            steps becomes the current one. None: as the file has it.
        until_s: seconds after the current step that are kept; None keeps all.
        around: x and y in metres of the file's frame, about which a square of the map is
            kept; None keeps all.
        radius_m: half the side of that square; None: 150 m.

    Raises:
        InputError: there is no such demo or folder, or it cannot be read.
        LargeSceneError: it is larger or longer than scenes may be, and no part that is
            small enough was asked for.
    """
    window = window_of(around, radius_m)
    cut = SceneCut(current_s=current_s, until_s=until_s, window=window)
    return open_part(reference, cut)


def open_part(reference: str | Path, cut: SceneCut) -> Scenario:
    """Open a scenario, and keep what a cut keeps; raises as ``open_scenario`` does."""
    return cut_when_read(lambda: _opened(reference), cut)


def scene_part(path: Path, cut: SceneCut) -> Scenario:
    """Read a scene of a dataset, and keep what a cut keeps; raises as ``cut_when_read``."""
    return cut_when_read(lambda: read_scene(path), cut)


def cut_when_read(read: Callable[[], Scenario], cut: SceneCut) -> Scenario:
    """Read a scenario and cut it, also one that is too large or long as a whole.

    Raises:
        InputError: it cannot be read, or cut.
        LargeSceneError: what would be left is larger or longer than scenes may be.
    """
    try:
        opened = read()
    except LargeSceneError as error:
        if cut == SceneCut():
            raise
        return _part_of_large(error, cut)
    return opened if cut == SceneCut() else cut_scenario(opened, cut)


def _part_of_large(error: LargeSceneError, cut: SceneCut) -> Scenario:
    """What a cut leaves of a scene that is too large or long as a whole."""
    part, times = error.scene, (cut.current_s or 0.0, cut.until_s or 0.0)
    if has_times := bool(part.tracks) and any(times):
        part = part.during(cut)
    if cut.window is not None:
        part = part.within(cut.window)
        if not part.lanes:
            raise InputError(
                f"There is no lane within {cut.window.radius_m:g} m of "
                f"{cut.window.x_m:g}, {cut.window.y_m:g}: {error}"
            ) from error
    opened = part.scenario(error.data)
    if not has_times:
        return cut_scenario(opened, cut)
    opened = cut_scenario(opened, SceneCut(window=cut.window))
    origin = origin_of_cut(opened.provenance, cut, *times)
    return dataclasses.replace(opened, provenance=origin)


def lanes_of_file(read: Callable[[], Scenario]) -> tuple[Lane, ...]:
    """All lanes of what is read, in the file's frame, also where they are too many.

    Raises:
        InputError: it cannot be read.
    """
    try:
        opened = read()
    except LargeSceneError as error:
        return error.scene.lanes
    origin = opened.origin_city_m
    return opened.road_map.moved(lambda points: points + origin).lanes


@contextlib.contextmanager
def read_once(run: str) -> Iterator[None]:
    """Keep what was read last in a run of some name, for its other parts; none: nothing."""
    token = _RUN.set(run)
    try:
        yield
    finally:
        _RUN.reset(token)


@functools.lru_cache(maxsize=1)
def _read_in_run(run: str, reference: str) -> Scenario | LargeSceneError:
    del run
    try:
        return _read(reference)
    except LargeSceneError as error:
        return error


def open_base(base: BaseReference, source: str | Path = "") -> Scenario:
    """Open the base of a recipe, from another place if one is given.

    Raises:
        InputError: it is not there, or cannot be read.
    """
    return open_part(source or base.source, base.cut or SceneCut())


def _opened(reference: str | Path) -> Scenario:
    run = _RUN.get()
    found = _read_in_run(run, str(reference)) if run else _read(str(reference))
    if isinstance(found, LargeSceneError):
        raise found
    return found


def _read(text: str) -> Scenario:
    check_path(text)
    name = text.removeprefix(DEMO_PREFIX)
    if name in demo_names() and not os.path.isdir(text):
        scenario = read_scenario(demo_folder(name))
        return scenario.with_origin(source=f"{DEMO_PREFIX}{name}")
    # os.path, unlike pathlib, does not raise for an unknown ~user or forbidden parent.
    folder = os.path.expanduser(text)
    if os.path.isfile(folder) and folder.lower().endswith(".zip"):
        return _open_zip(Path(folder))
    path = Path(folder)
    if not os.path.isdir(folder) and not (
        os.path.isfile(folder) and format_of(path) is not None
    ):
        raise _no_scenario(text, folder)
    scenario = read_scene(_only_file(path) or path)
    recipe = recipe_of_export(path)
    return scenario if recipe is None else made_by(scenario, recipe)


def _only_file(folder: Path) -> Path | None:
    """The file of a scene in a folder that is none itself, such as an export."""
    if format_of(folder) is not None:
        return None
    try:
        found = foreign_scenes_among(folder.iterdir())
    except OSError:
        return None
    return found[0] if len(found) == 1 else None


def foreign_scenes(folder: Path) -> list[Path]:
    """What formats other than Argoverse 2 read: a folder, or what is below it, sorted."""
    if is_foreign_scene(folder):
        return [folder]
    found: list[Path] = []
    for place, folders, files in folders_below(folder):
        scenes = foreign_scenes_among(Path(place, one) for one in (*folders, *files))
        # What is within a scene is a part of it.
        folders[:] = [one for one in folders if Path(place, one) not in scenes]
        found += scenes
    return sorted(found)


def _open_zip(path: Path) -> Scenario:
    scenario, recipe = scenario_and_recipe(
        {path.name: read_regular(path, max_bytes=MAX_UPLOAD_BYTES)}
    )
    scenario = scenario.with_origin(source=os.path.realpath(path))
    return scenario if recipe is None else made_by(scenario, recipe)


def _no_scenario(text: str, path: str) -> InputError:
    """The error of a reference, which says what is there instead."""
    endings = sorted({e for one in formats().values() for e in one.endings})
    has_ending = path.endswith(tuple(endings))
    if not os.path.isfile(path):
        if has_ending and not os.path.exists(path):
            return InputError(f"{text}: there is no such file.")
        return InputError(
            f"{text}: is neither a scenario folder nor a demo "
            f"({', '.join(demo_names())})."
        )
    if told := unread_file(Path(path)):
        return InputError(f"{text}: {told}")
    if path.endswith(".json"):
        return InputError(
            f"{text}: is no file of a known format; recipes are replayed by pd-editor"
            " replay, and scenarios are opened by their folder."
        )
    known = "in spite of its ending" if has_ending else f"({', '.join(endings)})"
    return InputError(
        f"{text}: is no file of a known format {known}; for Argoverse 2,"
        " expected the folder that holds scenario_<id>.parquet and log_map_archive_<id>.json, or a zip of it."
    )


def scenario_and_recipe(files: Mapping[str, bytes]) -> tuple[Scenario, Recipe | None]:
    """Scenario in uploaded files or a zip, and its recipe if one is there.

    Raises:
        InputError: the files cannot be read.
    """
    foreign = _foreign_upload(_foreign_scenes(files))
    for name, data in files.items() if foreign is None and len(files) == 1 else ():
        with _as_file(name, data[:_HEAD_BYTES]) as path:
            if told := unread_file(path):
                raise InputError(f"{name[:60]}: {told}")
    scenario = scenario_from_upload(files) if foreign is None else foreign
    found = list(files_in_upload(files, RECIPE_NAME.__eq__, MAX_RECIPE_BYTES))
    try:
        return scenario, Recipe.from_text(found[0][1]) if len(found) == 1 else None
    except RecipeError as error:
        _LOG.info("The recipe is passed over: %s", error)
        return scenario, None


def is_foreign(name: str, content: bytes) -> bool:
    """Whether an uploaded file is a scene of a format other than Argoverse 2."""
    if not has_foreign_ending(name):
        return False
    with _as_file(name, content[:_HEAD_BYTES]) as path:
        return format_of(path) is not None


def scenes_in_upload(
    files: Mapping[str, bytes],
) -> dict[str, Callable[[], Mapping[str, bytes]]]:
    """What gives the files of each scene of an upload, by its name; empty unless several.

    Raises:
        ArchiveError: unsafe, or no readable zip.
    """
    if names := scenarios_in_upload(files):
        return {one: functools.partial(scenario_of_upload, files, one) for one in names}
    scenes = _foreign_scenes(files)
    several = scenes if len(scenes) > 1 else {}
    # Texts of many scenes are large; what several of them share is packed once.
    whole = {id(data): data for part in several.values() for data in part.values()}
    packed = {key: zlib.compress(data, 1) for key, data in whole.items()}
    kept = {
        scene: {name: packed[id(data)] for name, data in part.items()}
        for scene, part in several.items()
    }
    return {scene: functools.partial(_unpacked, part) for scene, part in kept.items()}


def _unpacked(files: Mapping[str, bytes]) -> dict[str, bytes]:
    return {name: zlib.decompress(data) for name, data in files.items()}


def _foreign_scenes(files: Mapping[str, bytes]) -> dict[str, dict[str, bytes]]:
    """Files of each scene of a format other than Argoverse 2, by its name, its own first.

    What a file names of its folder, such as the road under its traffic, is a part of it.
    """
    inside: dict[Path, bytes] = {}
    with tempfile.TemporaryDirectory() as top:
        folders: dict[Path, Path] = {}
        for place, data in files_in_upload(
            files,
            lambda name: (
                name == RECIPE_NAME
                or has_foreign_ending(name)
                or name.lower().endswith(CONFIGS)
            ),
            MAX_UNPACKED_BYTES,
        ):
            origin = Path(place).parent
            folder = folders.setdefault(origin, Path(top, str(len(folders))))
            folder.mkdir(exist_ok=True)
            path = folder / Path(place).name[-60:]
            if path in inside:
                path = folder / f"{len(inside)}-{path.name}"
            path.write_bytes(data)
            inside[path] = data
        scenes = dict.fromkeys(foreign_scenes_among(inside))
        # Of several in a folder none is more than what they name.
        configs = [one for one in inside if one.name.lower().endswith(CONFIGS)]
        number = Counter(one.parent for one in configs)
        named_in = (one for one in configs if number[one.parent] == 1)
        scenes |= dict.fromkeys(one for one in named_in if format_of(one))
        named = {one: name_of_scene(one) for one in inside}
    by_folder: dict[Path, dict[str, Path]] = {}
    alike: dict[tuple[Path, str], list[Path]] = {}
    for one in inside:
        by_folder.setdefault(one.parent, {})[one.name] = one
        if one not in scenes:
            alike.setdefault((one.parent, named[one]), []).append(one)
    endings = {one.suffix for one in inside}
    parts = {
        scene: [
            *alike.get((scene.parent, named[scene]), ()),
            *_mentioned(inside[scene], by_folder[scene.parent], endings),
        ]
        for scene in scenes
    }
    lent = {one for scene, part in parts.items() for one in part if one != scene}
    origins = {folder: origin for origin, folder in folders.items()}
    found: dict[str, dict[str, bytes]] = {}
    own = [scene for scene in scenes if scene not in lent] or list(scenes)
    number = Counter(scene.parent for scene in own)
    for scene in own:
        origin = origins[scene.parent]
        is_alone = number[scene.parent] == 1
        name = origin.name if is_alone and origin.name else named[scene]
        if name in found:
            name = str(origin / scene.name)
        used = by_folder[scene.parent].values() if is_alone else parts[scene]
        found[name] = {one.name: inside[one] for one in (scene, *used)}
    return found


def _mentioned(
    data: bytes, files: Mapping[str, Path], endings: Collection[str]
) -> list[Path]:
    """Those of some files, by name, whose names stand in another one."""
    found: dict[Path, None] = {}
    for ending in endings:
        ends = re.finditer(re.escape(ending.encode()), data)
        for match in itertools.islice(ends, _MOST_MENTIONS):
            before = data[max(match.end() - _NAME_BYTES, 0) : match.end()]
            name = re.split(rb"""[/\\"'<>=]""", before)[-1].decode(errors="replace")
            if name in files:
                found[files[name]] = None
    return list(found)


def _foreign_upload(scenes: Mapping[str, Mapping[str, bytes]]) -> Scenario | None:
    """The one scene of another format than Argoverse 2 in an upload; None: none is."""
    if not scenes:
        return None
    if len(scenes) > 1:
        first, second, *_ = scenes
        raise InputError(
            f"The upload holds {len(scenes)} scenes, such as {first[:60]} and "
            f"{second[:60]}; expected one."
        )
    (part,) = scenes.values()
    with tempfile.TemporaryDirectory() as folder, closed_folder():
        paths = [Path(folder, name) for name in part]
        for path, data in zip(paths, part.values(), strict=True):
            path.write_bytes(data)
        try:
            scenario = read_scene(paths[0])
        except InputError as error:
            told = str(error).replace(str(paths[0]), paths[0].name)
            error.args = (told, *error.args[1:])
            raise
    return scenario.with_origin(source="")


@contextlib.contextmanager
def _as_file(name: str, content: bytes) -> Iterator[Path]:
    """A file of an upload, for readers of paths."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / Path(name).name[-60:]
        path.write_bytes(content)
        yield path


def recipe_of_export(folder: Path) -> Recipe | None:
    """Recipe of what the editor wrote, a folder or a file in it; None for others."""
    path = (folder if folder.is_dir() else folder.parent) / RECIPE_NAME
    if not os.path.isfile(path):
        return None
    try:
        return Recipe.from_text(
            read_regular(path, max_bytes=MAX_RECIPE_BYTES, error=RecipeError)
        )
    except PdEditorError as error:
        _LOG.info("%s is passed over: %s", path, error)
        return None


def with_original(
    scenario: Scenario, recipe: Recipe | None = None, source: str | Path = ""
) -> Scenario:
    """Add to an export what its road was before the warp; others are returned as they are.

    ``recipe`` is that of its files, and ``source`` the place of its base, if they are not
    where it was opened from.

    Raises:
        ExportError: no recipe makes it of what is there.
    """
    if scenario.applied_warp is not None or not scenario.is_warped:
        return scenario
    told, origin = f"{scenario.scenario_id} has no original", scenario.provenance.source
    recipe = recipe or recipe_of_export(Path(origin))
    if recipe is None:
        raise ExportError(f"{told}: its recipe cannot be read.")
    try:
        made = replay(recipe, open_base(recipe.base, source))
    except PdEditorError as error:
        raise ExportError(f"{told}: {error}") from error
    if made.provenance.source != origin:
        made = with_original(made)
    now, then = scenario.time_axis, made.time_axis
    is_same = (now.num_steps, now.current_step) == (then.num_steps, then.current_step)
    if not is_same or not np.allclose(made.origin_city_m, scenario.origin_city_m):
        raise ExportError(f"{told}: that is of other moments or another place.")
    return dataclasses.replace(scenario, applied_warp=made.applied_warp)


def made_by(scenario: Scenario, recipe: Recipe) -> Scenario:
    """Add provenance from its recipe to an opened export.

    A recipe of another scenario is ignored.
    """
    if recipe.result_id != scenario.scenario_id:
        return scenario
    # Some formats have no place for it.
    told = recipe.base.attribution or scenario.provenance.attribution
    notes = dict.fromkeys((*scenario.provenance.notes, *recipe.notes))
    scenario = scenario.with_origin(attribution=told, notes=tuple(notes))
    if not recipe.commands and recipe.base.base is None:
        return scenario
    scenario = scenario.as_referred_to(recipe.base)
    labels = "; ".join(command.label for command in recipe.commands[:MAX_LABELS])
    more = len(recipe.commands) - MAX_LABELS
    labels += f"; and {more} more" if more > 0 else ""
    if labels:
        name = recipe.base.root.scenario_id
        notes[f"Exported from {name} with these edits: {labels}."] = None

    def now(agent_id: str) -> str:
        return recipe.renamed.get(agent_id, agent_id)

    return scenario.with_origin(
        notes=tuple(notes),
        base=recipe.base,
        is_bent=recipe.is_bent,
        edited_ids=frozenset(map(now, recipe.edited_ids)),
        caused_findings=None
        if recipe.caused_findings is None
        else frozenset(
            (kind, tuple(map(now, ids)), where)
            for kind, ids, where in recipe.caused_findings
        ),
        warps=recipe.warps,
        friction_coefficient=recipe.friction_coefficient,
    )


def has_same_content(one: Scenario, other: Scenario) -> bool:
    """Whether two scenarios are equal apart from rounding and their ids."""
    mine, theirs = one.agents, other.agents
    if (mine.ids, mine.kinds, one.focal_id) != (
        theirs.ids,
        theirs.kinds,
        other.focal_id,
    ) or not np.array_equal(mine.is_valid, theirs.is_valid):
        return False
    shift = one.origin_city_m - other.origin_city_m
    gap = np.where(mine.is_valid[..., None], mine.position_m + shift, 0.0)
    gap -= np.where(theirs.is_valid[..., None], theirs.position_m, 0.0)
    lines = one.road_map.polylines, other.road_map.polylines
    if [line.shape for line in lines[0]] != [line.shape for line in lines[1]]:
        return False
    road = np.concatenate(lines[0])[:, :2] + shift - np.concatenate(lines[1])[:, :2]
    return bool(max(np.abs(gap).max(initial=0.0), np.abs(road).max()) < SAME_M)


def exported_files(
    scenario: Scenario,
    recipe: Recipe,
    base: Scenario | None = None,
    format_name: str = ARGOVERSE2.name,
) -> dict[str, bytes]:
    """Files of a folder for a scenario in some format, with its recipe.

    The scenario's id is that of the recipe's variant. With its base, the recipe tells
    which findings edits caused, for who opens the files again.

    Raises:
        ExportError: the scenario cannot be written, for example without a focal agent.
    """
    agents, focal_id = scenario.agents, scenario.focal_id
    row = agents.row_of.get(focal_id)
    if len(agents) and (row is None or not agents.is_valid[row].any()):
        raise ExportError(
            f"Scenario {scenario.scenario_id} has no focal agent ({focal_id or 'none'} is"
            " not there); make an agent the focal one first (on the shell: --focal ID)."
        )
    if base is not None:
        recipe = recipe.judged(scenario, base)
    scenario = dataclasses.replace(
        scenario,
        agents=with_focal_category(agents, focal_id),
        scenario_id=recipe.result_id,
    )
    kind = writer(format_name)
    assert kind.write is not None, "it can be written"
    lacks: tuple[str, ...] = ()
    if kind is PLAYER:
        try:
            scenario = with_original(scenario)
        except ExportError as error:
            lacks = (str(error),)
    written = kind.write(scenario)
    losses = (*written.losses, *lacks)
    recipe = recipe.written_as(written.renamed)
    files = {**written.files, RECIPE_NAME: recipe.to_text().encode()}
    if told := scenario.provenance.attribution:
        files[ATTRIBUTION_NAME] = f"{told}\n".encode()
    if losses:
        head = f"What {kind.title} cannot say of {scenario.scenario_id}:\n"
        lines = "".join(f"- {one}\n" for one in losses)
        files[LOSSES_NAME] = (head + lines).encode()
    return files


def check_free(
    out: str | Path, name: str, scenario: Scenario, *, overwrite: bool = False
) -> None:
    """Raise if ``export_into`` could not write ``out/name``, before the work is done.

    Raises:
        ExportError: the folder is not empty, or is the one that was read.
    """
    files = tracks_name(name), map_name(name)
    check_place(
        Path(out) / name,
        (*files, RECIPE_NAME, ATTRIBUTION_NAME, LOSSES_NAME),
        forbidden=_input_folder(scenario),
        overwrite=overwrite,
    )


def export_into(
    out: str | Path,
    scenario: Scenario,
    recipe: Recipe,
    *,
    base: Scenario | None = None,
    overwrite: bool = False,
    format_name: str = ARGOVERSE2.name,
) -> Path:
    """Write ``out/<id of the result>``; the input is never overwritten.

    Raises:
        ExportError: the folder cannot be written, or holds something else.
    """
    folder = Path(out) / recipe.result_id
    write_files(
        exported_files(scenario, recipe, base, format_name),
        folder,
        forbidden=_input_folder(scenario),
        overwrite=overwrite,
    )
    return folder


def _input_folder(scenario: Scenario) -> Path | None:
    """Folder that a scenario was read from; None if it was uploaded."""
    source = scenario.provenance.source
    if not source:
        return None
    if source.startswith(DEMO_PREFIX):
        return demo_folder(source.removeprefix(DEMO_PREFIX))
    return Path(source)
