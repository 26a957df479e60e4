"""Lock of the selection: what is kept of it when traffic is generated or edited."""

from collections.abc import Mapping
from typing import Final

from pd_editor.base.errors import EditError, LockedAgentError
from pd_editor.editor.commands import SetLocks
from pd_editor.scene.locks import MAX_KEPT_S, STATE_LOCK, TRAJECTORY_LOCK, Lock
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.overlay.overlay import OFFER
from pd_editor.viewer.tab.ui_context import UiContext, set_property, set_value

NOT_LOCKED: Final = "Not locked"
STATE: Final = "State at t = 0"
BEGINNING: Final = "First seconds"
TRAJECTORY: Final = "Whole trajectory"
MIXED: Final = "mixed"
_FIXED: Final[Mapping[str, Lock | None]] = {
    NOT_LOCKED: None,
    STATE: STATE_LOCK,
    TRAJECTORY: TRAJECTORY_LOCK,
}


class LockControls:
    """What is locked of the selection, and the offer to unlock."""

    def __init__(self, ui: UiContext) -> None:
        """Build them into the tab; the banner offers to unlock after a refusal."""
        self._ui = ui
        self._banner = ui.banner
        self._offered_for: Scenario | None = None
        gui = ui.client.gui
        self._kept = gui.add_dropdown(
            "Lock",
            _options(),
            hint="What is kept when traffic is generated, repaired or edited (Shift+K)",
        )
        self._seconds = gui.add_number(
            "Locked seconds",
            2.0,
            min=0.1,
            max=MAX_KEPT_S,
            step=0.1,
            hint="Of 'First seconds': from t = 0",
        )
        self._seconds.precision = 1
        failure = "Lock not changed"
        ui.on_change(self._kept, self._choose, failure=failure)
        ui.on_change(
            self._seconds, self._set_seconds, merge_key="lock", failure=failure
        )

    def toggle(self) -> None:
        """Unlock the selection if all of it is locked; else lock its trajectories."""
        toggle_lock(self._ui)

    def lock(self, lock: Lock | None) -> None:
        """Lock the selection, or unlock it."""
        self._ui.apply(SetLocks(agent_ids=selected(self._ui), lock=lock))

    @property
    def beginning(self) -> Lock:
        """Lock of the first seconds, as many as the panel says."""
        return Lock(kept_s=round(float(self._seconds.value), 3))

    def offer(self, error: LockedAgentError) -> None:
        """Offer to unlock the agents that an edit would have changed."""
        ids = error.agent_ids
        self._offered_for = self._ui.session.scenario

        def unlock() -> None:
            self._banner.hide("locks")
            there = self._ui.session.scenario.locks
            names = tuple(name for name in ids if name in there)
            if names:
                self._ui.apply(SetLocks(agent_ids=names, lock=None))

        self._banner.show(
            "locks", str(error), buttons={"Unlock": unlock}, priority=OFFER
        )

    def show(self, scenario: Scenario, selection: tuple[str, ...]) -> None:
        """Show what is locked of the selection."""
        if self._offered_for is not None and scenario is not self._offered_for:
            self.withdraw()
        found = {scenario.locks.get(name) for name in selection}
        shown = {_option(lock) for lock in found}
        options = _options(MIXED) if len(shown) > 1 else _options()
        if tuple(self._kept.options) != options:
            self._kept.options = options
        option = MIXED if len(shown) > 1 else next(iter(shown), NOT_LOCKED)
        set_value(self._kept, option)
        set_property(self._kept, "visible", bool(selection))
        set_property(self._seconds, "visible", option == BEGINNING)
        seconds = {lock.kept_s for lock in found if lock is not None}
        if option == BEGINNING and len(seconds) == 1:
            set_value(self._seconds, seconds.pop())

    def withdraw(self) -> bool:
        """Remove the offer to unlock; returns whether there was one."""
        was_offered, self._offered_for = self._offered_for is not None, None
        self._banner.hide("locks")
        return was_offered

    def _choose(self, option: str) -> None:
        try:
            if option == BEGINNING:
                self.lock(self.beginning)
            elif option in _FIXED:
                self.lock(_FIXED[option])
        finally:
            session = self._ui.session
            self.show(session.scenario, session.selection)

    def _set_seconds(self, _seconds: float) -> None:
        if self._kept.value == BEGINNING:
            self.lock(self.beginning)


def selected(ui: UiContext) -> tuple[str, ...]:
    """Ids of the selected agents.

    Raises:
        EditError: there is none.
    """
    if not ui.session.selection:
        raise EditError("Nothing is selected. Select an agent first.")
    return ui.session.selection


def toggle_lock(ui: UiContext) -> None:
    """Unlock the selection if all of it is locked; else lock its trajectories."""
    ids, locks = selected(ui), ui.session.scenario.locks
    is_locked = all(name in locks for name in ids)
    ui.apply(SetLocks(agent_ids=ids, lock=None if is_locked else TRAJECTORY_LOCK))


def _options(*more: str) -> tuple[str, ...]:
    return (*more, NOT_LOCKED, STATE, BEGINNING, TRAJECTORY)


def _option(lock: Lock | None) -> str:
    if lock is None:
        return NOT_LOCKED
    if lock.keeps == "trajectory":
        return TRAJECTORY
    return BEGINNING if lock.keeps == "beginning" else STATE
