"""``pd-editor drive``: roll a scene out, with policies that drive one of its agents."""

from pathlib import Path
from typing import Annotated

import tyro

from pd_editor.cli.many_scenes import SCENE_FILES, over_scenes
from pd_editor.cli.options.arguments import (
    AddressOption,
    FolderOption,
    NameOption,
    OptionalWorkers,
    Switch,
    several,
)
from pd_editor.cli.output.outcome import Outcome, described, write_session
from pd_editor.cli.output.progress import ProgressLine
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.editor.session import EditorSession
from pd_editor.editor.variant import name_from_text, short_id
from pd_editor.experiments.closed_loop.policies import policy_of
from pd_editor.experiments.closed_loop.roll_out import (
    RollOut,
    RollOutRequest,
    roll_out,
    route_of,
)
from pd_editor.experiments.closed_loop.scores import drive_scores
from pd_editor.experiments.work_engine import EngineName
from pd_editor.generation.generators import SHIPPED_MODEL, make_generator
from pd_editor.scene.generation import ScenarioGenerator
from pd_editor.scene.scenario import EGO_ID, Scenario


@over_scenes(SCENE_FILES)
def drive(
    scenario: str | Path,
    /,
    *,
    out: FolderOption,
    policies: Annotated[
        str | tuple[str, ...],
        tyro.conf.arg(metavar="NAME [NAME ...]", help_behavior_hint="(optional)"),
    ] = (),
    ego: Annotated[str, tyro.conf.arg(metavar="ID")] = EGO_ID,
    seconds: Annotated[float, tyro.conf.arg(metavar="S")] = 30.0,
    replan: Annotated[float, tyro.conf.arg(metavar="S")] = 1.0,
    enter: Switch = True,
    seed: int = 0,
    model: Annotated[str, tyro.conf.arg(metavar="NAME")] = SHIPPED_MODEL,
    name: NameOption = "",
    overwrite: Switch = False,
    engine: EngineName = "local",  # noqa: ARG001
    address: AddressOption = None,  # noqa: ARG001
    workers: OptionalWorkers = None,  # noqa: ARG001
) -> Outcome:
    """Roll scenes out in closed loop: traffic that answers, around policies that drive.

    Each policy drives the same agent through a roll-out of its own; without policies the
    traffic is rolled out alone.

    Args:
        scenario: Demos, Argoverse 2 scenario folders, files of other formats, folders of these, or patterns; demos for all demos. What is written already stays as it is.
        out: Folder that receives DIR/<name>/, one for each policy.
        policies: log-replay, constant-velocity, idm, installed ones, or package.module:attribute.
        ego: Id of the agent that they drive.
        seconds: Length of a roll-out.
        replan: Seconds between two generations of the traffic, 0.5 to 3.
        enter: Vehicles enter for those that leave the map.
        seed: Random seed.
        model: What generates the traffic.
        name: Name of the result, to which the policy's is added.
        overwrite: Replace what an earlier run wrote.
        engine: Processes of this machine, or Ray (extra "cluster"), for several scenes.
        address: Address of a Ray cluster, such as auto or head:6379; a new one on this machine unless given.
        workers: Scenes at a time, each in a process of its own; they do not change the results.
    """
    chosen = [policy_of(one) for one in several(policies)] or [None]
    opened = open_scenario(scenario)
    generator = make_generator(model)
    folders: list[Path] = []
    scenarios: list[Scenario] = []
    remarks: list[str] = []
    for policy in chosen:
        request = RollOutRequest(
            scenario=opened,
            duration_s=float(seconds),
            replan_s=float(replan),
            policies={} if policy is None else {ego: policy},
            keeps_density=enter,
            seed=seed,
        )
        label = "roll-out" if policy is None else policy.name
        rolled = _rolled_out(request, generator, label)
        session = EditorSession(opened)
        given = f"{name or short_id(opened.scenario_id)} {label} s{seed}"
        session.describe(described(name_from_text(given)))
        session.apply(rolled.command)
        folders.append(write_session(out, session, overwrite=overwrite))
        scenarios.append(session.scenario)
        if policy is not None:
            scores = drive_scores(rolled.scenario, ego, route_of(opened, ego))
            ended = "".join(f" {one}" for one in rolled.ended.values())
            remarks.append(f"{policy.name}: {scores.in_words}.{ended}")
    return Outcome(
        folders=tuple(folders), scenarios=tuple(scenarios), remarks=tuple(remarks)
    )


def _rolled_out(
    request: RollOutRequest, generator: ScenarioGenerator, label: str
) -> RollOut:
    """Roll out with progress on stderr."""
    steps, line = roll_out(request, generator), ProgressLine()
    while True:
        try:
            line.show(f"{label}: {next(steps).message}")
        except StopIteration as stop:
            line.clear()
            return stop.value
