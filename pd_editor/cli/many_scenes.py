"""Runs a command of one scene on many: in this process, on several, or on Ray."""

import functools
import glob
import inspect
import os
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import replace
from importlib import import_module
from itertools import chain
from pathlib import Path
from secrets import token_hex
from typing import Annotated, Any, Concatenate, Final, ParamSpec

import tyro

from pd_editor.base.errors import EditError, FolderInUseError, InputError
from pd_editor.base.installed_files import ALL_DEMOS, demo_names
from pd_editor.base.regular_file import check_path
from pd_editor.cli.output.outcome import Outcome
from pd_editor.cli.output.progress import work_shown
from pd_editor.editor.scenario_store import (
    foreign_scenes,
    lanes_of_file,
    open_scenario,
    read_once,
)
from pd_editor.editor.variant import short_id
from pd_editor.experiments.work_engine import EngineChoice, InThisProcess, run_items
from pd_editor.scene.formats.registry import is_foreign_scene
from pd_editor.scene.map_window import densest_windows, window_of

Options = ParamSpec("Options")
Scenes = str | Path | tuple[str | Path, ...]
SCENE_FILES: Final = "scenario_*.parquet"
"""Pattern of the file that makes a folder a scene."""
MOST_WINDOWS: Final = 1000
Finish = Callable[[Outcome, tuple[str, ...], Mapping[str, Any]], Outcome]
_Item = tuple[str, dict[str, Any]]
"""A scene, and options of its own."""


def over_scenes(
    files: str,
    finish: Finish = lambda outcome, _scenes, _options: outcome,
) -> Callable[
    [Callable[Concatenate[str | Path, Options], Outcome]],
    Callable[Concatenate[Scenes, Options], Outcome],
]:
    """Let a command of one scene take several, folders of scenes, and patterns.

    What an earlier run wrote is left alone, and an error of one scene does not stop the
    others. The command has the options ``out``, ``name`` and ``overwrite``; its
    ``engine``, ``address`` and ``workers`` are read here alone.

    Args:
        files: pattern of the file that makes a folder one scene.
        finish: adds a report of all scenes, which are given as named, to the outcome.
    """

    def of_many(
        command: Callable[Concatenate[str | Path, Options], Outcome],
    ) -> Callable[Concatenate[Scenes, Options], Outcome]:
        signature = inspect.signature(command)
        name, noun = command.__name__, next(iter(signature.parameters)).upper()

        @functools.wraps(command)
        def run(
            scenes: Scenes, /, *values: Options.args, **options: Options.kwargs
        ) -> Outcome:
            several = scenes if isinstance(scenes, tuple) else (scenes,)
            out = Path(os.path.abspath(str(options.get("out"))))
            named = [scenes_of(str(one), files, out) for one in several]
            found = list(dict.fromkeys(chain.from_iterable(named)))
            if not found:
                raise InputError(f"Missing {noun}; see pd-editor {name} --help.")
            items: dict[str, _Item] = {one: (one, {}) for one in found}
            asked = dict(options)
            densest = options.pop("densest", None)
            # Of a run within one, such as of one window, it is that of the whole.
            this_run = "" if densest is None else token_hex(8)
            with read_once(this_run) if this_run else nullcontext():
                if this_run:
                    items = _windows(found, densest, options)
                if len(items) == 1:
                    ((scene, own),) = items.values()
                    options.update(own)
                    made = command(scene, *values, **options)
                else:
                    made = _run_all(name, items, options, this_run)
            return finish(made, tuple(map(str, several)), asked)

        run.of_one = command  # type: ignore[attr-defined]
        _take_several(run, signature, noun)
        return run

    return of_many


def _take_several(run: Any, signature: inspect.Signature, noun: str) -> None:
    """Tell the shell that the first parameter of a function takes several scenes."""
    first, *others = signature.parameters.values()
    del run.__wrapped__
    words = tyro.conf.arg(metavar=f"{noun} [...]", help_behavior_hint="(required)")
    several = Annotated[Scenes, tyro.conf.Positional, words]
    first = first.replace(annotation=several)
    run.__signature__ = signature.replace(parameters=[first, *others])
    run.__annotations__ = {**run.__annotations__, first.name: several}


def scenes_of(reference: str, files: str, out: Path) -> list[str]:
    """Scenes of a pattern, of all demos or of a folder, without results; else itself."""
    if reference == ALL_DEMOS:
        return list(demo_names())
    check_path(reference)
    path = os.path.expanduser(reference)
    takes_foreign = files == SCENE_FILES
    if os.path.exists(path):
        matches = [path]
        if (
            not os.path.isdir(path)
            or glob.glob(files, root_dir=path)
            or (takes_foreign and is_foreign_scene(Path(path)))
        ):
            return [reference]
    elif glob.has_magic(path):
        matches = sorted(glob.glob(path))
    else:
        return [reference]
    inside = [
        scene
        for match in map(Path, matches)
        for scene in (
            [
                *sorted({file.parent for file in match.glob(f"**/{files}")}),
                *(foreign_scenes(match) if takes_foreign else ()),
            ]
            if match.is_dir()
            else [match]
        )
        if not Path(os.path.abspath(scene)).is_relative_to(out)
    ]
    if not inside:
        raise InputError(f"{reference}: no folder with {files} is there or below it.")
    return list(map(str, inside))


def _windows(
    scenes: list[str], count: object, options: dict[str, Any]
) -> dict[str, _Item]:
    """The densest parts of each scene, by names that say where they are."""
    window = window_of((0.0, 0.0), options.pop("radius", None))
    assert window is not None, "it is around a place"
    if options.pop("around", None) is not None:
        raise InputError("--around and --densest exclude each other.")
    if not isinstance(count, int) or not 1 <= count <= MOST_WINDOWS:
        raise InputError(f"--densest is {count}; expected 1 to {MOST_WINDOWS}.")
    found: dict[str, _Item] = {}
    for scene in scenes:
        lanes = lanes_of_file(functools.partial(open_scenario, scene))
        for one in densest_windows(lanes, count, window.radius_m):
            around = {"around": (one.x_m, one.y_m), "radius": one.radius_m}
            found[f"{scene} around {one.x_m:g} {one.y_m:g}"] = scene, around
    return found


def _run_all(
    command: str, items: Mapping[str, _Item], options: dict[str, Any], this_run: str
) -> Outcome:
    """Call a command on every scene, or part of one."""
    scenes = list(items)
    if options.get("name"):
        raise EditError(
            f"--name is for one scenario; {len(scenes)} were given, which are named by "
            "their edits."
        )
    workers, name = options.pop("workers", None), options.pop("engine", "local")
    choice = EngineChoice(
        name=name, address=options.pop("address", None), num_workers=workers
    )
    is_here = name == "local" and workers is None
    done: dict[str, Outcome] = {}
    with nullcontext(InThisProcess()) if is_here else choice.engine() as engine:
        failures = run_items(
            engine,
            functools.partial(_outcome, command, options, this_run),
            items,
            on_value=done.__setitem__,
            on_progress=work_shown("scenes"),
        )
    # Scenes whose short ids are equal have results of one name.
    alike = Counter(short_id(Path(one).name) for one in scenes)
    there = {
        one
        for one, failure in failures.items()
        if failure.error == FolderInUseError.__name__
        and alike[short_id(Path(one).name)] == 1
    }
    outcomes = [(one, done[one]) for one in scenes if one in done]
    remarks = [f"{one}: {remark}" for one, own in outcomes for remark in own.remarks]
    if there:
        remarks.append(
            f"{len(there)} of {len(scenes)} scenes were done before and stay as they "
            "are; add --overwrite to do them anew."
        )
    return Outcome(
        folders=tuple(folder for _, own in outcomes for folder in own.folders),
        scenarios=(),
        remarks=tuple(remarks),
        records=tuple(record for _, own in outcomes for record in own.records),
        failures={
            one: failures[one] for one in scenes if one in failures and one not in there
        },
    )


def _outcome(
    command: str, options: Mapping[str, Any], this_run: str, item: _Item
) -> Outcome:
    """Call a command on a scene; scenarios are left out, since they may be many."""
    module = import_module(f"{__package__}.{command}")
    scene, own = item
    with read_once(this_run):
        made = getattr(module, command).of_one(scene, **options, **own)
    return replace(made, scenarios=())
