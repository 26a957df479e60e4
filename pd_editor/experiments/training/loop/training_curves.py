"""Curves of a training: pictures of losses, and a log for TensorBoard (extra ``monitor``)."""

import importlib.util
import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Final

from pd_editor.base.errors import TrainingError
from pd_editor.experiments.training.loop.run_folder import RunFolder

FOLDER_NAME: Final = "tensorboard"


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
    with SummaryWriter(folder, purge_step=first_step, flush_secs=20) as writer:

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


def loss_curves_png(entries: Sequence[dict[str, Any]], title: str) -> bytes:
    """Plot training and held-out losses over minutes, total and parts, as a PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import ScalarFormatter

    names = ["loss", *dict.fromkeys(name for e in entries for name in e["parts"])]
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(4.5 * columns, 3.2 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    for index, name in enumerate(names):
        axes = figure.add_subplot(rows, columns, index + 1)
        is_drawn = False
        for held_out, style, label in (
            (False, {"color": "#9db4c0", "linewidth": 1}, "training"),
            (True, {"color": "#c1121f", "marker": ".", "linewidth": 1.5}, "held out"),
        ):
            points = [
                (entry["minutes"], entry["loss" if index == 0 else "parts"])
                for entry in entries
                if entry["held_out"] == held_out
            ]
            points = [(at, v if index == 0 else v.get(name)) for at, v in points]
            points = [(at, v) for at, v in points if v is not None]
            if points:
                axes.plot(*zip(*points, strict=True), label=label, **style)
                is_drawn = is_drawn or all(value > 0 for _, value in points)
        if is_drawn:
            axes.set_yscale("log")
            axes.yaxis.set_major_formatter(ScalarFormatter())
            axes.yaxis.set_minor_formatter(ScalarFormatter())
        axes.set_title(name, fontsize=10)
        axes.set_xlabel("minutes of training")
        axes.grid(visible=True, alpha=0.3)
        if index == 0:
            axes.legend()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    return buffer.getvalue()
