"""``pd-editor generate``: regenerate trajectories, or resample all traffic."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from pd_editor.analysis.findings.check import scene_findings
from pd_editor.analysis.findings.sample_ranking import Ranking
from pd_editor.analysis.guidance.report import guidance_problems
from pd_editor.base.errors import GenerationError
from pd_editor.cli.many_scenes import ManyOptions, PartsOptions, over_scenes
from pd_editor.cli.options import (
    FocalOption,
    NameOption,
    Number,
    Switch,
    WishOptions,
    agents_within,
    driven_agents,
    kept_remarks,
    several,
    shown,
    wanted_kinds,
)
from pd_editor.cli.output import (
    GuidanceTable,
    Outcome,
    SampleTable,
    edited_session,
    reports_of,
    run_showing_progress,
    write_session,
)
from pd_editor.editor.commands import (
    AddGuidance,
    Command,
    SetAgentActivity,
    SetFocalAgent,
    traffic_command,
)
from pd_editor.editor.commands.locks import apply_within_locks
from pd_editor.editor.edit_findings import edit_findings
from pd_editor.editor.scenario_store import check_free, open_part
from pd_editor.editor.session import EditorSession
from pd_editor.editor.variant import name_from_text, short_id
from pd_editor.generation.defaults import DEFAULT_WEIGHT, NUM_TRIES, DeviceName
from pd_editor.generation.features.map_pieces import lane_pieces
from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.scene.agent_kind import ROAD_USER_KINDS, Activity, AgentKind
from pd_editor.scene.generation import (
    GenerationRequest,
    Quality,
    Region,
    ScenarioGenerator,
    check_placed,
    check_room,
    check_supported,
    guidance_settings,
    supported_by,
)
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.roles.traffic_choice import (
    replaceable_agent_ids,
    resamplable_agent_ids,
)
from pd_editor.scene.scenario import Scenario

_Ids = Annotated[str | tuple[str, ...], shown("ID [ID ...]", "(optional)")]


@dataclass(frozen=True, kw_only=True)
class GenerateOptions(WishOptions, PartsOptions, ManyOptions):
    """Options of ``pd-editor generate``.

    Args:
        out: Folder that receives DIR/<name>/; several samples get -1, -2, ...
        agents: Ids of the agents to drive; the others keep their trajectories. Without ids all are driven, and those that the recording shows later in their way are left out.
        resample_states: Resample the initial states of these agents, too. Without a region, agents more than 20 m from all lanes keep theirs.
        num_agents: Replace all agents but the ego and the focal agent by new ones: 20 (vehicles), vehicle=12 pedestrian=4, or fit (as many as suit the road).
        add: Keep the present agents and add the new ones.
        replace_ego_and_focal: Let new agents replace the ego and the focal agent as well.
        moving_share: Fraction of the sampled agents of each kind that moves, 0 to 1.
        only_on_road: Sample no vehicles far from lanes, such as on parking lots.
        no_past: Give agents whose states are sampled no made-up past; loaders that look for agents at the last observed steps then see a single state of them.
        region: Square in metres of the scene or of the city: agents in it alone are regenerated, resampled or replaced, and states are sampled in it.
        only_kinds: Kinds of the agents that are regenerated, resampled or replaced; the others are kept.
        parked: Ids of standing agents that are parked; fewer of them start.
        waiting: Ids of standing agents that wait in traffic.
        quality: Quality of sampled states: fast, or high with more denoising steps.
        samples: Number of samples; several are listed in a table with their numbers, which DIR/<name>-samples.csv keeps.
        rank: Order of the table: realism (fewest problems), collisions (fewest), off-road (least), interaction (closest) or movement (most).
        pick: Write only so many samples, the most diverse ones.
        steps: Denoising steps of trajectories; the shipped model has 5. For states the model has its own number.
        keep_to_lanes: Strength of the guidance towards the lanes, from 0 for none to 1.
        tries: Trajectories sampled per agent, of which the least colliding combination is used; agents that would still collide yield. 0: no collision is avoided; with --keep-to-lanes 0 as well: the raw model.
        no_yielding: Do not slow agents that would collide.
        model: path-diffuser, lane-follower (trajectories only), the folder of a trained model, or a generator or predictor of your own as package.module:attribute.
        device: Where a model computes; auto takes a GPU if there is one.
        focal: Id of the agent that becomes the focal one.
        name: Id of the new scenario, such as 000c4929-s3.
        overwrite: Replace what earlier runs wrote.
    """

    agents: Annotated[
        str | tuple[str, ...], shown("ID [ID ...]", "(default: all)")
    ] = ()
    resample_states: Switch = False
    num_agents: Annotated[
        str | int | tuple[str, ...], shown("N|KIND=N|fit", "(optional)")
    ] = ()
    add: Switch = False
    replace_ego_and_focal: Switch = False
    moving_share: Annotated[float | None, shown("P", "(as on such roads)")] = None
    only_on_road: Switch = False
    no_past: Switch = False
    region: Annotated[
        tuple[float, float, float] | None, shown("X Y HALF_SIDE", "(optional)")
    ] = None
    only_kinds: Annotated[
        str | tuple[str, ...], shown("KIND [KIND ...]", "(default: all)")
    ] = ()
    parked: _Ids = ()
    waiting: _Ids = ()
    quality: Quality = "fast"
    samples: Number = 1
    rank: Annotated[Ranking, shown("METRIC")] = "realism"
    pick: Annotated[int | None, shown("K", "(default: all)")] = None
    steps: Annotated[int | None, shown("N", "(default: the model's own)")] = None
    keep_to_lanes: Annotated[
        float | None, shown("W", f"(default: {DEFAULT_WEIGHT})")
    ] = None
    tries: Annotated[int | None, shown("N", f"(default: {NUM_TRIES})")] = None
    no_yielding: Switch = False
    model: Annotated[str, shown("NAME")] = DEFAULT_GENERATOR
    device: DeviceName = "auto"
    focal: FocalOption = ""
    name: NameOption = ""

    @property
    def samples_agents(self) -> bool:
        """Whether new agents are asked for."""
        return self.num_agents != ()

    def edits(self) -> tuple[Command, ...]:
        """What is edited before anything is generated.

        Raises:
            GenerationError: an agent is parked and waits, or a lock cannot be read.
            InputError: a guidance term cannot be read.
        """
        return (
            *([SetFocalAgent(agent_id=self.focal)] if self.focal else []),
            *_activities(several(self.parked), several(self.waiting)),
            *self.wishes(),
        )


@over_scenes(GenerateOptions)
def generate(scenario: str, options: GenerateOptions) -> Outcome:
    """Regenerate trajectories, or resample all traffic if the model can."""
    generator = make_generator(options.model, device=options.device)
    opened = open_part(scenario, options.cut)
    edits = options.edits()
    terms = tuple(one.term for one in edits if isinstance(one, AddGuidance))
    base = edited_session(opened, edits).scenario
    request, removed = _request(options, opened, base)
    _check_supports(generator, request, has_terms=bool(terms))
    names = _names(opened, options.name, request)
    for one in names:
        check_free(options.out, one, opened, overwrite=options.overwrite)
    _tell_problems(request, terms)
    check_room(request, len(removed))
    traffic = run_showing_progress(generator.generate(request))
    check_placed(traffic, len(removed))
    commands = [
        traffic_command(request, traffic, index, removed_ids=removed)
        for index in range(len(names))
    ]
    table, written = None, list(range(len(names)))
    if options.samples > 1:
        recorded = scene_findings(opened)
        results = (
            (one, edit_findings(one, opened, (*edits, command), recorded))
            for command in commands
            for one in (apply_within_locks(command, base),)
        )
        drawn = [one.sample for one in commands]
        table = SampleTable.of(results, drawn, options.rank, options.pick)
        written = sorted(table.picked)
    sessions = [
        edited_session(opened, (*edits, commands[index]), names[index])
        for index in written
    ]
    guidance = GuidanceTable(
        names=tuple(names[index] for index in written),
        reports=reports_of(traffic.guidance, written),
    )
    return Outcome(
        folders=_write(options, sessions, names, table, guidance),
        scenarios=tuple(session.scenario for session in sessions),
        remarks=(
            *(() if table is None else table.lines(names)),
            *(guidance.lines() if guidance.reports else ()),
            *kept_remarks(base, several(options.agents), request.agent_ids),
            *traffic.notes,
            *(note for index in written for note in commands[index].notes),
            *traffic.measures,
        ),
    )


def _request(
    options: GenerateOptions, opened: Scenario, base: Scenario
) -> tuple[GenerationRequest, tuple[str, ...]]:
    """What to generate, and ids of the agents that it replaces."""
    region = None if options.region is None else _region(opened, *options.region)
    counts, fits = _wanted_counts(options.num_agents)
    _refuse_contradictions(options)
    removed, driven = _roles(options, base, region)
    places = options.resample_states or options.samples_agents
    return GenerationRequest(
        scenario=base.without_agents(removed),
        agent_ids=driven,
        num_new_agents=counts,
        samples_num_agents=fits,
        resampled_state_ids=resamplable_agent_ids(base, driven)
        if options.resample_states
        else (),
        moving_share=options.moving_share,
        only_on_road=options.only_on_road,
        back_casts=not options.no_past,
        region=region if places else None,
        quality=options.quality,
        num_samples=options.samples,
        num_denoising_steps=options.steps,
        guidance=guidance_settings(
            options.keep_to_lanes, options.tries, yields=not options.no_yielding
        ),
        seed=options.seed,
    ), removed


def _write(
    options: GenerateOptions,
    sessions: Sequence[EditorSession],
    names: Sequence[str],
    table: SampleTable | None,
    guidance: GuidanceTable,
) -> tuple[Path, ...]:
    """Write the scenarios and the tables that go with them."""
    out = Path(options.out)
    folders = tuple(
        write_session(out, session, overwrite=options.overwrite) for session in sessions
    )
    whole = names[0].removesuffix("-1")
    if table is not None:
        table.write(out / f"{whole}-samples.csv", names)
    if guidance.reports:
        guidance.write(out / f"{whole}-guidance.csv")
    return folders


def _check_supports(
    generator: ScenarioGenerator, request: GenerationRequest, *, has_terms: bool
) -> None:
    """Raise for what the generator cannot do."""
    supports = supported_by(generator)
    check_supported(request, supports, generator.name)
    if has_terms and "guidance" not in supports:
        raise GenerationError(
            f"--guide: the generator {generator.name} takes no guidance; leave --guide "
            "out, or choose a generator that does, such as path-diffuser."
        )


def _tell_problems(request: GenerationRequest, terms: tuple[GuidanceTerm, ...]) -> None:
    """Write what is doubtful about guidance to stderr."""
    problems = guidance_problems(
        request.scenario, terms, None if request.adds_agents else request.agent_ids
    )
    for problem in problems:
        if problem.severity == "error":
            raise GenerationError(f"--guide: {problem.message}")
        sys.stderr.write(f"Warning: {problem.message}\n")


def _activities(
    parked: tuple[str, ...], waiting: tuple[str, ...]
) -> tuple[SetAgentActivity, ...]:
    """The edits that set activities."""
    both = sorted(set(parked) & set(waiting))
    if both:
        raise GenerationError(
            f"Agent {both[0]} is named by --parked and by --waiting; give one of them."
        )
    lists = ((parked, Activity.PARKED), (waiting, Activity.WAITING))
    return tuple(
        SetAgentActivity(agent_ids=ids, activity=activity)
        for ids, activity in lists
        if ids
    )


def _names(opened: Scenario, name: str, request: GenerationRequest) -> tuple[str, ...]:
    count = request.num_samples
    name = name or name_from_text(f"{short_id(opened.scenario_id)} s{request.seed}")
    if count == 1:
        return (name,)
    return tuple(f"{name}-{number}" for number in range(1, count + 1))


def _wanted_counts(
    asked: str | int | Sequence[str],
) -> tuple[dict[AgentKind, int], bool]:
    """Number of new agents of each kind, and whether the model chooses it."""
    texts = str(asked).split() if isinstance(asked, str | int) else map(str, asked)
    texts = tuple(texts)
    if texts == ("fit",):
        return {}, True
    counts: dict[AgentKind, int] = {}
    for text in texts:
        name, _, number = text.rpartition("=")
        name = name or AgentKind.VEHICLE.value
        if name not in {kind.value for kind in ROAD_USER_KINDS} or not (
            number.isascii() and number.isdigit() and len(number) <= 9
        ):
            names = ", ".join(sorted(kind.value for kind in ROAD_USER_KINDS))
            raise GenerationError(
                f"--num-agents: {text!r} is neither a number, nor KIND=NUMBER with a "
                f"kind out of {names}, nor fit alone."
            )
        counts[AgentKind(name)] = counts.get(AgentKind(name), 0) + int(number)
    return counts, False


def _region(scenario: Scenario, x: float, y: float, half_side: float) -> Region:
    """Region around a road, given in the scene frame or else in the city frame."""
    asked = Region(center_m=(0.0, 0.0), half_side_m=half_side)
    points = lane_pieces(scenario.road_map).pose[:, :2]
    frames = {"scene": np.zeros(2), "city": scenario.origin_city_m}
    for origin in frames.values():
        place = np.array([x, y]) - origin
        if (np.abs(points - place) <= half_side).all(axis=1).any():
            return replace(asked, center_m=(float(place[0]), float(place[1])))
    if not len(points):
        raise GenerationError("--region: there is no road in this scene.")
    low, high = points.min(axis=0), points.max(axis=0)
    lie = " or ".join(
        f"x from {low[0] + at[0]:.0f} to {high[0] + at[0]:.0f} and y from "
        f"{low[1] + at[1]:.0f} to {high[1] + at[1]:.0f} m in the frame of the {name}"
        for name, at in frames.items()
    )
    raise GenerationError(
        f"--region: there is no road within {half_side:g} m of ({x:g}, {y:g}); roads lie "
        f"at {lie}."
    )


def _refuse_contradictions(options: GenerateOptions) -> None:
    """Raise for options that contradict each other, or are out of range."""
    samples_agents, weight = options.samples_agents, options.keep_to_lanes
    if options.resample_states and samples_agents:
        raise GenerationError(
            "--resample-states is for agents that stay, --num-agents for new ones; give "
            "one of them."
        )
    if options.agents and samples_agents and not options.add:
        raise GenerationError(
            "--num-agents puts new agents in the place of all, so no agent is left for "
            "--agents; give --add to keep them."
        )
    if options.add and not samples_agents:
        raise GenerationError("--add needs --num-agents, which says how many.")
    if options.replace_ego_and_focal and (options.add or not samples_agents):
        raise GenerationError(
            "--replace-ego-and-focal needs --num-agents without --add: new agents "
            "replace nothing otherwise."
        )
    if weight is not None and not 0 <= weight <= 1:
        raise GenerationError(f"--keep-to-lanes must be between 0 and 1, not {weight}.")
    if options.pick is not None and not 1 <= options.pick <= options.samples:
        raise GenerationError(
            f"--pick is {options.pick}; expected 1 to {options.samples}, the number of "
            "samples."
        )


def _roles(
    options: GenerateOptions, opened: Scenario, region: Region | None
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Ids of the agents that are replaced, and of those whose trajectories are generated.

    As in the browser, the ego and the focal agent stay by default, so that an export
    keeps the two tracks that predictors and data sets need; so do locked agents. Of a
    region, or of some kinds, only those agents count.
    """
    removed, samples_agents = (), options.samples_agents
    kinds, wanted = wanted_kinds(several(options.only_kinds)), several(options.agents)
    if samples_agents and not options.add:
        keeps = not options.replace_ego_and_focal
        removed = replaceable_agent_ids(opened, keeps_ego=keeps, keeps_focal=keeps)
        removed = agents_within(opened, removed, kinds, region)
    if samples_agents and not (wanted and options.add):
        return removed, ()
    place = None if samples_agents else region
    return removed, driven_agents(opened, wanted, kinds, place)
