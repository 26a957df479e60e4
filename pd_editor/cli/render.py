"""``pd-editor render``: scenes as a page that plays them, a film, or a figure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, Final

from pd_editor.base.errors import EditError, ExportError, PdEditorError
from pd_editor.base.plain_text import number_of
from pd_editor.base.regular_file import user_path, write_whole
from pd_editor.cli.export import opened_session
from pd_editor.cli.many_scenes import all_scenes
from pd_editor.cli.options import (
    CutOptions,
    ResultOptions,
    SeveralScenarios,
    Switch,
    shown,
    taking,
)
from pd_editor.cli.output import (
    Outcome,
    ProgressLine,
    described,
    read_plans,
    refuse_existing,
)
from pd_editor.editor.scenario_store import with_original
from pd_editor.scene.base_reference import SceneCut
from pd_editor.scene.bundle import RECIPE_NAME
from pd_editor.scene.formats.figure import FigureLook
from pd_editor.scene.formats.film import FilmLook
from pd_editor.scene.formats.pictures import LOOKS, picture
from pd_editor.scene.formats.player import player_page
from pd_editor.scene.scenario import Scenario

_FIELDS: Final = {
    "at": "at_s",
    "compare": "compares",
    "names": "has_names",
    "width": "width_mm",
    "height": "height_px",
    "follow": "follow",
    "radius": "radius_m",
}
"""Names of options in the looks of films and figures."""


@dataclass(frozen=True, kw_only=True)
class RenderOptions(CutOptions, ResultOptions):
    """Options of ``pd-editor render``.

    Args:
        scenarios: Demos' names, Argoverse 2 scenario folders, files of other formats, recipe.json files, folders of scenes, or patterns; demos for all demos. Films and figures take one, pd-editor convert --to mp4 many.
        out: File to write: .html plays, .mp4, .webm and .gif are films (with the plans of pd-editor drive), .pdf, .svg and .png figures.
        at: Moments of a figure side by side, in seconds after the current step.
        compare: Draw above a figure the scene before its recipe warped the road; in a page, two scenes side by side on one clock.
        names: Write agents' ids into a figure.
        width: Width of a figure in millimetres.
        height: Height of a film in pixels.
        follow: Id of the agent that stays in the middle of a film or figure.
        radius: Metres from the middle of a film or figure to its upper edge.
        overwrite: Replace the file.
    """

    scenarios: SeveralScenarios = field(kw_only=False)
    out: Annotated[str | Path, shown("FILE")]
    at: Annotated[tuple[float, ...], shown("S [S ...]", "(default: 0)")] = ()
    compare: Switch = False
    names: Switch = False
    width: Annotated[float | None, shown("MM", "(default: 180)")] = None
    height: Annotated[int | None, shown("PX", "(default: 1080; a GIF: 480)")] = None
    follow: Annotated[str, shown("ID", "(optional)")] = ""
    radius: Annotated[float | None, shown("M", "(default: 40)")] = None


@taking(RenderOptions)
def render(options: RenderOptions) -> Outcome:
    """Write scenes as an HTML page that plays offline, or one as a film or a figure."""
    target = user_path(str(options.out))
    is_pair = options.compare and target.suffix.lower() == ".html"
    asked = {name: getattr(options, name) for name in _FIELDS}
    asked["compare"] = options.compare and not is_pair
    look = _look(target, {name: one for name, one in asked.items() if one})
    refuse_existing(target, overwrite=options.overwrite)
    references = all_scenes(options.scenarios, target)
    sessions = [opened_session(one, described(""), options.cut) for one in references]
    found = tuple(replace(one.scenario, scenario_id=one.name) for one in sessions)
    lacks: tuple[str, ...] = ()
    if not found:
        raise EditError("Missing SCENARIO; see pd-editor render --help.")
    if is_pair and len(found) != 2:
        raise ExportError(
            f"{target}: --compare shows two scenes side by side, not {len(found)}."
        )
    if asked["compare"] or look is None:
        found, lacks = zip(*map(_with_original, found), strict=True)
        if asked["compare"] and lacks[0]:
            raise ExportError(lacks[0])
    if isinstance(look, FilmLook) and options.cut == SceneCut():
        # A cut counts its steps anew.
        folder = user_path(references[0]).resolve()
        folder = folder.parent if folder.name == RECIPE_NAME else folder
        look = replace(look, plans=read_plans(folder, found[0]))
    content = _content(found, target, look, is_pair=is_pair)
    write_whole(target, content)
    count = number_of(len(found), "scene")
    return Outcome(
        folders=(target,),
        scenarios=found,
        remarks=(f"{count}, {len(content) / 1e6:.2f} MB.", *filter(None, lacks)),
    )


def _with_original(scenario: Scenario) -> tuple[Scenario, str]:
    """An export with what it was before the warp, and why it does not tell that."""
    try:
        return with_original(scenario), ""
    except PdEditorError as error:
        return scenario, str(error)


def _content(
    scenarios: Sequence[Scenario],
    target: Path,
    look: FigureLook | FilmLook | None,
    *,
    is_pair: bool,
) -> bytes:
    if look is None:
        return player_page(scenarios, is_pair=is_pair)
    scenario, *others = scenarios
    ending = target.suffix.lower().removeprefix(".")
    if others:
        raise ExportError(
            f"{target}: shows one scene, not {len(scenarios)}; pd-editor convert --to "
            f"{ending} writes one file for each."
        )
    line, told = ProgressLine(), "{} of {} frames".format
    content = picture(scenario, ending, look, lambda *now: line.show(told(*now)))
    line.clear()
    return content


def _look(target: Path, asked: Mapping[str, Any]) -> FigureLook | FilmLook | None:
    """How a film or figure is to look; None: the file is a page.

    Raises:
        ExportError: the file's ending is of no kind, or its kind has no such option.
    """
    ending = target.suffix.lower().removeprefix(".")
    if ending not in ("html", *LOOKS):
        raise ExportError(
            f"{target}: is no page, film or figure; expected a name that ends in .html, "
            f".{', .'.join(LOOKS)}."
        )
    look = LOOKS.get(ending)
    known = {one.name for one in fields(look)} if look is not None else set()
    named = {_FIELDS[name]: one for name, one in asked.items()}
    for option, name in zip(asked, named, strict=True):
        if name not in known:
            raise ExportError(f"--{option}: a file .{ending} has no such option.")
    return None if look is None else replace(look, **named)
