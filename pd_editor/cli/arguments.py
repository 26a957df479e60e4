"""Arguments that several commands share, as they are shown in the help."""

from pathlib import Path
from typing import Annotated

import tyro

ScenarioArgument = Annotated[
    str | Path, tyro.conf.Positional, tyro.conf.arg(metavar="SCENARIO")
]
RecipeArgument = Annotated[
    str | Path, tyro.conf.Positional, tyro.conf.arg(metavar="RECIPE")
]
FolderOption = Annotated[str | Path, tyro.conf.arg(metavar="DIR")]
OptionalFolder = Annotated[
    Path | None, tyro.conf.arg(metavar="DIR", help_behavior_hint="(optional)")
]
Switch = Annotated[
    bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help_behavior_hint="")
]
