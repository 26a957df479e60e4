"""The folder of a training run: what it is, how it goes, and where it stands."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pd_editor.errors import TrainingError
from pd_editor.regular_file import unwritable
from pd_editor.training.config.run_config import RunConfig
from pd_editor.work_engine.work_folder import WorkFolder

CONFIG_NAME: Final = "run.json"
DATA_NAME: Final = "data.json"
LOG_NAME: Final = "log.jsonl"
STATE_NAME: Final = "state.safetensors"
BASIS_NAME: Final = "basis.safetensors"
CURVES_NAME: Final = "loss.png"
MODEL_NAME: Final = "model"


class RunFolder(WorkFolder):
    """Files of a training run; the log grows line by line.

    run.json says what the run is, data.json on what data; log.jsonl has the losses,
    loss.png shows them; state.safetensors is where it stands, model/ what came out.
    """

    @property
    def state_path(self) -> Path:
        """Where the run stands."""
        return self.path / STATE_NAME

    @property
    def basis_path(self) -> Path:
        """The trajectory basis of the model that the run started from, if any."""
        return self.path / BASIS_NAME

    @property
    def model_path(self) -> Path:
        """The model that came out."""
        return self.path / MODEL_NAME

    def begin(self, config: RunConfig, data: Mapping[str, Any]) -> None:
        """Make the folder of a new run.

        Raises:
            ExportError: it holds something already, or cannot be written.
        """
        self.check_free()
        self.write_json(DATA_NAME, data)
        self.write(CONFIG_NAME, config.to_json().encode())

    def config(self) -> RunConfig:
        """What the run is.

        Raises:
            TrainingError: the folder holds no run.
        """
        return RunConfig.from_json(self._read(CONFIG_NAME))

    def go_on(self, config: RunConfig, data: Mapping[str, Any]) -> None:
        """Take the folder up again, perhaps for another time.

        Raises:
            TrainingError: the data differs from what the run was begun on.
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
        """Add a line to the log.

        Raises:
            ExportError: it cannot be written.
        """
        try:
            with (self.path / LOG_NAME).open("a", encoding="utf-8") as file:
                file.write(json.dumps(entry) + "\n")
        except OSError as error:
            raise unwritable(self.path / LOG_NAME, error) from error

    def logged(self) -> list[dict[str, Any]]:
        """Lines of the log; one that a kill cut off is left out."""
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
        """Drop what was logged after a checkpoint, as it will be done again."""
        kept = [entry for entry in self.logged() if entry["step"] <= step]
        text = "".join(json.dumps(entry) + "\n" for entry in kept)
        self.write(LOG_NAME, text.encode())
