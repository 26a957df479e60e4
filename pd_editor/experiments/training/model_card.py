"""Model card of a trained model, and copies of its loss curves."""

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from pd_editor.base.plain_text import markdown_table
from pd_editor.experiments.training.loop.run_folder import CURVES_NAME
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


def card_of(name: str, stages: Mapping[str, TrainedStage]) -> str:
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


def copied_curves(run: Path, folder: Path, kind: StageKind) -> list[Path]:
    """Copy the plot of a run's losses beside the weights, if there is one."""
    source = run / CURVES_NAME
    if not os.path.isfile(source):
        return []
    target = folder / f"{Path(kind.file_name).stem}_loss.png"
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, target)
    return [target]
