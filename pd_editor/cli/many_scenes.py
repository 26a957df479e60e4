"""Runs a command of one scene on many: in this process, on several, or on Ray."""

import fnmatch
import functools
import glob
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from importlib import import_module
from itertools import chain
from pathlib import Path
from secrets import token_hex
from typing import Annotated, Any, Final, ParamSpec, TypeVar

import tyro

from pd_editor.base.errors import EditError, FolderInUseError, InputError
from pd_editor.base.installed_files import ALL_DEMOS, demo_names
from pd_editor.base.regular_file import check_path, folders_below
from pd_editor.cli.options import (
    OptionalWorkers,
    PartOptions,
    ResultOptions,
    WindowOptions,
    several,
    shown,
    taking,
)
from pd_editor.cli.output import Outcome, work_shown
from pd_editor.editor.scenario_store import (
    foreign_scenes,
    lanes_of_file,
    open_scenario,
    read_once,
)
from pd_editor.editor.variant import short_id
from pd_editor.experiments.work_engine.ray_cluster import EngineChoice, EngineName
from pd_editor.experiments.work_engine.work_engine import (
    InThisProcess,
    WorkEngine,
    run_items,
)
from pd_editor.scene.base_reference import MapWindow
from pd_editor.scene.formats.registry import has_foreign_ending, is_foreign_scene
from pd_editor.scene.scene_cut import densest_windows, window_of

Fields = ParamSpec("Fields")
Many = TypeVar("Many", bound="ManyOptions")
Scenes = str | Path | tuple[str | Path, ...]
SCENE_FILES: Final = "scenario_*.parquet"
"""Pattern of the file that makes a folder a scene."""
MOST_WINDOWS: Final = 1000


@dataclass(frozen=True, kw_only=True)
class EngineOptions:
    """Where many items of work run.

    Args:
        engine: Processes of this machine, or Ray (extra "cluster").
        address: Address of a Ray cluster, such as auto or head:6379; a new one on this machine unless given.
        workers: Work items that run at a time; they do not change the numbers.
    """

    engine: EngineName = "local"
    address: Annotated[str | None, shown("ADDRESS", "(default: this machine)")] = None
    workers: Annotated[int | None, shown("N", "(default: cores)")] = None

    @property
    def choice(self) -> EngineChoice:
        """The engine; raises as its constructor does."""
        return EngineChoice(
            name=self.engine, address=self.address, num_workers=self.workers
        )


@dataclass(frozen=True, kw_only=True)
class ManyOptions(EngineOptions, ResultOptions):
    """Options of a command of one scene that takes several.

    Args:
        scenario: Demos, Argoverse 2 scenario folders, files of other formats, folders of these, or patterns; demos for all demos. What is written already stays as it is.
        engine: Processes of this machine, or Ray (extra "cluster"), for several scenes.
        workers: Scenes at a time, each in a process of its own; they do not change the results.
    """

    scenario: Annotated[
        Scenes, tyro.conf.Positional, shown("SCENARIO [...]", "(required)")
    ] = field(kw_only=False)
    workers: OptionalWorkers = None


@dataclass(frozen=True, kw_only=True)
class WindowsOptions(WindowOptions):
    """What is used of maps.

    Args:
        densest: Use the N squares with the greatest length of lanes, each as a scene of its own.
    """

    densest: Annotated[int | None, shown("N", "(optional)")] = None

    def windows(self, scene: str | Path) -> tuple[MapWindow | None, ...]:
        """The parts of a scene's map; None is all of it.

        Raises:
            InputError: an option is out of range, or the scene cannot be read.
        """
        if self.densest is None:
            return (self.window,)
        if self.around is not None:
            raise InputError("--around and --densest exclude each other.")
        window = window_of((0.0, 0.0), self.radius)
        assert window is not None, "it is around a place"
        if not isinstance(self.densest, int) or not 1 <= self.densest <= MOST_WINDOWS:
            raise InputError(
                f"--densest is {self.densest}; expected 1 to {MOST_WINDOWS}."
            )
        lanes = lanes_of_file(functools.partial(open_scenario, scene))
        return densest_windows(lanes, self.densest, window.radius_m)


@dataclass(frozen=True, kw_only=True)
class PartsOptions(WindowsOptions, PartOptions):
    """What is used of recordings and their maps."""


def over_scenes(
    options: Callable[Fields, Many],
    files: str = SCENE_FILES,
    noun: str = "SCENARIO",
    finish: Callable[[Outcome, Many], Outcome] = lambda outcome, _options: outcome,
) -> Callable[[Callable[[str, Many], Outcome]], Callable[Fields, Outcome]]:
    """Let a command of one scene take several, folders of scenes, and patterns.

    What an earlier run wrote is left alone, and an error of one scene does not stop the
    others.

    Args:
        options: class of the command's options.
        files: pattern of the file that makes a folder one scene.
        noun: what the shell calls a scene.
        finish: adds a report of all scenes to the outcome.
    """

    def of_many(command: Callable[[str, Many], Outcome]) -> Callable[Fields, Outcome]:
        name = command.__name__

        @functools.wraps(command)
        def run(asked: Many) -> Outcome:
            choice, out = asked.choice, Path(os.path.abspath(str(asked.out)))
            found = all_scenes(asked.scenario, out, files)
            if not found:
                raise InputError(f"Missing {noun}; see pd-editor {name} --help.")
            has_parts = getattr(asked, "densest", None) is not None
            # Of a run within one, such as of one window, it is that of the whole.
            this_run = token_hex(8) if has_parts else ""
            with read_once(this_run) if this_run else nullcontext():
                items = (
                    _windows(found, asked)
                    if has_parts
                    else {one: replace(asked, scenario=one) for one in found}
                )
                if len(items) == 1:
                    (one,) = items.values()
                    made = command(str(one.scenario), one)
                else:
                    made = _run_all(name, items, asked, choice, this_run)
            return finish(made, asked)

        taken = taking(options)(run)
        taken.of_one = command  # type: ignore[attr-defined]
        return taken

    return of_many


def all_scenes(
    references: Scenes, out: Path, files: str = SCENE_FILES
) -> tuple[str, ...]:
    """Scenes of patterns, of all demos and of folders, each once, without results."""
    asked = tuple(map(str, several(references)))
    # The shell expands out/* to the tables beside the scenes, too.
    scenes = [one for one in asked if not _is_beside_scenes(one)] or asked
    named = (_scenes_of(one, files, out) for one in scenes)
    return tuple(dict.fromkeys(chain.from_iterable(named)))


def engine_of(choice: EngineChoice) -> AbstractContextManager[WorkEngine]:
    """An engine for scenes, which uses no other process unless that is asked for."""
    is_here = choice.name == "local" and choice.num_workers is None
    return nullcontext(InThisProcess()) if is_here else choice.engine()


def _scenes_of(reference: str, files: str, out: Path) -> list[str]:
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
    found = [
        scene
        for match in map(Path, matches)
        if not _is_beside_scenes(str(match))
        for scene in (
            [
                *sorted(
                    Path(place)
                    for place, _, names in folders_below(match)
                    if fnmatch.filter(names, files)
                ),
                *(foreign_scenes(match) if takes_foreign else ()),
            ]
            if match.is_dir()
            else [match]
        )
    ]
    outside = [
        one for one in found if not Path(os.path.abspath(one)).is_relative_to(out)
    ]
    if found and not outside:
        raise InputError(
            f"{reference}: all scenes there are in {out}, which gets the results; "
            "expected another folder for these."
        )
    if not found:
        what = (
            "scene of a format that is read"
            if takes_foreign
            else f"folder with {files}"
        )
        raise InputError(f"{reference}: no {what} is there or below it.")
    return list(map(str, outside))


def _is_beside_scenes(path: str) -> bool:
    """Whether a file is a table, page or index that commands write beside scenes."""
    return (
        path.endswith((".csv", ".html", ".md", ".index.parquet"))
        and not has_foreign_ending(path)
        and os.path.isfile(path)
    )


def _windows(scenes: Sequence[str], asked: Any) -> dict[str, Any]:
    """The densest parts of each scene, by names that say where they are."""
    return {
        f"{scene} around {one.x_m:g} {one.y_m:g}": replace(
            asked,
            scenario=scene,
            around=(one.x_m, one.y_m),
            radius=one.radius_m,
            densest=None,
        )
        for scene in scenes
        for one in asked.windows(scene)
    }


def _run_all(
    command: str,
    items: Mapping[str, Many],
    asked: Many,
    choice: EngineChoice,
    this_run: str,
) -> Outcome:
    """Call a command on every scene, or part of one."""
    scenes = list(items)
    if getattr(asked, "name", ""):
        raise EditError(
            f"--name is for one scenario; {len(scenes)} were given, which are named by "
            "their edits."
        )
    done: dict[str, Outcome] = {}
    with engine_of(choice) as engine:
        failures = run_items(
            engine,
            functools.partial(_outcome, command, this_run),
            items,
            on_value=done.__setitem__,
            on_progress=work_shown("scenes"),
            harmless=FolderInUseError.__name__,
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


def _outcome(command: str, this_run: str, options: ManyOptions) -> Outcome:
    """Call a command on a scene; scenarios are left out, since they may be many."""
    module = import_module(f"{__package__}.{command}")
    with read_once(this_run):
        made = getattr(module, command).of_one(options.scenario, options)
    return replace(made, scenarios=())
