"""``pd-editor warp``: warp a scenario's road (Scene-Attack)."""

import math
from dataclasses import dataclass
from typing import Annotated

from pd_editor.base.errors import EditError
from pd_editor.cli.many_scenes import ManyOptions, PartsOptions, over_scenes
from pd_editor.cli.options import FocalOption, NameOption, shown
from pd_editor.cli.output import Outcome, edited_session, write_session
from pd_editor.editor.commands import SetFocalAgent, SetRoadWarp
from pd_editor.editor.scenario_store import open_part
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.friction import DRY_ROAD_FRICTION, summarise
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor
from pd_editor.scene.road_warp import (
    DEFAULT_LENGTH_M,
    WARP_KINDS,
    RoadWarp,
    WarpKind,
    WarpTerm,
)
from pd_editor.scene.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class WarpOptions(PartsOptions, ManyOptions):
    """Options of ``pd-editor warp``.

    Args:
        kind: smooth-turn, double-turn or ripple-road; several are added.
        power: Strength of each kind, -10..10; positive bends to the left.
        length: Turn length, distance between two turns, or wave length, metres.
        border: Distance ahead of the anchor where the bends begin, metres.
        exponent: Exponent of the turns, 2..8.
        anchor: focal, ego, an agent's id, or a pose x,y,heading in metres and degrees.
        friction: Slow agents to the speed that this friction coefficient allows.
        focal: Id of the agent that becomes the focal one.
        name: Id of the warped scenario, such as 000c4929-double-turn-p6.
    """

    kind: Annotated[WarpKind | tuple[WarpKind, ...], shown("KIND [KIND ...]")]
    power: Annotated[float | tuple[float, ...], shown("POWER [POWER ...]")]
    length: Annotated[
        float | tuple[float, ...], shown("M [M ...]", "(default: 10, 10, 60)")
    ] = ()
    border: Annotated[float, shown("M")] = 5.0
    exponent: Annotated[float, shown("P")] = 3.0
    anchor: Annotated[str, shown("ANCHOR")] = "focal"
    friction: Annotated[float | None, shown("MU", "(optional)")] = None
    focal: FocalOption = ""
    name: NameOption = ""

    @property
    def terms(self) -> tuple[WarpTerm, ...]:
        """One bend for each kind.

        Raises:
            EditError: kinds, powers and lengths do not go together.
        """
        kinds = (self.kind,) if isinstance(self.kind, str) else tuple(self.kind)
        powers, lengths = (
            (one,) if isinstance(one, int | float) else tuple(one)
            for one in (self.power, self.length)
        )
        if not kinds:
            raise EditError(f"No kind was given; choose among {', '.join(WARP_KINDS)}.")
        if len(set(kinds)) != len(kinds):
            raise EditError("A kind was given twice; each may be used once.")
        for noun, values in (("powers", powers), ("lengths", lengths)):
            if len(values) != len(kinds) and (values or noun == "powers"):
                raise EditError(
                    f"{len(kinds)} kinds and {len(values)} {noun} were given; expected "
                    f"as many {noun} as kinds."
                )
        return tuple(
            WarpTerm(
                kind=one,
                power=float(powers[index]),
                length_m=float(lengths[index]) if lengths else DEFAULT_LENGTH_M[one],
                border_m=float(self.border),
                exponent=float(self.exponent),
            )
            for index, one in enumerate(kinds)
        )


@over_scenes(WarpOptions)
def warp(scenario: str, options: WarpOptions) -> Outcome:
    """Warp the road ahead of an anchor; several kinds add up."""
    # Numbers are validated before files are read: cheap checks first.
    terms, friction = options.terms, options.friction
    focal = (SetFocalAgent(agent_id=options.focal),) if options.focal else ()
    session = edited_session(open_part(scenario, options.cut), focal, options.name)
    anchor = _anchor_pose(session.scenario, options.anchor)
    command = SetRoadWarp(
        warp=RoadWarp(anchor=anchor, terms=terms),
        friction_coefficient=None if friction is None else float(friction),
    )
    session.apply(command)
    folder = write_session(options.out, session, overwrite=options.overwrite)
    return Outcome(
        folders=(folder,),
        scenarios=(session.scenario,),
        remarks=(_figures(command, friction),),
    )


def _figures(command: SetRoadWarp, friction: float | None) -> str:
    """Describe curvature and speed limit of the warp."""
    assert command.warp is not None
    if command.warp.is_identity:
        return "With power 0 the road stays as it was."
    mu = DRY_ROAD_FRICTION if friction is None else friction
    summary = summarise(command.warp, friction_coefficient=mu)
    return (
        f"Curvature up to {summary.max_curvature_per_m:.3f} /m (radius "
        f"{summary.min_radius_m:.1f} m), friction-limited speed "
        f"{summary.speed_limit_mps:.1f} m/s at mu = {mu:g}."
    )


def _anchor_pose(scenario: Scenario, anchor: str) -> RigidMotion:
    """Pose of an anchor that is given on the shell."""
    if "," not in anchor:
        return pose_of_anchor(scenario, anchor)
    try:
        x, y, degrees = (float(part) for part in anchor.split(","))
    except ValueError:
        x = y = degrees = math.nan
    if not all(map(math.isfinite, (x, y, degrees))):
        raise EditError(
            f"Anchor {anchor!r} is no pose; expected x,y,heading as three numbers."
        )
    return RigidMotion(x_m=x, y_m=y, rotation_rad=math.radians(degrees))
