"""Which scenario something was made from."""

from dataclasses import dataclass

from pd_editor.errors import RecipeError


@dataclass(frozen=True, kw_only=True)
class BaseReference:
    """The scenario that edits start from, and how to open and recognise it."""

    scenario_id: str
    source: str = ""
    """How to open it again, as in its provenance."""
    content_sha256: str = ""
    """Hash of the source's bytes."""
    base: "BaseReference | None" = None
    """What that scenario was itself made from, where it is an earlier export."""
    is_bent: bool = False
    """Whether its road was bent already."""
    edited_ids: tuple[str, ...] = ()
    """Its agents that were made or changed already."""

    @property
    def root(self) -> "BaseReference":
        """The first scenario of the chain, which is no export."""
        return self if self.base is None else self.base.root

    def check_contents(self, scenario_id: str, content_sha256: str) -> None:
        """Refuse another scenario, or other contents under the same id.

        Raises:
            RecipeError: it is not the one.
        """
        if scenario_id != self.scenario_id:
            raise RecipeError(
                f"This belongs to scenario {self.scenario_id}, not to {scenario_id}."
            )
        if content_sha256 != self.content_sha256:
            raise RecipeError(
                f"Scenario {scenario_id} has other contents than when this was"
                " recorded."
            )
