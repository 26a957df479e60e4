"""Reference to the scenario that a recipe or an export starts from."""

from dataclasses import dataclass, field

from pd_editor.base.errors import RecipeError


@dataclass(frozen=True, kw_only=True)
class MapWindow:
    """A square along the axes of a file's frame, in metres."""

    x_m: float
    y_m: float
    radius_m: float
    """Half of its side."""

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """Least x and y, largest x and y."""
        reach = self.radius_m
        return self.x_m - reach, self.y_m - reach, self.x_m + reach, self.y_m + reach


def part_name(name: str, window: MapWindow | None) -> str:
    """Name of a part of a scene, which tells where it is."""
    return f"{name}-x{window.x_m:.0f}-y{window.y_m:.0f}" if window else name


@dataclass(frozen=True, kw_only=True)
class SceneCut:
    """What is used of a recording and its map."""

    current_s: float | None = None
    """Seconds that count as observed; the last of their steps becomes the current one.
    None: as the file has it."""
    until_s: float | None = None
    """Seconds after the current step that are kept; None keeps all."""
    window: MapWindow | None = field(default=None, metadata={"omit_none": True})
    """Part of the map that is kept; None: all of it."""


@dataclass(frozen=True, kw_only=True)
class BaseReference:
    """Reference to the base scenario of edits: how to open and to verify it."""

    scenario_id: str
    source: str = ""
    """Source of the scenario, as in its provenance."""
    content_sha256: str = ""
    """Hash of the source's bytes."""
    base: "BaseReference | None" = None
    """Base of that scenario, if it is an earlier export itself."""
    is_bent: bool = False
    """Whether its road was warped already."""
    edited_ids: tuple[str, ...] = ()
    """Ids of its agents that were generated or edited already."""
    current_step: int | None = None
    """Its current step; None: as the file has it."""
    attribution: str | None = field(default=None, metadata={"omit_none": True})
    """Who made the source, and under which licence; None: the file does not tell."""
    cut: SceneCut | None = field(default=None, metadata={"omit_none": True})
    """What is used of the source; None: all of it."""

    @property
    def root(self) -> "BaseReference":
        """First scenario of the chain, which is not an export."""
        return self if self.base is None else self.base.root

    @property
    def contents(self) -> tuple[str, str]:
        """Id and hash, which are equal for scenarios that were opened from equal files."""
        return self.scenario_id, self.content_sha256

    def check_contents(self, scenario_id: str, content_sha256: str) -> None:
        """Raise for another scenario, or other contents under the same id.

        Raises:
            RecipeError: id or contents differ from this reference.
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
