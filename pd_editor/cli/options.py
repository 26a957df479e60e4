"""Options that several commands share: how a command takes a class of options, and --guide.

A guidance term is KIND:FIELD=VALUE,FIELD=VALUE, such as ``goal-point:agent=12,point=3.5/10``.
Points are X/Y in metres of the scene frame; several values are joined by +.
"""

import functools
import inspect
import json
import math
import shlex
import types
import typing
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, ParamSpec, TypeVar

import tyro

from pd_editor.analysis.guidance.kinds import KINDS
from pd_editor.base.errors import GenerationError, InputError, PdEditorError
from pd_editor.base.plain_text import nearest_or_all, one_line
from pd_editor.base.regular_file import read_regular
from pd_editor.editor.commands import AddGuidance, Command, SampleSignals, SetLocks
from pd_editor.editor.commands.json_values import from_json
from pd_editor.scene.agent_kind import ROAD_USER_KINDS, AgentKind
from pd_editor.scene.generation import Region
from pd_editor.scene.guidance_terms import MAX_TERMS, GuidanceTerm, PairGuidance
from pd_editor.scene.locks import MAX_KEPT_S, STATE_LOCK, TRAJECTORY_LOCK, Lock
from pd_editor.scene.roles.traffic_choice import agent_ids_of_kinds, drivable_agent_ids
from pd_editor.scene.scenario import Scenario

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
FormatOption = Annotated[str, shown("FORMAT")]
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
                value = tuple(f"{id_}={_word(each)}" for id_, each in value.items())
            values = value if isinstance(value, tuple | list) else (value,)
            words += [f"--{option}"] * (one.kind is one.KEYWORD_ONLY)
            words += map(_word, values)
    return shlex.join(words)


def _word(value: object) -> str:
    """A value as the shell takes it; of an object of Python that it is one."""
    if isinstance(value, str | Path | int | float):
        return str(value)
    return f"<{getattr(value, 'name', value)}, an object of Python>"


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
        from pd_editor.scene.scene_cut import window_of

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


MAX_FILE_BYTES: Final = 2**20
_UNITS: Final = ("_mps2", "_mps", "_m", "_s", "_id")
_OWN_NAMES: Final = {"agent_ids": "agents", "lane_ids": "lanes"}
_NOTHING: Final = "-"
"""Stands for a value that is not given, among several."""
_HIDDEN: Final = {"is_on"}


def guidance_terms_of(texts: Sequence[str]) -> tuple[GuidanceTerm, ...]:
    """Terms of texts, or of JSON files with a list of terms.

    Raises:
        InputError: a text cannot be read; the sentence names the nearest valid name.
    """
    terms: list[GuidanceTerm] = []
    for text in texts:
        terms += _of_file(Path(text)) if text.endswith(".json") else [_of_text(text)]
    if len(terms) > MAX_TERMS:
        raise InputError(f"--guide: {len(terms)} terms; at most {MAX_TERMS} are taken.")
    return tuple(terms)


def text_of(term: PairGuidance) -> str:
    """The text of a term on two agents; values by default are left out."""
    told = [
        f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}"
        for name, one in field_names(term.kind).items()
        if (value := getattr(term, one.name)) != one.default
    ]
    return f"{term.kind}:{','.join(told)}"


def field_names(kind: str) -> dict[str, Any]:
    """Fields of a kind by their names on the shell."""
    found: dict[str, Any] = {}
    for one in fields(KINDS[kind].value):
        if one.name not in _HIDDEN:
            name = _OWN_NAMES.get(one.name, one.name)
            for unit in _UNITS:
                name = name.removesuffix(unit)
            found[name.replace("_", "-")] = one
    return found


def _of_file(path: Path) -> list[GuidanceTerm]:
    where = f"--guide {one_line(str(path))}"
    raw = read_regular(path, max_bytes=MAX_FILE_BYTES, error=InputError)
    try:
        data = json.loads(raw)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: is not valid JSON.") from error
    listed = data if isinstance(data, list) else [data]
    return [
        _built(item, f"{where}, term {number}")
        for number, item in enumerate(listed, start=1)
    ]


def _of_text(text: str) -> GuidanceTerm:
    kind, _, rest = text.partition(":")
    if kind not in KINDS:
        raise InputError(
            f"--guide: there is no kind {one_line(kind)!r}; "
            f"{nearest_or_all(kind, KINDS)}."
        )
    names = field_names(kind)
    hints = typing.get_type_hints(KINDS[kind].value)
    data: dict[str, Any] = {"kind": kind}
    for part in rest.split(",") if rest else ():
        name, equals, value = part.partition("=")
        if name not in names:
            raise InputError(
                f"--guide {kind}: there is no field {one_line(name)!r}; "
                f"{nearest_or_all(name, names)}."
            )
        field = names[name]
        if not equals or not value:
            raise InputError(
                f"--guide {kind}: {name} lacks its value; expected {_form(name, hints[field.name])}."
            )
        if field.name in data:
            raise InputError(
                f"--guide {kind}: {name} is given twice; join several values by +."
            )
        data[field.name] = _value(hints[field.name], value, f"--guide {kind}: {name}")
    for name, field in names.items():
        is_needed = field.default is MISSING and field.default_factory is MISSING
        if is_needed and field.name not in data:
            raise InputError(
                f"--guide {kind}: give {_form(name, hints[field.name])} as well."
            )
    return _built(data, f"--guide {kind}")


def _built(data: Any, where: str) -> GuidanceTerm:
    try:
        return from_json(GuidanceTerm, data, where)
    except PdEditorError as error:
        raise InputError(str(error)) from error


def _value(hint: Any, text: str, where: str) -> Any:
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        (inner,) = (arg for arg in args if arg is not type(None))
        return None if text == _NOTHING else _value(inner, text, where)
    if hint is float:
        return _number(text, where)
    if hint is int:
        if not text.removeprefix("-").isdecimal():
            raise InputError(f"{where} is {one_line(text)!r}; expected a whole number.")
        return int(text)
    if origin is tuple:
        if args == (float, float):
            parts = text.split("/")
            if len(parts) != 2:
                raise InputError(
                    f"{where} is {one_line(text)!r}; expected X/Y in metres."
                )
            return [_number(part, where) for part in parts]
        parts = text.split("+")
        if Ellipsis not in args and len(parts) != len(args):
            raise InputError(
                f"{where} is {one_line(text)!r}; expected {len(args)} points, X/Y+X/Y."
            )
        return [_value(args[0], part, where) for part in parts]
    return text


def _number(text: str, where: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise InputError(
            f"{where} is {one_line(text)!r}; expected a number."
        ) from error


def _form(name: str, hint: Any) -> str:
    """How a field is written."""
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return _form(name, args[0])
    if origin is typing.Literal:
        return f"{name}={' or '.join(args)}"
    if origin is not tuple:
        return f"{name}={'ID' if hint is str else 'NUMBER'}"
    if args == (float, float):
        return f"{name}=X/Y"
    one = "X/Y" if typing.get_origin(args[0]) is tuple else "ID"
    return f"{name}={one}+{one}"


_LOCKS = {"state": STATE_LOCK, "trajectory": TRAJECTORY_LOCK}


def lock_commands(texts: Sequence[str]) -> tuple[SetLocks, ...]:
    """The edits that lock agents; each text is ID=WHAT.

    Raises:
        GenerationError: WHAT is neither state, trajectory nor a number of seconds.
    """
    agent_ids: dict[Lock, list[str]] = {}
    for text in texts:
        agent_id, equals, what = text.rpartition("=")
        lock = _LOCKS.get(what) or _beginning(what)
        if not agent_id or not equals or lock is None:
            raise GenerationError(
                f"--lock: {text!r} is not ID=WHAT with state, trajectory, or the kept "
                f"seconds up to {MAX_KEPT_S:g}, such as AV=2.5."
            )
        agent_ids.setdefault(lock, []).append(agent_id)
    return tuple(
        SetLocks(agent_ids=tuple(ids), lock=lock) for lock, ids in agent_ids.items()
    )


def _beginning(text: str) -> Lock | None:
    try:
        seconds = float(text)
    except ValueError:
        return None
    if not (math.isfinite(seconds) and 0 < seconds <= MAX_KEPT_S):
        return None
    return Lock(kept_s=seconds)


def wanted_kinds(names: Sequence[str]) -> frozenset[AgentKind]:
    """Kinds by their names.

    Raises:
        GenerationError: a name is not that of a kind of road user.
    """
    known = {str(kind): kind for kind in ROAD_USER_KINDS}
    for name in names:
        if name not in known:
            raise GenerationError(
                f"--only-kinds: {name!r} is not a kind out of "
                f"{', '.join(sorted(known))}."
            )
    return frozenset(known[name] for name in names)


@dataclass(frozen=True, kw_only=True)
class WishOptions:
    """What generated traffic is to obey.

    Args:
        guide: What agents should do, as KIND:FIELD=VALUE,... such as goal-point:agent=12,point=3.5/10 (metres of the scene), target-speed:agents=12+13,speed=8, stop-at-line:agent=12,line=3/1+3/5, or a JSON file with a list of terms. DIR/<name>-guidance.csv tells what was achieved.
        lock: What is kept of single agents, as ID=WHAT: state, trajectory, or the first seconds of it, such as AV=2.5.
        sample_signals: Give each junction a plausible phase, by which agents wait or go; it takes the place of the scene's signals.
        seed: Random seed; the same seed gives the same files.
    """

    guide: Annotated[str | tuple[str, ...], shown("TERM [TERM ...]", "(optional)")] = ()
    lock: Annotated[str | tuple[str, ...], shown("ID=WHAT [...]", "(optional)")] = ()
    sample_signals: Switch = False
    seed: Number = 0

    def wishes(self) -> tuple[Command, ...]:
        """What is edited before anything is generated.

        Raises:
            GenerationError: a lock cannot be read.
            InputError: a guidance term cannot be read.
        """
        guide = (self.guide,) if isinstance(self.guide, str) else self.guide
        return (
            *([SampleSignals(seed=self.seed)] if self.sample_signals else []),
            *(AddGuidance(term=term) for term in guidance_terms_of(guide)),
            *lock_commands(several(self.lock)),
        )


def agents_within(
    scenario: Scenario,
    agent_ids: Sequence[str],
    kinds: Collection[AgentKind],
    region: Region | None,
) -> tuple[str, ...]:
    """Ids of those agents that are of some kinds and in a region; none of both: all."""
    found = agent_ids_of_kinds(scenario, agent_ids, kinds)
    return found if region is None else region.held(scenario, found)


def driven_agents(
    scenario: Scenario,
    wanted: Sequence[str],
    kinds: Collection[AgentKind],
    region: Region | None,
) -> tuple[str, ...]:
    """Ids of the agents whose trajectories are generated, of those wanted or of all.

    Raises:
        GenerationError: there is no such agent.
    """
    agent_ids = drivable_agent_ids(scenario, wanted or None)
    found = agents_within(scenario, agent_ids, kinds, region)
    if not found:
        names = ", ".join(sorted(str(kind) for kind in kinds))
        which = f" of the kinds {names}" if names else ""
        where = " in the region" if region is not None else ""
        raise GenerationError(
            f"None of the {len(agent_ids)} agents that could be generated is{which}"
            f"{where}; expected at least one."
        )
    return found


def kept_remarks(
    scenario: Scenario, wanted: Sequence[str], driven: Sequence[str]
) -> tuple[str, ...]:
    """Remarks on agents that were named but cannot be driven, and on locked ones."""
    remarks = [
        f"Agent {name} keeps its trajectory: {_reason(scenario, name)}."
        for name in wanted
        if name not in driven
    ]
    count = len(scenario.locks)
    if count:
        agents, are = ("agent", "is") if count == 1 else ("agents", "are")
        remarks.append(f"{count} {agents} {are} locked and kept.")
    return tuple(remarks)


def _reason(scenario: Scenario, agent_id: str) -> str:
    agents = scenario.agents
    row = agents.row_of[agent_id]
    if agent_id in scenario.locks:
        return "it is locked"
    if not agents.is_valid[row, scenario.current_step]:
        return "it is not there at the current step"
    if agents.kinds[row] not in ROAD_USER_KINDS:
        return f"it is a {agents.kinds[row].value}, not a road user"
    return "it is of another kind or not in the region"
