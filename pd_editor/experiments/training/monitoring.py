"""What is watched during a training besides its losses: samples, and TensorBoard."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pd_editor.base.errors import TrainingError
from pd_editor.experiments.training.loop.run_folder import RunFolder
from pd_editor.experiments.training.loop.training_state import TrainState

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
