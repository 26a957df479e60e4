"""``pd-editor warp``: bend a scenario's road, Scene-Attack style."""

import math
import sys
from pathlib import Path
from typing import Annotated

import tyro

from pd_editor.editor.commands import SetRoadWarp
from pd_editor.editor.session import EditorSession
from pd_editor.errors import EditError
from pd_editor.geometry.rigid_motion import RigidMotion
from pd_editor.perturbation.anchor import pose_on_original_road
from pd_editor.perturbation.friction_limit import DRY_ROAD_FRICTION, summarise
from pd_editor.scenario_store import export_into, open_scenario
from pd_editor.scene.road_warp import DEFAULT_LENGTH_M, RoadWarp, WarpKind, WarpTerm
from pd_editor.scene.scenario import EGO_ID, Scenario


def warp(
    scenario: Annotated[str, tyro.conf.Positional],
    /,
    *,
    kind: tuple[WarpKind, ...],
    power: tuple[float, ...],
    out: Path,
    length: tuple[float, ...] = (),
    border: float = 5.0,
    exponent: float = 3.0,
    anchor: str = "focal",
    friction: float | None = None,
    overwrite: bool = False,
) -> Path:
    """Bend the road ahead of an anchor; several kinds add up.

    Args:
        scenario: A demo's name or an Argoverse 2 scenario folder.
        kind: One or more of smooth-turn, double-turn, ripple-road.
        power: Strength of each kind, -10..10; positive bends to the left.
        out: Folder that receives OUT/<scenario id>/.
        length: Length of each kind in metres; the kinds' defaults if not given.
        border: Distance ahead of the anchor where the bends begin, metres.
        exponent: Exponent of the turns.
        anchor: focal, ego, an agent's id, or a pose x,y,heading (metres, degrees) in
            the scene frame.
        friction: Friction coefficient; if given, agents are slowed to the limit.
        overwrite: Replace what an earlier run wrote.
    """
    opened = open_scenario(scenario)
    command = SetRoadWarp(
        warp=RoadWarp(
            anchor=_anchor_pose(opened, anchor),
            terms=_terms(kind, power, length, border, exponent),
        ),
        friction_coefficient=friction,
    )
    session = EditorSession(opened)
    session.apply(command)
    folder = export_into(
        out,
        opened.scenario_id,
        session.scenario,
        session.recipe(),
        overwrite=overwrite,
    )
    if command.warp is not None:
        mu = DRY_ROAD_FRICTION if friction is None else friction
        summary = summarise(command.warp, friction_coefficient=mu)
        sys.stdout.write(
            f"{folder}: curvature up to {summary.max_curvature_per_m:.3f} /m, "
            f"friction limit {summary.speed_limit_mps:.1f} m/s at mu = {mu:g}\n"
        )
    return folder


def _terms(
    kinds: tuple[WarpKind, ...],
    powers: tuple[float, ...],
    lengths: tuple[float, ...],
    border_m: float,
    exponent: float,
) -> tuple[WarpTerm, ...]:
    if len(powers) != len(kinds):
        raise EditError(f"{len(kinds)} kinds need as many powers, not {len(powers)}.")
    if lengths and len(lengths) != len(kinds):
        raise EditError(f"{len(kinds)} kinds need as many lengths, not {len(lengths)}.")
    lengths = lengths or tuple(DEFAULT_LENGTH_M[kind] for kind in kinds)
    return tuple(
        WarpTerm(
            kind=kind,
            power=power,
            length_m=length,
            border_m=border_m,
            exponent=exponent,
        )
        for kind, power, length in zip(kinds, powers, lengths, strict=True)
    )


def _anchor_pose(scenario: Scenario, anchor: str) -> RigidMotion:
    parts = anchor.split(",")
    if len(parts) == 3:
        try:
            x, y, degrees = (float(part) for part in parts)
        except ValueError:
            raise EditError(
                f"Anchor {anchor!r} is no pose; expected x,y,heading in numbers."
            ) from None
        return RigidMotion(x_m=x, y_m=y, rotation_rad=math.radians(degrees))
    agent_id = {"focal": scenario.focal_id, "ego": EGO_ID}.get(anchor, anchor)
    return pose_on_original_road(scenario, agent_id)
