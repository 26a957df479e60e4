"""Hierarchy of all errors that are raised on purpose.

PdEditorError
├── InputError              a file or folder that the user gave cannot be used
│   ├── ScenarioFileError   tracks (parquet)
│   ├── MapFileError        map (JSON)
│   ├── FormatError         scene of another format than Argoverse 2
│   │   └── LargeSceneError  larger or longer than scenes may be; a part can be opened
│   │       └── LargeMapError    its map is: a window can be drawn on it
│   └── ArchiveError        zip upload
├── EditError               an edit is not valid for its scenario
│   └── LockedAgentError    it would change what a lock keeps
├── RecipeError             a recipe or journal cannot be read or replayed
├── GenerationError         a generator refused a request, or its result is invalid
├── ExportError             a result cannot be written
│   └── FolderInUseError    its folder holds the files of an earlier run
├── SynthesisError          synthetic traffic cannot be made
├── ModelError              weights are missing, damaged, or do not fit the model
└── TrainingError           a training run cannot start or continue

Each message is one sentence for the user: what was wrong, where, what was expected.
"""

from typing import Any

from pd_editor.base.plain_text import one_line


class PdEditorError(Exception):
    """Root of all errors that a user, a file or a browser can cause."""

    def __str__(self) -> str:
        """Message in one line; unprintable characters are escaped."""
        return one_line(super().__str__())


class InputError(PdEditorError):
    """A file or folder that the user gave cannot be used."""


class ScenarioFileError(InputError):
    """A track file is missing, damaged, or not an Argoverse 2 scenario."""


class MapFileError(InputError):
    """A map file is missing, damaged, or not an Argoverse 2 map."""


class FormatError(InputError):
    """A scene file of a format other than Argoverse 2 cannot be used."""


class LargeSceneError(FormatError):
    """A scene is larger or longer than scenes may be; a part of it can be opened."""

    def __init__(self, message: str, scene: Any, data: bytes) -> None:
        """Make the error; ``scene`` is the ``FileScene``, ``data`` are the file's bytes."""
        super().__init__(message)
        self.scene, self.data = scene, data


class LargeMapError(LargeSceneError):
    """A scene is larger than scenes may be; a part of its map can be opened."""


class ArchiveError(InputError):
    """An uploaded archive is too large, unsafe, or lacks what is needed."""


class EditError(PdEditorError):
    """An edit is not valid for the scenario that it was applied to."""


class LockedAgentError(EditError):
    """An edit would change what the locks of some agents keep."""

    def __init__(self, message: str, agent_ids: tuple[str, ...]) -> None:
        """Make the error; ``agent_ids`` are the agents to unlock."""
        super().__init__(message)
        self.agent_ids = agent_ids


class RecipeError(PdEditorError):
    """A recipe or journal cannot be read or replayed."""


class GenerationError(PdEditorError):
    """A generator refused a request, or its result is invalid."""


class ExportError(PdEditorError):
    """A result cannot be written to the requested place."""


class FolderInUseError(ExportError):
    """The folder for the results of a run holds files already."""


class SynthesisError(PdEditorError):
    """Synthetic traffic cannot be made: SUMO is missing, or refused a network."""


class ModelError(PdEditorError):
    """Weights are missing, damaged, or do not fit the model."""


class TrainingError(PdEditorError):
    """A training run cannot start or continue."""


class WorkDone(SystemExit):
    """Ends a command of the shell that has nothing more to do in this process."""
