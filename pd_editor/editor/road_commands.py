"""Edits of the road."""

from dataclasses import dataclass

from pd_editor.editor.command import Command
from pd_editor.editor.edit_limits import check_finite
from pd_editor.errors import EditError
from pd_editor.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_warp import RoadWarp
from pd_editor.scene.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class SetRoadWarp(Command):
    """Bend the original road, or give it back; takes the place of a former warp."""

    warp: RoadWarp | None
    friction_coefficient: float | None = None
    """mu of the speed limit that agents are slowed to; None leaves their speeds."""

    def __post_init__(self) -> None:
        mu = self.friction_coefficient
        if mu is not None:
            check_finite(friction_coefficient=mu)
            if not 0.01 <= mu <= 2.0:
                raise EditError(f"Friction coefficient {mu:g} is outside 0.01..2.")
        if self.warp is not None:
            anchor = self.warp.anchor
            check_finite(
                anchor_x_m=anchor.x_m,
                anchor_y_m=anchor.y_m,
                anchor_rotation_rad=anchor.rotation_rad,
            )

    @property
    def label(self) -> str:
        """Says kinds and powers of the bends."""
        if self.warp is None or self.warp.is_identity:
            return "Reset the road"
        bends = " + ".join(
            f"{term.kind.replace('-', ' ')} {term.power:+g}"
            for term in self.warp.terms
            if term.power != 0
        )
        mu = self.friction_coefficient
        return f"Warp: {bends}" + ("" if mu is None else f", mu {mu:g}")

    def apply(self, scenario: Scenario) -> Scenario:
        """The scenario under this warp alone."""
        applied = scenario.applied_warp
        if applied is None and (self.warp is None or self.warp.is_identity):
            return scenario
        if applied is not None and (
            (applied.warp, applied.friction_coefficient)
            == (self.warp, self.friction_coefficient)
            and applied.warped_agents is scenario.agents
        ):
            return scenario
        return warp_scenario(
            scenario, self.warp, friction_coefficient=self.friction_coefficient
        )
