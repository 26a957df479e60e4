"""``pd-editor drive``: roll scenes out, with policies that drive one of their agents."""

import json
import os
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from pd_editor.base.errors import GenerationError, InputError
from pd_editor.base.regular_file import write_whole
from pd_editor.cli.many_scenes import SCENE_FILES, over_scenes
from pd_editor.cli.options.arguments import (
    AddressOption,
    AroundOption,
    CurrentOption,
    FolderOption,
    NameOption,
    OptionalWorkers,
    RadiusOption,
    Switch,
    UntilOption,
    several,
)
from pd_editor.cli.output.outcome import Outcome, described, write_session
from pd_editor.cli.output.progress import ProgressLine
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.editor.session import EditorSession
from pd_editor.editor.variant import name_from_text, short_id
from pd_editor.experiments.closed_loop.policies import policy_of
from pd_editor.experiments.closed_loop.report import Drive, drive_report
from pd_editor.experiments.closed_loop.roll_out import (
    RollOut,
    RollOutRequest,
    roll_out,
    route_of,
)
from pd_editor.experiments.closed_loop.scores import drive_scores
from pd_editor.experiments.evaluation.report.formats import html_of, markdown_of
from pd_editor.experiments.work_engine import EngineName
from pd_editor.experiments.work_engine.work_engine import failure_of
from pd_editor.experiments.work_engine.work_folder import FINISHED_NAME
from pd_editor.generation.generators import SHIPPED_MODEL, make_generator
from pd_editor.scene.generation import ScenarioGenerator
from pd_editor.scene.policy import Policy
from pd_editor.scene.scenario import EGO_ID, Scenario


def _with_report(
    outcome: Outcome, scenes: tuple[str, ...], options: Mapping[str, Any]
) -> Outcome:
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
    if not outcome.records or not options.get("policies"):
        return outcome
    out, words = Path(options["out"]), ["pd-editor", "drive", *scenes]
    for name, value in options.items():
        option = f"--{name}" if value is not False else f"--no-{name}"
        values = value if isinstance(value, tuple | list) else (value,)
        shown = () if isinstance(value, bool) else map(_named, values)
        words += [option, *shown] if value not in (None, "", ()) else []
    reasons = {name: one.reason for name, one in failures.items()}
    seed = int(options.get("seed", 0))
    report = drive_report(outcome.records, reasons, shlex.join(words), seed)
    write_whole(out / "report.md", markdown_of(report).encode())
    write_whole(out / "report.html", html_of(report, ()).encode())
    told = f"{out / 'report.html'} compares the policies."
    return replace(outcome, remarks=(*outcome.remarks, told))


def _named(value: object) -> str:
    """A value of an option in words."""
    return value.name if isinstance(value, Policy) else str(value)


@over_scenes(SCENE_FILES, _with_report)
def drive(
    scenario: str | Path,
    /,
    *,
    out: FolderOption,
    policies: Annotated[
        str | Policy | tuple[str | Policy, ...] | list[str | Policy],
        tyro.conf.arg(
            metavar="NAME [NAME ...]",
            help_behavior_hint="(optional)",
            constructor=tuple[str, ...],
        ),
    ] = (),
    ego: Annotated[str, tyro.conf.arg(metavar="ID")] = EGO_ID,
    also: Annotated[
        str | tuple[str, ...],
        tyro.conf.arg(metavar="ID=NAME [ID=NAME ...]", help_behavior_hint="(optional)"),
    ] = (),
    seconds: Annotated[float, tyro.conf.arg(metavar="S")] = 30.0,
    replan: Annotated[float, tyro.conf.arg(metavar="S")] = 1.0,
    enter: Switch = True,
    seed: int = 0,
    model: Annotated[str, tyro.conf.arg(metavar="NAME")] = SHIPPED_MODEL,
    current: CurrentOption = None,
    until: UntilOption = None,
    around: AroundOption = None,
    radius: RadiusOption = None,
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
        policies: log-replay, constant-velocity, idm, installed ones, folders with policy.py, or package.module:attribute; in Python objects, too.
        ego: Id of the agent that they drive.
        also: Further agents, each driven by a policy in every roll-out, such as bus-0165=idm.
        seconds: Length of a roll-out.
        replan: Seconds between two generations of the traffic, 0.5 to 3.
        enter: No vehicles enter for those that leave the map.
        seed: Random seed.
        model: What generates the traffic.
        current: Seconds of the recording that count as observed; the last of their steps becomes the current one.
        until: Seconds after the current step that are kept, such as 6.
        around: Metres in the file's frame, about which a square of its map is used; for maps beyond the limits of a scene.
        radius: Half the side of that square.
        name: Name of the result, to which the policy's is added.
        overwrite: Replace what an earlier run wrote.
        engine: Processes of this machine, or Ray (extra "cluster"), for several scenes.
        address: Address of a Ray cluster, such as auto or head:6379; a new one on this machine unless given.
        workers: Scenes at a time, each in a process of its own; they do not change the results.
    """
    names = tuple(policies) if isinstance(policies, tuple | list) else (policies,)
    # What cannot be made is refused before anything is rolled out.
    labels = [policy_of(one).name for one in names]
    if len(set(labels)) < len(labels):
        raise InputError(f"Two policies have one name: {', '.join(labels)}.")
    run = _Run(
        request=RollOutRequest(
            scenario=open_scenario(
                scenario,
                current_s=current,
                until_s=until,
                around=around,
                radius_m=radius,
            ),
            duration_s=float(seconds),
            replan_s=float(replan),
            keeps_density=enter,
            seed=seed,
        ),
        ego=ego,
        also=_further(several(also), ego),
        model=model,
        out=Path(out),
        overwrite=overwrite,
    )
    made = [run.of(one, label, name) for one, label in zip(names, labels, strict=True)]
    made = made or [run.of(None, "roll-out", name)]
    drives = tuple(drive for *_, drive in made)
    return Outcome(
        folders=tuple(folder for folder, *_ in made),
        scenarios=tuple(one for _, one, _ in made if one is not None),
        remarks=tuple(one.in_words for one in drives if names or one.ended),
        records=drives,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Run:
    """Roll-outs of one scene, each with another policy."""

    request: RollOutRequest
    ego: str
    also: Mapping[str, str]
    """Names of the policies of further agents."""
    model: str
    out: Path
    overwrite: bool

    def of(
        self, policy: str | Policy | None, label: str, name: str
    ) -> tuple[Path, Scenario | None, Drive]:
        """Roll out and write, unless a run of equal settings has, and did not fail."""
        request, opened = self.request, self.request.scenario
        given = f"{name or short_id(opened.scenario_id)} {label} s{request.seed}"
        called = name_from_text(given)
        record = self.out / FINISHED_NAME / f"{called}.json"
        known = {
            "policy": "" if policy is None else _named(policy),
            "ego": self.ego,
            "also": dict(self.also),
            "seconds": request.duration_s,
            "replan": request.replan_s,
            "enter": request.keeps_density,
            "model": self.model,
            "scene": request.scenario.provenance.content_sha256,
        }
        done = _finished(record, known)
        if done is not None and not (self.overwrite or done.has_failed):
            return self.out / done.folder, None, done
        driven = {agent: policy_of(one) for agent, one in self.also.items()}
        if policy is not None:
            driven = {self.ego: policy_of(policy), **driven}
        rolled = _rolled_out(
            replace(request, policies=driven), make_generator(self.model), label
        )
        session = EditorSession(opened)
        session.describe(described(called))
        session.apply(rolled.command)
        may_replace = self.overwrite or done is not None
        folder = write_session(self.out, session, overwrite=may_replace)
        is_scored = policy is not None and not rolled.failed
        drive = Drive(
            scene=opened.scenario_id,
            policy=label,
            folder=folder.name,
            ended=" ".join(rolled.ended.values()),
            has_failed=bool(rolled.failed),
            scores=drive_scores(rolled.scenario, self.ego, route_of(opened, self.ego))
            if is_scored
            else None,
        )
        text = json.dumps({**known, "drive": drive.to_json()}, indent=2)
        write_whole(record, f"{text}\n".encode())
        return folder, session.scenario, drive


def _further(texts: tuple[str, ...], ego: str) -> dict[str, str]:
    """Policies of further agents."""
    found = {}
    for text in texts:
        agent, _, policy = text.rpartition("=")
        if not agent or not policy or agent in (ego, *found):
            raise InputError(
                f"--also: {text!r} is not ID=NAME of an agent that nobody else drives."
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
