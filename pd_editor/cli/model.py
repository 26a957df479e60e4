"""``pd-editor model``: join the trained stages into one model."""

from dataclasses import dataclass, replace
from pathlib import Path

from pd_editor.cli.options.arguments import FolderOption, OptionalFolder
from pd_editor.errors import ModelError
from pd_editor.regular_file import write_whole


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
    init: OptionalFolder = None,
    traj: OptionalFolder = None,
) -> ShippedModel:
    """Join trained stages into a model folder, with weights in float16.

    Args:
        out: Folder of the model; stages that are in it and are not given stay.
        init: Folder of a run that trained initial states, or of a model.
        traj: Folder of a run that trained trajectories, or of a model.
    """
    from pd_editor.diffusion.checkpoints.model_folder import (
        CONFIG_NAME,
        load_model,
        save_model,
    )
    from pd_editor.diffusion.stages import STAGE_KINDS
    from pd_editor.training.loop.run_folder import MODEL_NAME
    from pd_editor.training.model_card import CARD_NAME, card_of, copied_curves

    given = {"init": init, "traj": traj}
    folder, stages, curves = Path(out), {}, []
    if (folder / CONFIG_NAME).exists():
        stages.update(load_model(folder, STAGE_KINDS).stages)
    for name, run in given.items():
        if run is None:
            continue
        source = run / MODEL_NAME if (run / MODEL_NAME).is_dir() else run
        stages[name] = load_model(source, STAGE_KINDS).stage(name)
        curves += copied_curves(run, folder, stages[name].kind)
    if not stages or init is traj is None:
        raise ModelError("No trained stage was given; expected --init, --traj or both.")
    shipped = {name: replace(stage, sha256="") for name, stage in stages.items()}
    save_model(folder, shipped, half=True)
    card = folder / CARD_NAME
    if not card.exists():
        write_whole(card, card_of(folder.resolve().name, stages).encode(), ModelError)
    files = [
        folder / CONFIG_NAME,
        *(folder / s.kind.file_name for s in stages.values()),
    ]
    return ShippedModel(folder=folder, files=(*files, *curves, card))
