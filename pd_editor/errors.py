"""Every error raised on purpose, as one tree.

PdEditorError
├── InputError              a file or folder that the user gave cannot be used
│   ├── ScenarioFileError   tracks (parquet)
│   ├── MapFileError        map (JSON)
│   └── ArchiveError        zip upload
├── EditError               an edit that makes no sense on this scenario
├── RecipeError             a recipe or journal that cannot be replayed
├── GenerationError         a generator refused, or answered nonsense
└── ExportError             a result that cannot be written

Each message is one sentence for the user: what was wrong, where, what was expected.
"""

from pd_editor.plain_text import one_line


class PdEditorError(Exception):
    """Root of all errors that a user, a file or a browser can cause."""

    def __str__(self) -> str:
        """The message in one line; what cannot be printed is escaped."""
        return one_line(super().__str__())


class InputError(PdEditorError):
    """A file or folder that the user gave cannot be used."""


class ScenarioFileError(InputError):
    """A track file is missing, damaged, or not an Argoverse 2 scenario."""


class MapFileError(InputError):
    """A map file is missing, damaged, or not an Argoverse 2 map."""


class ArchiveError(InputError):
    """An uploaded archive is too large, unsafe, or lacks what is needed."""


class EditError(PdEditorError):
    """An edit that makes no sense on the scenario it was applied to."""


class RecipeError(PdEditorError):
    """A recipe or journal that cannot be read or replayed."""


class GenerationError(PdEditorError):
    """A generator refused a request, or its answer cannot be used."""


class ExportError(PdEditorError):
    """A result that cannot be written where it was asked for."""


class SynthesisError(PdEditorError):
    """Synthetic traffic cannot be made: SUMO is missing, or refused a network."""


class ModelError(PdEditorError):
    """Weights that are missing, damaged, or do not fit the model."""


class TrainingError(PdEditorError):
    """A training run that cannot start or go on."""
