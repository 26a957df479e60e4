"""``pd-editor generate``: redraw futures, or whole traffic."""

import sys
from pathlib import Path
from typing import Annotated

import tyro

from pd_editor.editor.commands import traffic_command
from pd_editor.editor.session import EditorSession
from pd_editor.errors import GenerationError
from pd_editor.generation import GenerationRequest, run_to_end
from pd_editor.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.scenario_store import export_into, open_scenario
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.traffic_choice import drivable_agent_ids


def generate(
    scenario: Annotated[str, tyro.conf.Positional],
    /,
    *,
    out: Path,
    agents: tuple[str, ...] = (),
    num_agents: int | None = None,
    samples: int = 1,
    seed: int = 0,
    model: str = DEFAULT_GENERATOR,
    overwrite: bool = False,
) -> tuple[Path, ...]:
    """Keep agents and their states, redraw their futures.

    Args:
        scenario: A demo's name or an Argoverse 2 scenario folder.
        out: Folder that receives OUT/<scenario id>/, or <scenario id>_s00, _s01, ...
            for several samples.
        agents: Ids of the agents to drive; all road users if not given.
        num_agents: Also draw the states of this many vehicles (needs a model that can).
        samples: How many futures to draw.
        seed: Seed of the draw; the same seed gives the same result.
        model: Name of the generator.
        overwrite: Replace what an earlier run wrote.
    """
    if samples < 1:
        raise GenerationError(f"{samples} samples were asked for; expected 1 or more.")
    opened = open_scenario(scenario)
    request = GenerationRequest(
        scenario=opened,
        agent_ids=drivable_agent_ids(opened, agents or None),
        num_new_agents={} if num_agents is None else {AgentKind.VEHICLE: num_agents},
        num_samples=samples,
        seed=seed,
    )
    traffic = run_to_end(make_generator(model).generate(request))
    folders = []
    for index in range(samples):
        session = EditorSession(opened)
        session.apply(traffic_command(request, traffic, sample_index=index))
        suffix = "" if samples == 1 else f"_s{index:02d}"
        folder = export_into(
            out,
            f"{opened.scenario_id}{suffix}",
            session.scenario,
            session.recipe(),
            overwrite=overwrite,
        )
        sys.stdout.write(f"{folder}\n")
        folders.append(folder)
    return tuple(folders)
