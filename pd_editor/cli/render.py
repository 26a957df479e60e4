"""``pd-editor render``: scenes as one page that any browser plays."""

import os
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Annotated

import tyro

from pd_editor.base.errors import EditError, ExportError
from pd_editor.base.regular_file import user_path, write_whole
from pd_editor.cli.export import opened_session
from pd_editor.cli.many_scenes import SCENE_FILES, scenes_of
from pd_editor.cli.options.arguments import CurrentOption, Switch, UntilOption
from pd_editor.cli.output.outcome import Outcome, described
from pd_editor.scene.base_reference import SceneCut
from pd_editor.scene.formats.player import player_page


def render(
    scenarios: Annotated[
        str | Path | tuple[str | Path, ...],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="SCENARIO|RECIPE [...]", help_behavior_hint="(required)"),
    ],
    /,
    *,
    out: Annotated[str | Path, tyro.conf.arg(metavar="FILE")],
    current: CurrentOption = None,
    until: UntilOption = None,
    overwrite: Switch = False,
) -> Outcome:
    """Write scenes as one HTML file that any browser plays, without a network.

    Args:
        scenarios: Demos' names, Argoverse 2 scenario folders, files of other formats, recipe.json files, folders of scenes, or patterns; demos for all demos.
        out: File to write, such as scenes.html.
        current: Seconds of the recording that count as observed; the last of their steps becomes the current one.
        until: Seconds after the current step that are kept, such as 6.
        overwrite: Replace the file.
    """
    several = scenarios if isinstance(scenarios, tuple) else (scenarios,)
    target = user_path(str(out))
    if target.suffix.lower() != ".html":
        raise ExportError(
            f"{target}: is no name of a page; expected one that ends in .html."
        )
    if os.path.exists(target) and not overwrite:
        raise ExportError(f"{target}: is there already; add --overwrite to replace it.")
    named = (scenes_of(str(one), SCENE_FILES, target) for one in several)
    cut = SceneCut(current_s=current, until_s=until)
    sessions = [
        opened_session(one, described(""), cut)
        for one in dict.fromkeys(chain.from_iterable(named))
    ]
    found = tuple(replace(one.scenario, scenario_id=one.name) for one in sessions)
    if not found:
        raise EditError("Missing SCENARIO; see pd-editor render --help.")
    page = player_page(found)
    write_whole(target, page)
    count = f"{len(found)} scene{'s' * (len(found) != 1)}"
    return Outcome(
        folders=(target,),
        scenarios=found,
        remarks=(f"{count}, {len(page) / 1e6:.2f} MB.",),
    )
