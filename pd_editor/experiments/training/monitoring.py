"""What is watched during a training besides its losses: samples, and TensorBoard."""

import importlib.util
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pd_editor.base.errors import TrainingError
from pd_editor.experiments.training.run_folder import RunFolder
from pd_editor.experiments.training.train_loop import TrainState

MAX_EVALUATE_MINUTES: Final = 1e6
MIN_EVALUATE_MINUTES: Final = 0.01


SampleCheck = Callable[[Path], Mapping[str, Mapping[str, float]]]
"""Samples with the model of a folder; gives figures of ``samples``, and of the recordings
beside them as ``recorded``."""


@dataclass(frozen=True, kw_only=True)
class Monitoring:
    """What to watch. It has no influence on the weights.

    Raises:
        TrainingError: the interval is out of range.
    """

    evaluate_minutes: float | None = None
    """Minutes of training between evaluations of samples; None: no evaluation."""
    check_of: Callable[[Sequence[Path], str], SampleCheck] | None = None
    """Prepares the evaluation, given the validation roots and the stage."""
    has_tensorboard: bool = False

    def __post_init__(self) -> None:
        every = self.evaluate_minutes
        if every is not None and not (
            MIN_EVALUATE_MINUTES <= every <= MAX_EVALUATE_MINUTES
        ):
            raise TrainingError(
                f"--evaluate-every is {every:g}; expected {MIN_EVALUATE_MINUTES:g} to "
                f"{MAX_EVALUATE_MINUTES:g} minutes."
            )

    def watch(
        self, roots: Sequence[Path], stage: str, run: RunFolder
    ) -> "SampleWatch | None":
        """The evaluation of samples of a run, if there is to be one.

        Raises:
            PdEditorError: there are no scenarios to evaluate on.
        """
        if self.evaluate_minutes is None or self.check_of is None:
            return None
        if not roots:
            raise TrainingError(
                "--evaluate-every needs --validate with the root of scenarios that are "
                "not trained on."
            )
        return SampleWatch(self.evaluate_minutes, self.check_of(roots, stage), run)


class SampleWatch:
    """Evaluates samples every few minutes of training, and logs the figures."""

    def __init__(self, minutes: float, check: SampleCheck, run: RunFolder) -> None:
        self.minutes = minutes
        self._check, self._run = check, run
        earlier = [one["minutes"] for one in run.logged() if "samples" in one]
        self._last = max(earlier, default=0.0)

    def look(self, train_state: TrainState, *, is_over: bool) -> None:
        """Evaluate the run's model if it is time to, or at the end.

        Raises:
            ExportError: the log cannot be written.
        """
        minutes = round(train_state.trained_s / 60, 4)
        is_due = minutes - self._last >= self.minutes
        if not (is_due or (is_over and minutes > self._last)):
            return
        self._last = minutes
        found = self._check(self._run.model_path)
        self._run.log({"step": train_state.step, "minutes": minutes, **found})


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
