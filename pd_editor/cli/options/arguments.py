"""Options that several commands share, and how a command takes a class of options."""

import functools
import inspect
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ParamSpec, TypeVar

import tyro

if TYPE_CHECKING:
    from pd_editor.scene.base_reference import MapWindow, SceneCut

One = TypeVar("One", str, Path, str | Path)
Fields = ParamSpec("Fields")
Options = TypeVar("Options")
Made = TypeVar("Made")


def shown(metavar: str | None, hint: str | None = None, name: str | None = None) -> Any:
    """How the shell shows an option: its value, and a remark in brackets."""
    return tyro.conf.arg(metavar=metavar, help_behavior_hint=hint, name=name)


ScenarioArgument = Annotated[str | Path, tyro.conf.Positional, shown("SCENARIO")]
SeveralScenarios = Annotated[
    str | Path | tuple[str | Path, ...],
    tyro.conf.Positional,
    shown("SCENARIO|RECIPE [...]", "(required)"),
]
FormatOption = Annotated[
    str,
    shown("FORMAT", "(av2, commonroad, opendrive, player, scenarionet, tables ...)"),
]
FolderOption = Annotated[str | Path, shown("DIR")]
Folders = Annotated[str | Path | tuple[str | Path, ...], shown("DIR [DIR ...]")]
OptionalFolder = Annotated[Path | None, shown("DIR", "(optional)")]
OptionalFolders = Annotated[
    str | Path | tuple[str | Path, ...], shown("DIR [DIR ...]", "(optional)")
]
NameOption = Annotated[str, shown("NAME", "(default: says the edits)")]
TagsOption = Annotated[tuple[str, ...], shown("TAG [TAG ...]", "")]
NoteOption = Annotated[str, shown("TEXT", "")]
FocalOption = Annotated[str, shown("ID", "(default: the scenario's)")]
Number = Annotated[int, shown("N")]
OptionalWorkers = Annotated[int | None, shown("N", "(default: this process)")]
Switch = Annotated[bool, tyro.conf.FlagCreatePairsOff, shown(None, "")]


def taking(
    options: Callable[Fields, Options],
) -> Callable[[Callable[[Options], Made]], Callable[Fields, Made]]:
    """Let a command take the fields of a class, in Python and on the shell.

    Its own come first, then those of each base; what has to be given before the rest.
    The ``Args`` of its class, or of a later one, say what a field means.
    """

    def of(command: Callable[[Options], Made]) -> Callable[Fields, Made]:
        @functools.wraps(command)
        def run(*values: Fields.args, **named: Fields.kwargs) -> Made:
            return command(options(*values, **named))

        _describe(run, options)
        return run

    return of


def _describe(run: Any, options: Any) -> None:
    """Give a function the fields of a class as parameters, and their documentation."""
    ordered = _parameters(options)
    told: dict[str, str] = {}
    for one in reversed(options.__mro__):
        lines = inspect.cleandoc(one.__doc__ or "").partition("Args:\n")[2].splitlines()
        told |= {line.strip().partition(":")[0]: line for line in lines}
    lines = (told[one.name] for one in ordered)
    del run.__wrapped__
    run.__doc__ = "\n".join([inspect.cleandoc(run.__doc__), "", "Args:", *lines])
    run.__signature__ = inspect.Signature(ordered)
    run.__annotations__ = {one.name: one.annotation for one in ordered}


def _parameters(options: Any) -> list[inspect.Parameter]:
    """Fields of a class; options come last, of them those that need not be given."""
    parameters = inspect.signature(options).parameters
    names = dict.fromkeys(inspect.get_annotations(options))
    for base in options.__bases__:
        names |= getattr(base, "__dataclass_fields__", {})
    return sorted(
        (parameters[one] for one in names),
        key=lambda one: (one.kind, one.default is not one.empty),
    )


def command_line(command: str, options: Any) -> str:
    """The line of the shell that has these options, those by default among them."""
    words = ["pd-editor", command]
    for one in _parameters(type(options)):
        value, option = getattr(options, one.name), one.name.replace("_", "-")
        if isinstance(value, bool):
            given = f"--{option}" if value else f"--no-{option}"
            words += [given] * (value != one.default)
        elif value not in (None, "", ()):
            if isinstance(value, Mapping):
                value = tuple(
                    f"{name}={getattr(each, 'name', each)}"
                    for name, each in value.items()
                )
            values = value if isinstance(value, tuple | list) else (value,)
            words += [f"--{option}"] * (one.kind is one.KEYWORD_ONLY)
            words += (str(getattr(each, "name", each)) for each in values)
    return shlex.join(words)


@dataclass(frozen=True, kw_only=True)
class ResultOptions:
    """Where a command writes.

    Args:
        out: Folder that receives DIR/<name>/.
        overwrite: Replace what an earlier run wrote.
    """

    out: FolderOption
    overwrite: Switch = False


@dataclass(frozen=True, kw_only=True)
class CutOptions:
    """What is used of a recording.

    Args:
        current: Seconds of the recording that count as observed; the last of their steps becomes the current one.
        until: Seconds after the current step that are kept, such as 6.
    """

    current: Annotated[float | None, shown("S", "(default: the file's)")] = None
    until: Annotated[float | None, shown("S", "(default: all)")] = None

    @property
    def cut(self) -> "SceneCut":
        """What is used of a recording and its map."""
        from pd_editor.scene.base_reference import SceneCut

        return SceneCut(current_s=self.current, until_s=self.until)


@dataclass(frozen=True, kw_only=True)
class WindowOptions:
    """What is used of a map.

    Args:
        around: Metres in the file's frame, about which a square of its map is used; for maps beyond the limits of a scene.
        radius: Half the side of that square.
    """

    around: Annotated[
        tuple[float, float] | None, shown("X Y", "(default: the whole map)")
    ] = None
    radius: Annotated[float | None, shown("M", "(default: 150)")] = None

    @property
    def window(self) -> "MapWindow | None":
        """The square; None: all of the map."""
        from pd_editor.scene.map_window import window_of

        return window_of(self.around, self.radius)


@dataclass(frozen=True, kw_only=True)
class PartOptions(WindowOptions, CutOptions):
    """What is used of a recording and its map."""

    @property
    def cut(self) -> "SceneCut":
        """What is used of a recording and its map."""
        return replace(super().cut, window=self.window)


def folders(value: str | Path | tuple[str | Path, ...]) -> tuple[Path, ...]:
    """Convert one folder or several to a tuple without duplicates."""
    return several(tuple(map(Path, several(value))))


def several(value: One | tuple[One, ...]) -> tuple[One, ...]:
    """Convert one value or several to a tuple without duplicates."""
    return (value,) if isinstance(value, str | Path) else tuple(dict.fromkeys(value))
