"""Folder of a training run (configuration, log, checkpoint and model), and its result."""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pd_editor.base.errors import TrainingError
from pd_editor.base.regular_file import unwritable
from pd_editor.experiments.training.run_config import RunConfig
from pd_editor.experiments.work_engine.work_folder import WorkFolder

CONFIG_NAME: Final = "run.json"
DATA_NAME: Final = "data.json"
LOG_NAME: Final = "log.jsonl"
STATE_NAME: Final = "state.safetensors"
BASIS_NAME: Final = "basis.safetensors"
CURVES_NAME: Final = "loss.png"
MODEL_NAME: Final = "model"


class RunFolder(WorkFolder):
    """Files of a training run; the log grows line by line.

    run.json is the configuration, data.json describes the data; log.jsonl has the losses,
    and figures of samples;
    loss.png plots them; state.safetensors is the checkpoint, model/ the trained model.
    """

    def __init__(self, path: Path) -> None:
        """Set the path of the folder."""
        super().__init__(path)
        self.on_entry: Callable[[Mapping[str, Any]], None] = lambda _: None
        """Called with each entry of the log."""
        self.state_path = path / STATE_NAME
        """The checkpoint."""
        self.basis_path = path / BASIS_NAME
        """The trajectory basis of the model that the run started from, if any."""
        self.model_path = path / MODEL_NAME
        """The trained model."""

    def begin(self, config: RunConfig, data: Mapping[str, Any]) -> None:
        """Create the folder of a new run.

        Raises:
            ExportError: the folder is not empty, or cannot be written.
        """
        self.check_free()
        self.write_json(DATA_NAME, data)
        self.write(CONFIG_NAME, config.to_json().encode())

    def config(self) -> RunConfig:
        """Configuration of the run.

        Raises:
            TrainingError: the folder holds no run.
        """
        return RunConfig.from_json(self._read(CONFIG_NAME))

    def go_on(self, config: RunConfig, data: Mapping[str, Any]) -> None:
        """Resume the folder, possibly with another budget.

        Raises:
            TrainingError: the data differs from that of the run.
            ExportError: the folder cannot be written.
        """
        earlier = json.loads(self._read(DATA_NAME))
        if earlier.get("fingerprint") != data["fingerprint"]:
            raise TrainingError(
                f"{self.path}: was begun on other data than is there now; begin a new "
                "run, or bring the data back."
            )
        self.write(CONFIG_NAME, config.to_json().encode())

    def _read(self, name: str) -> bytes:
        try:
            return (self.path / name).read_bytes()
        except OSError as error:
            raise TrainingError(
                f"{self.path}: holds no training run to go on with (no readable {name})."
            ) from error

    def log(self, entry: Mapping[str, Any]) -> None:
        """Append an entry to the log.

        Raises:
            ExportError: the log cannot be written.
        """
        try:
            with (self.path / LOG_NAME).open("a", encoding="utf-8") as file:
                file.write(json.dumps(entry) + "\n")
        except OSError as error:
            raise unwritable(self.path / LOG_NAME, error) from error
        self.on_entry(entry)

    def logged(self) -> list[dict[str, Any]]:
        """Entries of the log, without one that was truncated by a kill."""
        try:
            lines = (self.path / LOG_NAME).read_text(encoding="utf-8").splitlines()
        except OSError:
            return []
        entries = []
        for line in lines:
            try:
                entries.append(json.loads(line))
            except ValueError:
                continue
        return entries

    def forget_after(self, step: int) -> None:
        """Remove entries after a checkpoint, whose steps will be repeated."""
        kept = [entry for entry in self.logged() if entry["step"] <= step]
        text = "".join(json.dumps(entry) + "\n" for entry in kept)
        self.write(LOG_NAME, text.encode())


@dataclass(frozen=True, kw_only=True, eq=False)
class Training:
    """Result of a training, and its files."""

    folder: Path
    model: Path
    """Folder of the weights, as ``generate --model`` takes it."""
    steps: int
    minutes: float
    held_out_loss: float
    """Loss on held-out scenes; NaN without any."""
    num_scenes: int
    num_left_out: int
    """Number of scenarios and files that could not be used, or are not trained on."""
    is_stopped: bool
    """Whether it was stopped before its time; it can be resumed."""
    is_first: bool
    """Whether this is the first of all processes, which reports the result."""

    def __str__(self) -> str:
        """The model's folder, then remarks."""
        loss = self.held_out_loss
        held_out = "" if math.isnan(loss) else f"; held-out loss {loss:.4f}"
        remarks = [
            f"{self.steps} steps in {self.minutes:.1f} minutes on {self.num_scenes} "
            f"scenes{held_out}."
        ]
        if self.num_left_out:
            remarks.append(f"{self.num_left_out} scenarios or files were left out.")
        if self.is_stopped:
            remarks.append(f"Stopped; go on with --resume --out {self.folder}")
        return "\n".join([str(self.model), *remarks])
