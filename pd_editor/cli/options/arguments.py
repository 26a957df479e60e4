"""Command-line arguments that several commands share."""

from pathlib import Path
from typing import Annotated, TypeVar

import tyro

One = TypeVar("One", str, Path, str | Path)
ScenarioArgument = Annotated[
    str | Path, tyro.conf.Positional, tyro.conf.arg(metavar="SCENARIO")
]
FormatOption = Annotated[
    str,
    tyro.conf.arg(
        metavar="FORMAT",
        help_behavior_hint="(av2, commonroad, opendrive, player, scenarionet, tables ...)",
    ),
]
FolderOption = Annotated[str | Path, tyro.conf.arg(metavar="DIR")]
OptionalFolder = Annotated[
    Path | None, tyro.conf.arg(metavar="DIR", help_behavior_hint="(optional)")
]
OptionalFolders = Annotated[
    str | Path | tuple[str | Path, ...],
    tyro.conf.arg(metavar="DIR [DIR ...]", help_behavior_hint="(optional)"),
]
NameOption = Annotated[
    str, tyro.conf.arg(metavar="NAME", help_behavior_hint="(default: says the edits)")
]
TagsOption = Annotated[
    tuple[str, ...], tyro.conf.arg(metavar="TAG [TAG ...]", help_behavior_hint="")
]
NoteOption = Annotated[str, tyro.conf.arg(metavar="TEXT", help_behavior_hint="")]
FocalOption = Annotated[
    str, tyro.conf.arg(metavar="ID", help_behavior_hint="(default: the scenario's)")
]
CurrentOption = Annotated[
    float | None, tyro.conf.arg(metavar="S", help_behavior_hint="(default: the file's)")
]
UntilOption = Annotated[
    float | None, tyro.conf.arg(metavar="S", help_behavior_hint="(default: all)")
]
AroundOption = Annotated[
    tuple[float, float] | None,
    tyro.conf.arg(metavar="X Y", help_behavior_hint="(default: the whole map)"),
]
RadiusOption = Annotated[
    float | None, tyro.conf.arg(metavar="M", help_behavior_hint="(default: 150)")
]
DensestOption = Annotated[
    int | None, tyro.conf.arg(metavar="N", help_behavior_hint="(optional)")
]
Switch = Annotated[
    bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help_behavior_hint="")
]

AddressOption = Annotated[
    str | None,
    tyro.conf.arg(metavar="ADDRESS", help_behavior_hint="(default: this machine)"),
]
WorkersOption = Annotated[
    int | None, tyro.conf.arg(metavar="N", help_behavior_hint="(default: cores)")
]
OptionalWorkers = Annotated[
    int | None, tyro.conf.arg(metavar="N", help_behavior_hint="(default: this process)")
]
LimitOption = Annotated[
    int | None, tyro.conf.arg(metavar="N", help_behavior_hint="(default: all)")
]
TimeLimitOption = Annotated[
    float | None, tyro.conf.arg(metavar="S", help_behavior_hint="(default: none)")
]


def folders(value: str | Path | tuple[str | Path, ...]) -> tuple[Path, ...]:
    """Convert one folder or several to a tuple without duplicates."""
    return several(tuple(map(Path, several(value))))


def several(value: One | tuple[One, ...]) -> tuple[One, ...]:
    """Convert one value or several to a tuple without duplicates."""
    return (value,) if isinstance(value, str | Path) else tuple(dict.fromkeys(value))
