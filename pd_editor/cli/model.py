"""``pd-editor model``: join the trained stages into one model, with its card."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pd_editor.base.errors import ModelError
from pd_editor.base.plain_text import markdown_table
from pd_editor.base.regular_file import write_whole
from pd_editor.cli.options import FolderOption, OptionalFolders, folders
from pd_editor.cli.output import preparation_shown
from pd_editor.experiments.training.run_folder import CURVES_NAME, MODEL_NAME

if TYPE_CHECKING:
    from pd_editor.generation.checkpoints.model_folder import StageKind, TrainedStage

LICENCE_OF_RECORDED: Final = (
    "**Licence.** These weights were trained on recordings. If they are of Argoverse 2, "
    "its licence, CC BY-NC-SA 4.0, holds for what is made of them: no commercial use, "
    "attribution to Argoverse 2 (Wilson et al., 2021), and the same licence when they are "
    "passed on."
)
CARD_NAME: Final = "MODEL_CARD.md"
_ABOUT: Final = {
    "scenes": "scenes",
    "steps": "steps",
    "minutes": "minutes",
    "held_out_loss": "held-out loss",
}


def card_of(name: str, stages: Mapping[str, "TrainedStage"]) -> str:
    """Write the card of a model from its training records, as Markdown."""
    header = ("stage", "parameters", "data", *_ABOUT.values())
    rows = [
        (
            key,
            f"{sum(one.numel() for one in stage.model.parameters()):,}",
            " + ".join(stage.about.get("roots", [])),
            *(str(stage.about.get(one)) for one in _ABOUT),
        )
        for key, stage in sorted(stages.items())
    ]
    parts = [f"# {name}", "Weights in float16; `config.json` has their hashes."]
    parts.append(markdown_table(header, rows))
    if any(stage.about.get("is_recorded") for stage in stages.values()):
        parts.append(LICENCE_OF_RECORDED)
    return "\n\n".join(parts) + "\n"


def copied_curves(run: Path, folder: Path, kind: "StageKind") -> list[Path]:
    """Copy the plot of a run's losses beside the weights, if there is one."""
    source = run / CURVES_NAME
    if not os.path.isfile(source):
        return []
    target = folder / f"{Path(kind.file_name).stem}_loss.png"
    write_whole(target, source.read_bytes(), ModelError)
    return [target]


@dataclass(frozen=True, kw_only=True, eq=False)
class ShippedModel:
    """A complete model folder."""

    folder: Path
    files: tuple[Path, ...]

    def __str__(self) -> str:
        """One line per file."""
        return "\n".join(map(str, self.files))


def model(
    *,
    out: FolderOption,
    init: OptionalFolders = (),
    traj: OptionalFolders = (),
    measure: OptionalFolders = (),
) -> ShippedModel:
    """Join trained stages into a model folder, with weights in float16.

    Args:
        out: Folder of the model; stages that are in it and are not given stay.
        init: Folder of a run that trained initial states, or of a model; of several that began with the same weights, the average is taken.
        traj: Folder of a run that trained trajectories, or of a model; of several likewise.
        measure: Training data, on which to measure what the sampler of initial states needs to know; for weights that were trained before it was measured.
    """
    from pd_editor.generation.checkpoints.model_folder import (
        CONFIG_NAME,
        averaged_stage,
        load_model,
        save_model,
    )
    from pd_editor.generation.stages import STAGE_KINDS

    given = {"init": folders(init), "traj": folders(traj)}
    folder, stages, curves = Path(out), {}, []
    if os.path.exists(folder / CONFIG_NAME):
        stages.update(load_model(folder, STAGE_KINDS).stages)
    title = os.path.basename(os.path.realpath(folder))
    former = card_of(title, stages).encode()
    for name, runs in given.items():
        if not runs:
            continue
        sources = [
            run / MODEL_NAME if os.path.isdir(run / MODEL_NAME) else run for run in runs
        ]
        found = [load_model(one, STAGE_KINDS).stage(name) for one in sources]
        stages[name] = averaged_stage(found, sources)
        curves += copied_curves(runs[0], folder, stages[name].kind)
    if not stages or not (any(given.values()) or measure):
        raise ModelError("No trained stage was given; expected --init, --traj or both.")
    if measure:
        stages["init"] = _measured(stages, folders(measure))
    shipped = {name: replace(stage, sha256="") for name, stage in stages.items()}
    save_model(folder, shipped, half=True)
    card = folder / CARD_NAME
    # One that was written by hand stays.
    if not os.path.exists(card) or card.read_bytes() == former:
        write_whole(card, card_of(title, stages).encode(), ModelError)
    files = [
        folder / CONFIG_NAME,
        *(folder / s.kind.file_name for s in stages.values()),
    ]
    return ShippedModel(folder=folder, files=(*files, *curves, card))


def _measured(
    stages: Mapping[str, "TrainedStage"], roots: tuple[Path, ...]
) -> "TrainedStage":
    from pd_editor.experiments.training.training_data import default_cache
    from pd_editor.experiments.training.training_run import measured

    if "init" not in stages:
        raise ModelError("There are no initial states to measure; expected --init.")
    return measured(stages["init"], roots, default_cache(), preparation_shown())
