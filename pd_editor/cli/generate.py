"""``pd-editor generate``: redraw futures, or whole traffic."""

from collections.abc import Sequence
from typing import Annotated

import tyro

from pd_editor.cli.arguments import FolderOption, ScenarioArgument, Switch
from pd_editor.cli.outcome import Outcome, write_session
from pd_editor.cli.progress import run_showing_progress
from pd_editor.editor.commands import traffic_command
from pd_editor.editor.session import EditorSession
from pd_editor.errors import GenerationError
from pd_editor.generation import GenerationRequest
from pd_editor.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.scenario_store import check_free, open_scenario
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.traffic_choice import drivable_agent_ids


def generate(
    scenario: ScenarioArgument,
    /,
    *,
    out: FolderOption,
    agents: Annotated[
        tuple[str, ...],
        tyro.conf.arg(metavar="ID [ID ...]", help_behavior_hint="(default: all)"),
    ] = (),
    num_agents: Annotated[
        int | None, tyro.conf.arg(metavar="N", help_behavior_hint="(optional)")
    ] = None,
    samples: Annotated[int, tyro.conf.arg(metavar="N")] = 1,
    seed: Annotated[int, tyro.conf.arg(metavar="N")] = 0,
    model: Annotated[str, tyro.conf.arg(metavar="NAME")] = DEFAULT_GENERATOR,
    overwrite: Switch = False,
) -> Outcome:
    """Keep agents and their states, redraw their futures.

    Args:
        scenario: A demo's name or an Argoverse 2 scenario folder.
        out: Folder that receives DIR/<scenario id>/; several samples get _s00, _s01.
        agents: Ids of the agents to drive; the others keep their futures.
        num_agents: Add N vehicles with states of the model's choosing, if it can.
        samples: How many futures to draw.
        seed: Seed of the draw; the same seed gives the same files.
        model: Name of the generator.
        overwrite: Replace what earlier runs wrote.
    """
    if samples < 1:
        raise GenerationError(f"{samples} samples were asked for; expected 1 or more.")
    generator = make_generator(model)
    opened = open_scenario(scenario)
    wanted = tuple(dict.fromkeys(agents))
    request = GenerationRequest(
        scenario=opened,
        agent_ids=drivable_agent_ids(opened, wanted or None),
        num_new_agents={} if num_agents is None else {AgentKind.VEHICLE: num_agents},
        num_samples=samples,
        seed=seed,
    )
    ending = [""] if samples == 1 else [f"_s{index:02d}" for index in range(samples)]
    names = [f"{opened.scenario_id}{end}" for end in ending]
    for name in names:
        check_free(out, name, opened, overwrite=overwrite)
    traffic = run_showing_progress(generator.generate(request))
    sessions = [EditorSession(opened) for _ in names]
    for index, session in enumerate(sessions):
        session.apply(traffic_command(request, traffic, index))
    return Outcome(
        folders=tuple(
            write_session(out, name, session, overwrite=overwrite)
            for name, session in zip(names, sessions, strict=True)
        ),
        scenarios=tuple(session.scenario for session in sessions),
        remarks=(*_left_out(opened, wanted, request.agent_ids), *traffic.notes),
    )


def _left_out(
    scenario: Scenario, wanted: Sequence[str], driven: Sequence[str]
) -> tuple[str, ...]:
    """A word about agents that were named but cannot be driven."""
    step = scenario.current_step
    return tuple(
        f"Agent {name} keeps its future: it is "
        + (
            f"a {scenario.agents.kinds[row].value}, not a road user."
            if scenario.agents.is_valid[row, step]
            else "not there at the current step."
        )
        for name, row in zip(wanted, scenario.agents.rows(wanted), strict=True)
        if name not in driven
    )
