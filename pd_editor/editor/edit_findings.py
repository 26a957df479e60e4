"""The one list of findings of an edited scenario: of its traffic, road and guidance."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from pd_editor.analysis.findings.check import SceneCheck, checked, scene_findings
from pd_editor.analysis.findings.finding import (
    Finding,
    FindingKind,
    Source,
    capitalised,
)
from pd_editor.analysis.guidance.report import term_outcomes
from pd_editor.editor.commands.command import Command, parts_of
from pd_editor.editor.commands.guidance import AddGuidance, ChangeGuidance
from pd_editor.editor.commands.motion import AdoptTrajectory, PullSpeed
from pd_editor.editor.commands.poses import PoseCommand
from pd_editor.editor.commands.roll_out import BeginAt, begun_like
from pd_editor.editor.commands.traffic import ReplaceTraffic
from pd_editor.scene.generation import GuidanceSetting, TrafficSample
from pd_editor.scene.guidance_terms import GuidanceTerm, TermOutcome
from pd_editor.scene.scenario import Scenario


def edit_findings(
    scenario: Scenario,
    base: Scenario,
    commands: Sequence[Command],
    recorded: Iterable[Finding] | None = None,
    *,
    with_future: bool = True,
) -> SceneCheck:
    """Findings of a scenario that commands made from ``base``, each with its source.

    ``recorded`` are the findings of ``base``, from the moment on that is the current one
    by now; they are looked for if not given.
    """
    original = begun_like(base, commands)
    if recorded is None:
        recorded = scene_findings(original)
    found = checked(scenario, original, recorded, with_future=with_future)
    origin = _origins(scenario, commands)
    new = [replace(one, source=_source(one, origin)) for one in found.new]
    new += _not_run(scenario, commands)
    if with_future:
        outcomes = scene_outcomes(scenario, commands)
        new += [
            _of_term(scenario, "guidance-not-met", one.term, _in_words(one), one.error)
            for one in outcomes
            if not one.is_obeyed
        ]
    drawn = _samples(commands)
    return replace(
        found, new=tuple(replace(one, sample=_sample(one, drawn)) for one in new)
    )


def unrun_terms(
    scenario: Scenario, commands: Sequence[Command]
) -> tuple[GuidanceTerm, ...]:
    """Terms in force that were set after their agents were last generated."""
    # A term moves with a warped road, so kind and agents tell which one it is.
    in_force = {
        (term.kind, term.named_ids): term for term in scenario.guidance if term.is_on
    }
    generated: set[str] = set()
    found: dict[GuidanceTerm, None] = {}
    for part in parts_of(commands if in_force else (), Command)[::-1]:
        if isinstance(part, ReplaceTraffic):
            generated.update(part.sample.ids)
        elif isinstance(part, AddGuidance | ChangeGuidance):
            term = in_force.get((part.term.kind, part.term.named_ids))
            guided = part.term.guided_ids
            if term and (generated.isdisjoint(guided) if guided else not generated):
                found[term] = None
    return tuple(term for term in scenario.guidance if term in found)


def scene_outcomes(
    scenario: Scenario, commands: Sequence[Command]
) -> tuple[TermOutcome, ...]:
    """What the terms that were run ask, and what the scenario's trajectories achieve."""
    agents, now = scenario.agents, scenario.current_step
    generated: set[str] = set()
    own: list[GuidanceTerm] = []
    for part in parts_of(commands, Command)[::-1]:
        if isinstance(part, BeginAt):
            break
        if isinstance(part, ReplaceTraffic):
            own += [
                term
                for term in _own_terms(part)
                if set(term.guided_ids or part.sample.ids) - generated
            ]
            generated.update(part.sample.ids)
    unrun = unrun_terms(scenario, commands)
    terms = [one for one in (*scenario.guidance, *own) if one.is_on]
    terms = [one for one in terms if one not in unrun]
    rows = [
        row
        for row, name in enumerate(agents.ids)
        if name in generated and agents.is_valid[row, now:].all()
    ]
    if not terms or not rows:
        return ()
    sample = TrafficSample.of(agents.taken(rows).from_step(now))
    return term_outcomes(scenario, sample, terms)


def guidance_in_words(scenario: Scenario, commands: Sequence[Command]) -> list[str]:
    """What each term in force asks and what is achieved, or that it was not run."""
    return [
        *(
            f"{one.term.in_words}: asked {one.asked}, achieved {one.achieved}"
            for one in scene_outcomes(scenario, commands)
        ),
        *(f"{term.in_words}: not run" for term in unrun_terms(scenario, commands)),
    ]


def _own_terms(traffic: ReplaceTraffic) -> list[GuidanceTerm]:
    """Terms of a run that the scenario does not hold."""
    asked = () if traffic.request.is_unguided else traffic.request.guidance
    return [one for one in asked if not isinstance(one, GuidanceSetting)]


def _not_run(scenario: Scenario, commands: Sequence[Command]) -> list[Finding]:
    return [
        _of_term(scenario, "guidance-not-run", term, "was not run", 0.0)
        for term in unrun_terms(scenario, commands)
    ]


def _in_words(outcome: TermOutcome) -> str:
    return f"was not met: asked {outcome.asked}, achieved {outcome.achieved}"


def _of_term(
    scenario: Scenario, kind: FindingKind, term: GuidanceTerm, words: str, error: float
) -> Finding:
    agents, now = scenario.agents, scenario.current_step
    there = [agents.row_of[name] for name in term.guided_ids if name in agents.row_of]
    place = agents.position_m[there or np.flatnonzero(agents.is_valid[:, now]), now]
    x, y = place.mean(axis=0).tolist() if len(place) else (0.0, 0.0)
    name = capitalised(term.in_words)
    return Finding(
        kind=kind,
        agent_ids=tuple(agents.ids[row] for row in there),
        spans=(),
        worst_step=now,
        value=float(np.nan_to_num(error)),
        limit=0.0,
        headline=f"{name} {words.split(':')[0]}",
        message=f"{name} {words}.",
        place_m=(x, y),
        about=about_term(term),
        source="guidance",
    )


def about_term(term: GuidanceTerm) -> str:
    """What a finding of a term is about: a moved road does not change it."""
    return " ".join((term.kind, *term.named_ids))


def _origins(scenario: Scenario, commands: Iterable[Command]) -> dict[str, Source]:
    """What set the present trajectory of each agent that edits have touched."""
    terms = [term for term in scenario.guidance if term.is_on]
    origin: dict[str, Source] = {}
    for part in parts_of(commands, Command):
        if not isinstance(part, ReplaceTraffic):
            origin.update(dict.fromkeys(edited_by(part), "edited"))
            continue
        own = _own_terms(part)
        for name in part.sample.ids:
            guided = not part.request.is_unguided and any(
                not term.guided_ids or name in term.guided_ids
                for term in (*terms, *own)
            )
            origin[name] = "guidance" if guided else "model"
    return origin


def _samples(commands: Iterable[Command]) -> dict[str, str]:
    """Sample that each agent's trajectory is from; reactions to edits continue it."""
    return {
        name: f"{part.generator} {part.seed} {part.request.sample_index}"
        for part in commands
        if isinstance(part, ReplaceTraffic)
        for name in part.sample.ids
    }


def _sample(finding: Finding, drawn: dict[str, str]) -> str:
    followed = {drawn.get(name, "") for name in finding.agent_ids} - {""}
    return " + ".join(sorted(followed))


def edited_by(part: Command) -> set[str]:
    """Ids of the agents that a command names."""
    found: set[str] = set()
    for name in ("agent_ids", "new_ids"):
        found.update(getattr(part, name, ()))
    found.update(filter(None, (getattr(part, "agent_id", ""),)))
    return found


def _source(finding: Finding, origin: dict[str, Source]) -> Source:
    """Source of a finding: of several agents', the one furthest from the recording."""
    order: tuple[Source, ...] = ("edited", "model", "guidance")
    ranks = [order.index(origin.get(name, "edited")) for name in finding.agent_ids]
    return order[max(ranks, default=0)]


def carried_agent_ids(commands: Iterable[Command]) -> frozenset[str]:
    """Ids of agents whose trajectory was moved together with their pose.

    An agent leaves the set when its trajectory is regenerated.
    """
    carried: set[str] = set()
    for command in parts_of(commands, Command):
        if isinstance(command, PoseCommand):
            carried |= edited_by(command)
        elif isinstance(command, AdoptTrajectory):
            carried.discard(command.agent_id)
        elif isinstance(command, ReplaceTraffic):
            carried.difference_update(command.sample.ids)
    return frozenset(carried)


def generated_agent_ids(commands: Iterable[Command]) -> frozenset[str]:
    """Ids of agents whose trajectory is generated, and not chosen by hand since."""
    generated: set[str] = set()
    for command in parts_of(commands, Command):
        if isinstance(command, ReplaceTraffic):
            generated.update(command.sample.ids)
        elif isinstance(command, AdoptTrajectory | PullSpeed):
            generated.discard(command.agent_id)
    return frozenset(generated)
