"""View of a browser tab, which is kept for the next connection."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import viser

NEAR_M: Final = 0.5
FAR_M: Final = 20_000.0
"""Initial far plane, until the page's script narrows it to the visible content."""

Vector = tuple[float, float, float]
LiveAgents = Literal["generated", "all"]


@dataclass(frozen=True, kw_only=True)
class ViewPose:
    """Position, target and up direction of a camera."""

    position_m: Vector
    look_at_m: Vector
    up: Vector
    fov_rad: float

    @classmethod
    def of(cls, camera: viser.CameraHandle) -> "ViewPose":
        """The pose of a browser's camera."""
        return cls(
            position_m=vector(camera.position),
            look_at_m=vector(camera.look_at),
            up=vector(camera.up_direction),
            fov_rad=float(camera.fov),
        )

    def apply_to(self, camera: viser.CameraHandle) -> None:
        """Put a browser's camera here; the caller makes it one step with the rest."""
        camera.up_direction = self.up
        camera.fov = self.fov_rad
        camera.near, camera.far = NEAR_M, FAR_M
        # Setting a position moves what is looked at along; the order matters.
        camera.position = self.position_m
        camera.look_at = self.look_at_m

    @property
    def half_height_m(self) -> float:
        """Half the height of the picture, in the distance of what is looked at."""
        distance = np.linalg.norm(np.subtract(self.position_m, self.look_at_m))
        return float(distance * np.tan(self.fov_rad / 2))


@dataclass(frozen=True, kw_only=True)
class ViewMemory:
    """View state that a reloaded page restores."""

    is_top: bool = False
    is_heading_up: bool = False
    """Whether the top view has the focal agent's heading up instead of north."""
    pose: ViewPose | None = None
    """Camera pose; None for the view of a newly opened scenario."""
    is_live: bool = True
    """Whether traffic is regenerated while an edit is being made."""
    live_agents: LiveAgents = "generated"
    """Agents that react to edits."""
    panel_tab: str | None = None
    """Title of the open tab of the panel; None for the first one."""


Source = Literal["dataset", "demos", "zip", "library", "unfinished", "rejected"]


@dataclass(frozen=True, kw_only=True)
class StartView:
    """What the list of all scenarios shows, which a reloaded page restores."""

    is_open: bool = False
    source: Source = "demos"
    line: str = ""
    """Words, or a query of what happens."""
    city: str = ""
    split: str = ""
    agents: str = ""
    future: str = ""
    sort: str = "date"
    first: int = 0
    """Index of the first one that is shown."""


def vector(values: Iterable[float]) -> Vector:
    """Three plain numbers."""
    x, y, z = (float(value) for value in values)
    return x, y, z
