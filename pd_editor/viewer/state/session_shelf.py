"""Sessions of one workspace that are not open at the moment."""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from pd_editor.basket.basket import Basket
from pd_editor.editor.session import EditorSession
from pd_editor.editor.unfinished_work import find_unfinished, restore
from pd_editor.errors import RecipeError
from pd_editor.scene.scenario import Scenario

MAX_LIVE: Final = 4
"""Number of sessions in memory; older ones are restored from their journals."""

Key = tuple[str, str]


@dataclass(frozen=True, kw_only=True, eq=False)
class ExportedState:
    """A state of a session that was exported or starred."""

    scenario: Scenario
    starred_as: str | None = None
    """Its name in the basket if that is the only copy; None if it was exported."""


@dataclass(kw_only=True, eq=False)
class ShelvedSession:
    """A session that is not open, with its last exported state."""

    session: EditorSession
    exported: ExportedState | None

    def is_exported(self, basket: Basket) -> bool:
        """Whether the last state was exported, or is in the basket."""
        exported = self.exported
        if exported is None or exported.scenario is not self.session.scenario:
            return False
        return exported.starred_as is None or basket.has(exported.starred_as)


@dataclass(frozen=True, kw_only=True, eq=False)
class _StoredSession:
    """A session that is in its journal alone."""

    key: Key
    exported: ExportedState | None

    def is_exported(self, basket: Basket) -> bool:
        if self.exported is None:
            return False
        name = self.exported.starred_as
        return name is None or basket.has(name)


class SessionShelf:
    """Keeps sessions that were left, so that opening their scenario resumes them.

    Journals of exported work stay on disk as long as the shelf exists: opening such
    a scenario again restores its edits.
    """

    def __init__(
        self,
        journals: Path,
        basket: Basket,
        on_restored: Callable[[Scenario, Scenario], None],
    ) -> None:
        """Begin with none.

        ``journals`` is the folder where sessions go on that are no longer in memory;
        ``on_restored`` is called with an exported state and with its equal afterwards.
        """
        self._journals = journals
        self._basket = basket
        self._on_restored = on_restored
        self._live: list[ShelvedSession] = []
        self._stored: dict[Path, _StoredSession] = {}

    @property
    def live(self) -> tuple[ShelvedSession, ...]:
        """Sessions in memory, the most recent one last."""
        return tuple(self._live)

    def put(self, left: ShelvedSession) -> None:
        """Store a session; one without edits is closed."""
        if not left.session.entries:
            left.session.close(discard=True)
            return
        self._live.append(left)
        for old in tuple(self._live[:-MAX_LIVE]):
            path = old.session.journal_path
            if path is None or old.session.journal_problem is not None:
                # This is the only copy.
                continue
            self._live.remove(old)
            self._stored[path] = _StoredSession(
                key=_key_of(old.session.base),
                exported=old.exported if old.is_exported(self._basket) else None,
            )
            old.session.close()

    def take(self, base: Scenario) -> ShelvedSession | None:
        """Remove and return the most recent session on a scenario."""
        wanted = _key_of(base)
        for left in reversed(self._live):
            if _key_of(left.session.base) == wanted:
                self._live.remove(left)
                return left
        paths = {path for path, left in self._stored.items() if left.key == wanted}
        if not paths:
            return None
        for work in find_unfinished(self._journals):
            if work.path in paths:
                stored = self._stored.pop(work.path)
                try:
                    session = restore(work, base)
                except RecipeError:
                    # It stays in the list of unfinished work, with the reason.
                    return None
                return ShelvedSession(
                    session=session, exported=self._exported_again(stored, session)
                )
        return None

    def _exported_again(
        self, stored: "_StoredSession", session: EditorSession
    ) -> ExportedState | None:
        if stored.exported is None:
            return None
        self._on_restored(stored.exported.scenario, session.scenario)
        return replace(stored.exported, scenario=session.scenario)

    def is_finished(self, journal: Path) -> bool:
        """Whether a journal holds work of this shelf that was exported or is starred."""
        stored = self._stored.get(journal)
        return stored is not None and stored.is_exported(self._basket)

    def remove(self, left: ShelvedSession) -> None:
        """Remove a session; the caller continues or closes it."""
        self._live.remove(left)

    def retry_journals(self) -> None:
        """Write edits to disk that could not be written before."""
        for left in self._live:
            left.session.retry_journal()

    def close(self) -> None:
        """End all sessions; edits that were not exported stay in their journals."""
        for left in self._live:
            left.session.close(discard=left.is_exported(self._basket))
        self._live.clear()
        for work in find_unfinished(self._journals) if self._stored else ():
            if self.is_finished(work.path):
                # Another session may just have taken it up.
                with contextlib.suppress(RecipeError):
                    work.discard()
        self._stored.clear()


def is_same_base(one: Scenario, other: Scenario) -> bool:
    """Whether two scenarios were opened from the same contents under the same id."""
    return _key_of(one) == _key_of(other)


def _key_of(scenario: Scenario) -> Key:
    return scenario.scenario_id, scenario.provenance.content_sha256
