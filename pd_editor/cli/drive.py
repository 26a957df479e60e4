"""``pd-editor drive``: roll scenes out, with policies that drive one of their agents."""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from pd_editor.base.errors import GenerationError, InputError
from pd_editor.base.regular_file import write_whole
from pd_editor.cli.many_scenes import ManyOptions, over_scenes
from pd_editor.cli.options import (
    NameOption,
    PartOptions,
    Switch,
    WishOptions,
    command_line,
    several,
    shown,
)
from pd_editor.cli.output import (
    GuidanceTable,
    Outcome,
    edited_session,
    run_showing_progress,
    write_plans,
    write_session,
)
from pd_editor.editor.scenario_store import open_part
from pd_editor.editor.variant import name_from_text, short_id
from pd_editor.experiments.closed_loop.policies import policy_of
from pd_editor.experiments.closed_loop.roll_out import (
    RollOutRequest,
    roll_out,
    route_of,
)
from pd_editor.experiments.closed_loop.scores import Drive, drive_report, drive_scores
from pd_editor.experiments.work_engine.work_engine import failure_of
from pd_editor.experiments.work_engine.work_folder import FINISHED_NAME
from pd_editor.generation.generators import SHIPPED_MODEL, make_generator
from pd_editor.scene.generation import GuidanceReport
from pd_editor.scene.policy import Policy
from pd_editor.scene.roles.focal_agent import driven_id
from pd_editor.scene.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class DriveOptions(WishOptions, PartOptions, ManyOptions):
    """Options of ``pd-editor drive``.

    Args:
        out: Folder that receives DIR/<name>/, one for each policy.
        policies: log-replay, constant-velocity, idm (Intelligent Driver Model), installed ones, folders with policy.py, or package.module:attribute; in Python objects, too.
        ego: Id of the agent that they drive.
        also: Further agents, each driven by a policy in every roll-out, such as bus-0165=idm; in Python also a mapping of ids to policies.
        seconds: Length of a roll-out.
        replan: Seconds between two generations of the traffic, 0.5 to 3.
        guide: What agents should do, as for generate; times up to the end of the roll-out.
        lock: What is kept of single agents, as for generate.
        sample_signals: Give each junction a plausible phase, which changes in turn.
        enter: Nobody enters for those that leave the map.
        model: What generates the traffic.
        name: Name of the result, to which the policy's is added.
    """

    policies: Annotated[
        str | Policy | tuple[str | Policy, ...] | list[str | Policy],
        tyro.conf.arg(
            metavar="NAME [NAME ...]",
            help_behavior_hint="(optional)",
            constructor=tuple[str, ...],
        ),
    ] = ()
    ego: Annotated[str, shown("ID", "(default: AV, else the focal agent)")] = ""
    also: Annotated[
        str | tuple[str, ...] | Mapping[str, str | Policy],
        tyro.conf.arg(
            metavar="ID=NAME [ID=NAME ...]",
            help_behavior_hint="(optional)",
            constructor=tuple[str, ...],
        ),
    ] = ()
    seconds: Annotated[float, shown("S")] = 30.0
    replan: Annotated[float, shown("S")] = 1.0
    enter: Switch = True
    model: Annotated[str, shown("NAME")] = SHIPPED_MODEL
    name: NameOption = ""


def _with_report(outcome: Outcome, options: DriveOptions) -> Outcome:
    """Tell which drives failed; write the report of all drives, if there are policies."""
    failures = {
        **outcome.failures,
        **{
            f"{one.scene}, {one.policy}": failure_of(GenerationError(one.ended))
            for one in outcome.records
            if one.has_failed
        },
    }
    outcome = replace(outcome, failures=failures)
    if not outcome.records or not options.policies:
        return outcome
    line = command_line("drive", options)
    reasons = {name: one.reason for name, one in failures.items()}
    report = drive_report(outcome.records, reasons, line, options.seed)
    _, page = report.write(Path(options.out))
    told = f"{page} compares the policies."
    return replace(outcome, remarks=(*outcome.remarks, told))


def _named(value: object) -> str:
    """A value of an option in words."""
    return value.name if isinstance(value, Policy) else str(value)


@over_scenes(DriveOptions, finish=_with_report)
def drive(scenario: str, options: DriveOptions) -> Outcome:
    """Roll scenes out in closed loop: traffic that answers, around policies that drive.

    Each policy drives the same agent through a roll-out of its own; without policies the
    traffic is rolled out alone.
    """
    policies, name = options.policies, options.name
    names = tuple(policies) if isinstance(policies, tuple | list) else (policies,)
    # What cannot be made is refused before anything is rolled out.
    labels = [policy_of(one).name for one in names]
    if len(set(labels)) < len(labels):
        raise InputError(f"Two policies have one name: {', '.join(labels)}.")
    opened = open_part(scenario, options.cut)
    options = replace(options, ego=options.ego or driven_id(opened))
    run = _Run(
        opened=opened,
        request=RollOutRequest(
            scenario=edited_session(opened, options.wishes()).scenario,
            duration_s=float(options.seconds),
            replan_s=float(options.replan),
            keeps_density=options.enter,
            seed=options.seed,
        ),
        options=options,
        also=_further(options.also, options.ego),
    )
    made = [run.of(one, label, name) for one, label in zip(names, labels, strict=True)]
    made = made or [run.of(None, "roll-out", name)]
    drives = tuple(drive for *_, drive in made)
    return Outcome(
        folders=tuple(folder for folder, *_ in made),
        scenarios=tuple(one for _, one, _ in made if one is not None),
        remarks=tuple(
            line
            for one in drives
            for line in ([one.in_words] * bool(names or one.ended) + [*one.guidance])
        ),
        records=drives,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Run:
    """Roll-outs of one scene, each with another policy."""

    opened: Scenario
    request: RollOutRequest
    """With the scene as it is to be rolled out."""
    options: DriveOptions
    also: Mapping[str, str | Policy]
    """Names of the policies of further agents."""

    def of(
        self, policy: str | Policy | None, label: str, name: str
    ) -> tuple[Path, Scenario | None, Drive]:
        """Roll out and write, unless a run of equal settings has, and did not fail."""
        request, opened, options = self.request, self.opened, self.options
        ego, out = options.ego, Path(options.out)
        given = f"{name or short_id(opened.scenario_id)} {label} s{request.seed}"
        called = name_from_text(given)
        record = out / FINISHED_NAME / f"{called}.json"
        known = {
            "policy": "" if policy is None else _named(policy),
            "ego": ego,
            "also": {name: _named(one) for name, one in self.also.items()},
            "seconds": request.duration_s,
            "replan": request.replan_s,
            "enter": request.keeps_density,
            "model": options.model,
            "scene": request.scenario.provenance.content_sha256,
        }
        if edits := options.wishes():
            known["edits"] = [repr(one) for one in edits]
        done = _finished(record, known)
        if done is not None and not (options.overwrite or done.has_failed):
            return out / done.folder, None, done
        driven = {agent: policy_of(one) for agent, one in self.also.items()}
        if policy is not None:
            driven = {ego: policy_of(policy), **driven}
        rolling = replace(request, policies=driven)
        rolled = run_showing_progress(
            roll_out(rolling, make_generator(options.model)), label
        )
        session = edited_session(opened, (*edits, rolled.command), called)
        may_replace = options.overwrite or done is not None
        folder = write_session(out, session, overwrite=may_replace)
        if driven:
            write_plans(folder, rolled.plans_m, rolled.scenario)
        is_scored = policy is not None and not rolled.failed
        report = GuidanceReport(outcomes=rolled.guidance)
        table = GuidanceTable(names=(called,), reports=(report,))
        if rolled.guidance:
            table.write(out / f"{called}-guidance.csv")
        drive = Drive(
            scene=opened.scenario_id,
            policy=label,
            folder=folder.name,
            ended=" ".join(rolled.ended.values()),
            has_failed=bool(rolled.failed),
            guidance=table.lines(),
            scores=drive_scores(rolled.scenario, ego, route_of(opened, ego))
            if is_scored
            else None,
        )
        text = json.dumps({**known, "drive": drive.to_json()}, indent=2)
        write_whole(record, f"{text}\n".encode())
        return folder, session.scenario, drive


def _further(
    given: str | tuple[str, ...] | Mapping[str, str | Policy], ego: str
) -> dict[str, str | Policy]:
    """Policies of further agents, by their ids or as texts ID=NAME."""
    if not isinstance(given, Mapping):
        parts = [text.rpartition("=") for text in several(given)]
        pairs = [(agent, policy) for agent, _, policy in parts]
    else:
        pairs = list(given.items())
    found: dict[str, str | Policy] = {}
    for agent, policy in pairs:
        if not agent or not policy or agent in (ego, *found):
            told = f"{agent}={policy}".lstrip("=")
            raise InputError(
                f"--also: {told!r} is not ID=NAME of an agent that nobody else drives."
            )
        policy_of(policy)
        found[agent] = policy
    return found


def _finished(record: Path, known: Mapping[str, Any]) -> Drive | None:
    """The drive that an earlier run of equal settings wrote."""
    try:
        found = json.loads(record.read_bytes())
        drive = Drive.from_json(found.pop("drive"))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    is_there = os.path.isdir(record.parents[1] / drive.folder)
    return drive if found == known and is_there else None
