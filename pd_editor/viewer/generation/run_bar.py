"""The bar under the timeline that starts runs, and tells how they go and have gone."""

from collections.abc import Callable, Mapping
from typing import Any, Final

from pd_editor.viewer.overlay.messages import RunBarState, RunVerb, Tone
from pd_editor.viewer.tab.tab_model import RunState
from pd_editor.viewer.tab.ui_context import UiContext

SCOPE_USUAL: Final = "The selection, else the guided, else all"
SCOPE_ALL: Final = "All agents"
IN_REGION: Final = "In the region I draw"
SCOPES: Final = (SCOPE_USUAL, SCOPE_ALL, IN_REGION)
LIMITS: Final = {"samples": (1, 16), "seed": (0, 2**31 - 1)}
"""Least and greatest value of each number."""


class RunBar:
    """The element ``run``, and what is set in it: samples, seed, and whose trajectories."""

    def __init__(self, ui: UiContext, acts: Mapping[str, Callable[[], None]]) -> None:
        """``acts`` are what its buttons do, and what follows a choice, by their names."""
        self._overlay = ui.overlay
        self._kept = kept = ui.workspace.drive_settings
        self._acts = acts
        self.samples: int = kept.get("samples", 1)
        self.seed: int = kept.get("seed", 0)
        self.scope: str = kept.get("scope", SCOPE_USUAL)
        ui.overlay.on("run", self._heard)

    def keep(self) -> None:
        """Keep what is set for the next page."""
        self._kept.update(samples=self.samples, seed=self.seed, scope=self.scope)

    def show(
        self,
        verbs: tuple[RunVerb, RunVerb],
        run: RunState | None,
        said: str,
        tone: Tone,
    ) -> None:
        """Show whom runs are about, and the run; ``said`` is shown without one."""
        state = RunBarState(
            verbs=verbs,
            scope=self.scope,
            scopes=SCOPES,
            samples=self.samples,
            seed=self.seed,
            limits=LIMITS,
            text=run.text if run is not None and run.text else said,
            tone="busy" if run is not None else tone,
            fraction=None if run is None else run.fraction,
            action="" if run is None else run.action,
        )
        self._overlay.show(state)

    def _heard(self, event: Mapping[str, Any]) -> None:
        """Take a choice, or do what a button does."""
        kind, value = str(event.get("kind")), event.get("value")
        if kind == "scope" and value in SCOPES:
            self.scope = str(value)
        elif kind in LIMITS and isinstance(value, int):
            least, most = LIMITS[kind]
            setattr(self, kind, min(max(value, least), most))
        if kind in self._acts:
            self._acts[kind]()
