"""Settings of a panel that outlive a reload of the page."""

from collections.abc import Iterable, Mapping
from typing import Any

from pd_editor.viewer.tab.ui_context import set_value


class KeptSettings:
    """Inputs of a panel by name, and the values that they had when the page closed."""

    def __init__(self, kept: dict[str, Any], inputs: Mapping[str, Any]) -> None:
        """``kept`` belongs to the workspace; it is empty before the first page."""
        self._kept = kept
        self._inputs = inputs

    def restore(self, names: Iterable[str] | None = None) -> None:
        """Give inputs, or those of some names, their former values."""
        for name in self._inputs if names is None else names:
            if name in self._kept:
                set_value(self._inputs[name], self._kept[name])

    def keep(self) -> None:
        """Keep all values, because the page closes."""
        self._kept.update((name, one.value) for name, one in self._inputs.items())
