"""``pd-editor generate``: regenerate trajectories, or resample all traffic."""

import sys
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from pd_editor.analysis.findings.check import scene_findings
from pd_editor.analysis.findings.sample_ranking import Ranking
from pd_editor.analysis.guidance.feasibility import guidance_problems
from pd_editor.base.errors import GenerationError
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
    several,
)
from pd_editor.cli.options.guide_option import guidance_terms_of
from pd_editor.cli.options.kept_agents import (
    agents_within,
    driven_agents,
    kept_remarks,
    lock_commands,
    wanted_kinds,
)
from pd_editor.cli.output.guidance_table import GuidanceTable, reports_of
from pd_editor.cli.output.outcome import Outcome, described, write_session
from pd_editor.cli.output.progress import run_showing_progress
from pd_editor.cli.output.sample_table import SampleTable
from pd_editor.editor.commands import (
    AddGuidance,
    SampleSignals,
    SetAgentActivity,
    SetFocalAgent,
    traffic_command,
)
from pd_editor.editor.commands.locks import apply_within_locks
from pd_editor.editor.edit_findings import edit_findings
from pd_editor.editor.scenario_store import check_free, open_scenario
from pd_editor.editor.session import EditorSession
from pd_editor.editor.variant import name_from_text, short_id
from pd_editor.experiments.work_engine import EngineName
from pd_editor.generation.defaults import (
    DEFAULT_WEIGHT,
    NUM_TRIES,
    DeviceName,
)
from pd_editor.generation.features.lane_tokens import lane_pieces
from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.scene.activity import Activity
from pd_editor.scene.agent_kind import ROAD_USER_KINDS, AgentKind
from pd_editor.scene.generation import (
    GenerationRequest,
    GuidanceSetting,
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

AgentsOption = Annotated[
    str | tuple[str, ...],
    tyro.conf.arg(metavar="ID [ID ...]", help_behavior_hint="(default: all)"),
]
StandingOption = Annotated[
    str | tuple[str, ...],
    tyro.conf.arg(metavar="ID [ID ...]", help_behavior_hint="(optional)"),
]
NumAgentsOption = Annotated[
    str | int | tuple[str, ...],
    tyro.conf.arg(metavar="N|KIND=N|fit", help_behavior_hint="(optional)"),
]
GuideOption = Annotated[
    str | tuple[str, ...],
    tyro.conf.arg(metavar="TERM [TERM ...]", help_behavior_hint="(optional)"),
]
RegionOption = Annotated[
    tuple[float, float, float] | None,
    tyro.conf.arg(metavar="X Y HALF_SIDE", help_behavior_hint="(optional)"),
]
KindsOption = Annotated[
    str | tuple[str, ...],
    tyro.conf.arg(metavar="KIND [KIND ...]", help_behavior_hint="(default: all)"),
]
LocksOption = Annotated[
    str | tuple[str, ...],
    tyro.conf.arg(metavar="ID=WHAT [...]", help_behavior_hint="(optional)"),
]
StepsOption = Annotated[
    int | None,
    tyro.conf.arg(metavar="N", help_behavior_hint="(default: the model's own)"),
]
TriesOption = Annotated[
    int | None,
    tyro.conf.arg(metavar="N", help_behavior_hint=f"(default: {NUM_TRIES})"),
]
WeightOption = Annotated[
    float | None,
    tyro.conf.arg(metavar="W", help_behavior_hint=f"(default: {DEFAULT_WEIGHT})"),
]
ShareOption = Annotated[
    float | None, tyro.conf.arg(metavar="P", help_behavior_hint="(as on such roads)")
]
RankOption = Annotated[Ranking, tyro.conf.arg(metavar="METRIC")]
PickOption = Annotated[
    int | None, tyro.conf.arg(metavar="K", help_behavior_hint="(default: all)")
]


@over_scenes(SCENE_FILES)
def generate(
    scenario: str | Path,
    /,
    *,
    out: FolderOption,
    agents: AgentsOption = (),
    resample_states: Switch = False,
    num_agents: NumAgentsOption = (),
    add: Switch = False,
    replace_ego_and_focal: Switch = False,
    moving_share: ShareOption = None,
    only_on_road: Switch = False,
    no_past: Switch = False,
    region: RegionOption = None,
    only_kinds: KindsOption = (),
    lock: LocksOption = (),
    parked: StandingOption = (),
    waiting: StandingOption = (),
    sample_signals: Switch = False,
    quality: Quality = "fast",
    samples: Annotated[int, tyro.conf.arg(metavar="N")] = 1,
    rank: RankOption = "realism",
    pick: PickOption = None,
    steps: StepsOption = None,
    guide: GuideOption = (),
    keep_to_lanes: WeightOption = None,
    tries: TriesOption = None,
    no_yielding: Switch = False,
    seed: Annotated[int, tyro.conf.arg(metavar="N")] = 0,
    model: Annotated[str, tyro.conf.arg(metavar="NAME")] = DEFAULT_GENERATOR,
    device: DeviceName = "auto",
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
    """Regenerate trajectories, or resample all traffic if the model can.

    Args:
        scenario: Demos, Argoverse 2 scenario folders, files of other formats, folders of these, or patterns; demos for all demos. What is written already stays as it is.
        out: Folder that receives DIR/<name>/; several samples get -1, -2, ...
        agents: Ids of the agents to drive; the others keep their trajectories.
        resample_states: Resample the initial states of these agents, too. Without a region, agents more than 20 m from all lanes keep theirs.
        num_agents: Replace all agents but the ego and the focal agent by new ones: 20 (vehicles), vehicle=12 pedestrian=4, or fit (as many as suit the road).
        add: Keep the present agents and add the new ones.
        replace_ego_and_focal: Let new agents replace the ego and the focal agent as well.
        moving_share: Fraction of the sampled agents of each kind that moves, 0 to 1.
        only_on_road: Sample no vehicles far from lanes, such as on parking lots.
        no_past: Give agents whose states are sampled no made-up past; loaders that look for agents at the last observed steps then see a single state of them.
        region: Square in metres of the scene or of the city: agents in it alone are regenerated, resampled or replaced, and states are sampled in it.
        only_kinds: Kinds of the agents that are regenerated, resampled or replaced; the others are kept.
        lock: What is kept of single agents, as ID=WHAT: state, trajectory, or the first seconds of it, such as AV=2.5.
        parked: Ids of standing agents that are parked; fewer of them start.
        waiting: Ids of standing agents that wait in traffic.
        sample_signals: Give each junction a plausible phase, by which agents wait or go; it takes the place of the scene's signals.
        quality: Quality of sampled states: fast, or high with more denoising steps.
        samples: Number of samples; several are listed in a table with their numbers, which DIR/<name>-samples.csv keeps.
        rank: Order of the table: realism (fewest problems), collisions (fewest), off-road (least), interaction (closest) or movement (most).
        pick: Write only so many samples, the most diverse ones.
        steps: Denoising steps of trajectories; the shipped model has 5. For states the model has its own number.
        guide: What agents should do, as KIND:FIELD=VALUE,... such as goal-point:agent=12,point=3.5/10 (metres of the scene), target-speed:agents=12+13,speed=8, stop-at-line:agent=12,line=3/1+3/5, or a JSON file with a list of terms. DIR/<name>-guidance.csv tells what was achieved.
        keep_to_lanes: Strength of the guidance towards the lanes, from 0 for none to 1.
        tries: Trajectories sampled per agent, of which the least colliding combination is used; agents that would still collide yield. 0: no collision is avoided; with --keep-to-lanes 0 as well: the raw model.
        no_yielding: Do not slow agents that would collide.
        seed: Random seed; the same seed gives the same files.
        model: path-diffuser, lane-follower (trajectories only), the folder of a trained model, or a generator or predictor of your own as package.module:attribute.
        device: Where a model computes; auto takes a GPU if there is one.
        current: Seconds of the recording that count as observed; the last of their steps becomes the current one.
        until: Seconds after the current step that are kept, such as 6.
        around: Metres in the file's frame, about which a square of its map is used; for maps beyond the limits of a scene.
        radius: Half the side of that square.
        densest: Use the N squares with the greatest length of lanes, each as a scene of its own.
        focal: Id of the agent that becomes the focal one.
        name: Id of the new scenario, such as 000c4929-s3.
        overwrite: Replace what earlier runs wrote.
        engine: Processes of this machine, or Ray (extra "cluster"), for several scenes.
        address: Address of a Ray cluster, such as auto or head:6379; a new one on this machine unless given.
        workers: Scenes at a time, each in a process of its own; they do not change the results.
    """
    generator = make_generator(model, device=device)
    opened = open_scenario(
        scenario, current_s=current, until_s=until, around=around, radius_m=radius
    )
    terms = guidance_terms_of((guide,) if isinstance(guide, str) else guide)
    edits = (
        *([SetFocalAgent(agent_id=focal)] if focal else []),
        *_activities(several(parked), several(waiting)),
        *([SampleSignals(seed=seed)] if sample_signals else []),
        *(AddGuidance(term=term) for term in terms),
        *lock_commands(several(lock)),
    )
    kinds = wanted_kinds(several(only_kinds))
    session = EditorSession(opened)
    for command in edits:
        session.apply(command)
    base = session.scenario
    asked_region = None if region is None else _region(opened, *region)
    wanted, asks_number = several(agents), num_agents != ()
    counts, fits = _wanted_counts(num_agents)
    _refuse_contradictions(
        bool(wanted), asks_number, resample_states, add, replace_ego_and_focal
    )
    removed, driven = _roles(
        base, wanted, asks_number, add, replace_ego_and_focal, asked_region, kinds
    )
    request = GenerationRequest(
        scenario=base.without_agents(removed),
        agent_ids=driven,
        num_new_agents=counts,
        samples_num_agents=fits,
        resampled_state_ids=resamplable_agent_ids(base, driven)
        if resample_states
        else (),
        moving_share=moving_share,
        only_on_road=only_on_road,
        back_casts=not no_past,
        region=asked_region if resample_states or asks_number else None,
        quality=quality,
        num_samples=samples,
        num_denoising_steps=steps,
        guidance=_guidance(keep_to_lanes, tries, yields=not no_yielding),
        seed=seed,
    )
    if pick is not None and not 1 <= pick <= samples:
        raise GenerationError(
            f"--pick is {pick}; expected 1 to {samples}, the number of samples."
        )
    _check_supports(generator, request, has_terms=bool(terms))
    names = _names(opened, name, request)
    for one in names:
        check_free(out, one, opened, overwrite=overwrite)
    _tell_problems(request, terms)
    check_room(request, len(removed))
    traffic = run_showing_progress(generator.generate(request))
    check_placed(traffic, len(removed))
    commands = [
        traffic_command(request, traffic, index, removed_ids=removed)
        for index in range(len(names))
    ]
    table, written = None, range(len(names))
    if samples > 1:
        recorded = scene_findings(opened)
        results = (
            (one, edit_findings(one, opened, (*edits, command), recorded))
            for command in commands
            for one in (apply_within_locks(command, base),)
        )
        table = SampleTable.of(results, [one.sample for one in commands], rank, pick)
        written = sorted(table.picked)
    sessions = [EditorSession(opened) for _ in written]
    for index, session in zip(written, sessions, strict=True):
        session.describe(described(names[index]))
        for command in (*edits, commands[index]):
            session.apply(command)
    guidance = GuidanceTable(
        names=tuple(names[index] for index in written),
        reports=reports_of(traffic.guidance, list(written)),
    )
    folders = _write(out, sessions, names, table, guidance, overwrite=overwrite)
    return Outcome(
        folders=folders,
        scenarios=tuple(session.scenario for session in sessions),
        remarks=(
            *(() if table is None else table.lines(names)),
            *(guidance.lines() if guidance.reports else ()),
            *kept_remarks(base, wanted, driven),
            *traffic.notes,
            *(note for index in written for note in commands[index].notes),
            *traffic.measures,
        ),
    )


def _write(
    out: str | Path,
    sessions: Sequence[EditorSession],
    names: Sequence[str],
    table: SampleTable | None,
    guidance: GuidanceTable,
    *,
    overwrite: bool,
) -> tuple[Path, ...]:
    """Write the scenarios and the tables that go with them."""
    folders = tuple(
        write_session(out, session, overwrite=overwrite) for session in sessions
    )
    whole = names[0].removesuffix("-1")
    if table is not None:
        table.write(Path(out) / f"{whole}-samples.csv", names)
    if guidance.reports:
        guidance.write(Path(out) / f"{whole}-guidance.csv")
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
    adds = request.samples_num_agents or any(request.num_new_agents.values())
    problems = guidance_problems(
        request.scenario, terms, None if adds else request.agent_ids
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


def _refuse_contradictions(
    names_agents: bool,
    samples_agents: bool,
    resamples_states: bool,
    adds: bool,
    replaces_ego_and_focal: bool,
) -> None:
    """Raise for options that contradict each other."""
    if resamples_states and samples_agents:
        raise GenerationError(
            "--resample-states is for agents that stay, --num-agents for new ones; give "
            "one of them."
        )
    if names_agents and samples_agents and not adds:
        raise GenerationError(
            "--num-agents puts new agents in the place of all, so no agent is left for "
            "--agents; give --add to keep them."
        )
    if adds and not samples_agents:
        raise GenerationError("--add needs --num-agents, which says how many.")
    if replaces_ego_and_focal and (adds or not samples_agents):
        raise GenerationError(
            "--replace-ego-and-focal needs --num-agents without --add: new agents "
            "replace nothing otherwise."
        )


def _roles(
    opened: Scenario,
    wanted: tuple[str, ...],
    samples_agents: bool,
    adds: bool,
    replaces_ego_and_focal: bool,
    region: Region | None,
    kinds: Collection[AgentKind],
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Ids of the agents that are replaced, and of those whose trajectories are generated.

    As in the browser, the ego and the focal agent stay by default, so that an export
    keeps the two tracks that predictors and data sets need; so do locked agents. Of a
    region, or of some kinds, only those agents count.
    """
    removed = ()
    if samples_agents and not adds:
        keeps = not replaces_ego_and_focal
        removed = replaceable_agent_ids(opened, keeps_ego=keeps, keeps_focal=keeps)
        removed = agents_within(opened, removed, kinds, region)
    if samples_agents and not (wanted and adds):
        return removed, ()
    place = None if samples_agents else region
    return removed, driven_agents(opened, wanted, kinds, place)


def _guidance(
    weight: float | None, tries: int | None, *, yields: bool
) -> tuple[GuidanceSetting, ...]:
    if weight is not None and not 0 <= weight <= 1:
        raise GenerationError(f"--keep-to-lanes must be between 0 and 1, not {weight}.")
    return guidance_settings(weight, tries, yields=yields)
