"""Log of a run for TensorBoard (extra ``monitor``)."""

import importlib.util
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

from pd_editor.base.errors import TrainingError
from pd_editor.experiments.training.loop.run_folder import RunFolder

FOLDER_NAME: Final = "tensorboard"
_FLUSH_S: Final = 20


def check_installed() -> None:
    """Raise unless TensorBoard is installed.

    Raises:
        TrainingError: it is not.
    """
    if importlib.util.find_spec("tensorboard") is None:
        raise TrainingError(
            'TensorBoard is not installed; install the extra "monitor" '
            "(pip install 'pd-editor[monitor]'), or leave out --tensorboard."
        )


@contextmanager
def tensorboard_log(run: RunFolder, first_step: int) -> Iterator[None]:
    """Write the entries of a run's log for TensorBoard too, within the context.

    Steps of an earlier log from ``first_step`` on are hidden.
    """
    from torch.utils.tensorboard import SummaryWriter

    folder = str(run.path / FOLDER_NAME)
    with SummaryWriter(folder, purge_step=first_step, flush_secs=_FLUSH_S) as writer:

        def add(entry: Mapping[str, Any]) -> None:
            for name, value in scalars_of(entry).items():
                writer.add_scalar(name, value, entry["step"])

        run.on_entry = add
        yield


def scalars_of(entry: Mapping[str, Any]) -> dict[str, float]:
    """Numbers of an entry of the log, by the name of their chart."""
    if "samples" in entry:
        return {
            f"{part}/{name}": value
            for part in ("samples", "recorded")
            for name, value in entry[part].items()
        }
    part = "held out" if entry["held_out"] else "training"
    found = {f"loss/{part}": entry["loss"]}
    found |= {f"{part}/{name}": value for name, value in entry["parts"].items()}
    for name in ("gradient_norm", "steps_per_s"):
        if name in entry:
            found[f"training/{name}"] = entry[name]
    return found
