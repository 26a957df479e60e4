"""``pd-editor warp``: warp a scenario's road (Scene-Attack)."""

import math
from pathlib import Path
from typing import Annotated

import tyro

from pd_editor.base.errors import EditError
from pd_editor.cli.many_scenes import SCENE_FILES, over_scenes
from pd_editor.cli.options.arguments import (
    AddressOption,
    AroundOption,
    CurrentOption,
    DensestOption,
    FocalOption,
    FolderOption,
    NameOption,
    OptionalWorkers,
    RadiusOption,
    Switch,
    UntilOption,
)
from pd_editor.cli.output.outcome import Outcome, described, write_session
from pd_editor.editor.commands import SetFocalAgent, SetRoadWarp
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.editor.session import EditorSession
from pd_editor.experiments.work_engine import EngineName
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.perturbation.anchor import pose_of_anchor
from pd_editor.scene.perturbation.friction_limit import DRY_ROAD_FRICTION, summarise
from pd_editor.scene.road_warp import (
    DEFAULT_LENGTH_M,
    WARP_KINDS,
    RoadWarp,
    WarpKind,
    WarpTerm,
)
from pd_editor.scene.scenario import Scenario


@over_scenes(SCENE_FILES)
def warp(
    scenario: str | Path,
    /,
    *,
    kind: Annotated[
        WarpKind | tuple[WarpKind, ...], tyro.conf.arg(metavar="KIND [KIND ...]")
    ],
    power: Annotated[
        float | tuple[float, ...], tyro.conf.arg(metavar="POWER [POWER ...]")
    ],
    out: FolderOption,
    length: Annotated[
        float | tuple[float, ...],
        tyro.conf.arg(metavar="M [M ...]", help_behavior_hint="(default: 10, 10, 60)"),
    ] = (),
    border: Annotated[float, tyro.conf.arg(metavar="M")] = 5.0,
    exponent: Annotated[float, tyro.conf.arg(metavar="P")] = 3.0,
    anchor: Annotated[str, tyro.conf.arg(metavar="ANCHOR")] = "focal",
    friction: Annotated[
        float | None, tyro.conf.arg(metavar="MU", help_behavior_hint="(optional)")
    ] = None,
    current: CurrentOption = None,
    until: UntilOption = None,
    around: AroundOption = None,
    radius: RadiusOption = None,
    densest: DensestOption = None,  # noqa: ARG001
    focal: FocalOption = "",
    name: NameOption = "",
    overwrite: Switch = False,
    engine: EngineName = "local",  # noqa: ARG001
    address: AddressOption = None,  # noqa: ARG001
    workers: OptionalWorkers = None,  # noqa: ARG001
) -> Outcome:
    """Warp the road ahead of an anchor; several kinds add up.

    Args:
        scenario: Demos, Argoverse 2 scenario folders, files of other formats, folders of these, or patterns; demos for all demos. What is written already stays as it is.
        kind: smooth-turn, double-turn or ripple-road; several are added.
        power: Strength of each kind, -10..10; positive bends to the left.
        out: Folder that receives DIR/<name>/.
        length: Turn length, distance between two turns, or wave length, metres.
        border: Distance ahead of the anchor where the bends begin, metres.
        exponent: Exponent of the turns, 2..8.
        anchor: focal, ego, an agent's id, or a pose x,y,heading in metres and degrees.
        friction: Slow agents to the speed that this friction coefficient allows.
        current: Seconds of the recording that count as observed; the last of their steps becomes the current one.
        until: Seconds after the current step that are kept, such as 6.
        around: Metres in the file's frame, about which a square of its map is used; for maps beyond the limits of a scene.
        radius: Half the side of that square.
        densest: Use the N squares with the greatest length of lanes, each as a scene of its own.
        focal: Id of the agent that becomes the focal one.
        name: Id of the warped scenario, such as 000c4929-double-turn-p6.
        overwrite: Replace what an earlier run wrote.
        engine: Processes of this machine, or Ray (extra "cluster"), for several scenes.
        address: Address of a Ray cluster, such as auto or head:6379; a new one on this machine unless given.
        workers: Scenes at a time, each in a process of its own; they do not change the results.
    """
    # Numbers are validated before files are read: cheap checks first.
    terms = _terms(kind, power, length, border, exponent)
    session = EditorSession(
        open_scenario(
            scenario, current_s=current, until_s=until, around=around, radius_m=radius
        )
    )
    if focal:
        session.apply(SetFocalAgent(agent_id=focal))
    command = SetRoadWarp(
        warp=RoadWarp(anchor=_anchor_pose(session.scenario, anchor), terms=terms),
        friction_coefficient=None if friction is None else float(friction),
    )
    session.describe(described(name))
    session.apply(command)
    folder = write_session(out, session, overwrite=overwrite)
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


def _terms(
    kind: WarpKind | tuple[WarpKind, ...],
    power: float | tuple[float, ...],
    length: float | tuple[float, ...],
    border_m: float,
    exponent: float,
) -> tuple[WarpTerm, ...]:
    kinds = (kind,) if isinstance(kind, str) else tuple(kind)
    powers = (power,) if isinstance(power, (int, float)) else tuple(power)
    lengths = (length,) if isinstance(length, (int, float)) else tuple(length)
    if not kinds:
        raise EditError(f"No kind was given; choose among {', '.join(WARP_KINDS)}.")
    if len(set(kinds)) != len(kinds):
        raise EditError("A kind was given twice; each may be used once.")
    for noun, values in (("powers", powers), ("lengths", lengths)):
        if len(values) != len(kinds) and (values or noun == "powers"):
            raise EditError(
                f"{len(kinds)} kinds and {len(values)} {noun} were given; expected as "
                f"many {noun} as kinds."
            )
    return tuple(
        WarpTerm(
            kind=one,
            power=float(powers[index]),
            length_m=float(lengths[index]) if lengths else DEFAULT_LENGTH_M[one],
            border_m=float(border_m),
            exponent=float(exponent),
        )
        for index, one in enumerate(kinds)
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
