"""The folder of a training run: what it is, how it goes, and where it stands."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pd_editor.diffusion.checkpoints.tensor_file import write_whole
from pd_editor.errors import ExportError, ModelError, TrainingError
from pd_editor.training.run.run_config import RunConfig

CONFIG_NAME: Final = "run.json"
DATA_NAME: Final = "data.json"
LOG_NAME: Final = "log.jsonl"
STATE_NAME: Final = "state.safetensors"
BASIS_NAME: Final = "basis.safetensors"
CURVES_NAME: Final = "loss.png"
MODEL_NAME: Final = "model"


class RunFolder:
    """Files of a run; each is whole or not there at all, the log line by line.

    run.json says what the run is, data.json on what data; log.jsonl has the losses,
    loss.png shows them; state.safetensors is where it stands, model/ what came out.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)

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

    @property
    def curves_path(self) -> Path:
        """The picture of the losses."""
        return self.path / CURVES_NAME

    def check_free(self) -> None:
        """Refuse a folder that holds something.

        Raises:
            ExportError: it does, or it is no folder.
        """
        try:
            present = os.listdir(self.path) if os.path.lexists(self.path) else []
        except OSError as error:
            raise ExportError(
                f"{self.path}: cannot be used ({error.strerror or error})."
            ) from error
        if present:
            raise ExportError(
                f"{self.path}: already holds files; choose a new folder, or go on with "
                "an earlier run by --resume."
            )

    def begin(self, config: RunConfig, data: Mapping[str, Any]) -> None:
        """Make the folder of a new run.

        Raises:
            ExportError: it holds something already, or cannot be written.
        """
        self.check_free()
        self._write(DATA_NAME, _text(data))
        self._write(CONFIG_NAME, config.to_json().encode())

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
        self._write(CONFIG_NAME, config.to_json().encode())

    def _write(self, name: str, data: bytes) -> None:
        try:
            write_whole(self.path / name, data)
        except ModelError as error:
            raise ExportError(str(error)) from error

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
            raise ExportError(
                f"{self.path / LOG_NAME}: cannot be written "
                f"({error.strerror or error})."
            ) from error

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
        write_whole(self.path / LOG_NAME, text.encode())


def _text(values: Mapping[str, Any]) -> bytes:
    return (json.dumps(values, indent=2, sort_keys=True) + "\n").encode()
