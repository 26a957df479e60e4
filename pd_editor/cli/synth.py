"""``pd-editor synth``: synthetic traffic in Argoverse 2's form."""

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pd_editor.base.errors import InputError, SynthesisError
from pd_editor.cli.many_scenes import EngineOptions
from pd_editor.cli.options import (
    FolderOption,
    Number,
    OptionalFolders,
    Switch,
    folders,
    shown,
    taking,
)
from pd_editor.cli.output import work_shown
from pd_editor.experiments.synthesis.dataset_builder import (
    MANIFEST_NAME,
    DatasetFolder,
    DatasetPlan,
    DatasetRecord,
    build_dataset,
)
from pd_editor.experiments.synthesis.realism_report import (
    dataset_scenes,
    real_scenes,
    realism_report,
    scenario_folders,
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Synthesis:
    """Result of a synthesis, and the files that were written."""

    folder: Path
    record: DatasetRecord
    num_requested: int
    elapsed_s: float
    files: tuple[Path, ...]
    """The manifest, and the reports if requested."""

    def __str__(self) -> str:
        """One line per file, then figures, then failures."""
        record, failures = self.record, self.record.failures
        lines = [*map(str, self.files)]
        lines.append(
            f"{record.num_windows} windows on {len(record.networks)} networks with "
            f"{record.num_agents} agents in {self.elapsed_s:.0f} s."
        )
        lines += record.notes
        if record.num_windows < self.num_requested:
            lines.append(f"{self.num_requested} windows were asked for.")
        if failures:
            lines.append(f"{len(failures)} networks failed:")
            lines += [f"  {failures[key]}" for key in sorted(failures)[:5]]
        return "\n".join(lines)


@dataclass(frozen=True, kw_only=True)
class SynthOptions(EngineOptions):
    """Options of ``pd-editor synth``.

    Args:
        out: New folder for the scenarios, and manifest.json with what they are.
        num: Number of scenarios.
        seed: Random seed; the same seed gives the same files.
        families: Families of procedural roads: grid, downtown, town, arterial, t-junctions, roundabout, merge, slip-lanes, winding-street, dead-ends.
        maps: Roots of Argoverse 2 datasets, on whose maps to drive instead.
        networks: Folders of SUMO scenarios (a .sumocfg with network and demand) to take instead, a random time and place of one at a time.
        report: Write realism.md and realism.html too: distances to real scenes below the first folder, and between those and scenes below a second one, if given.
        shards: Write compact shards for training instead of scenario folders.
        noise: Add a tracker's noise to states and break off tracks; not with --shards.
        workers: Work items that run at a time; they do not change the files.
        resume: Go on with an earlier run of the same settings.
    """

    out: FolderOption
    num: Number
    seed: Number = 0
    families: Annotated[
        tuple[str, ...], shown("NAME [NAME ...]", "(default: all)")
    ] = ()
    maps: OptionalFolders = ()
    networks: OptionalFolders = ()
    shards: Switch = False
    report: OptionalFolders = ()
    noise: Switch = False
    resume: Switch = False


@taking(SynthOptions)
def synth(options: SynthOptions) -> Synthesis:
    """Simulate traffic on procedural roads, real maps or in cities, as Argoverse 2 scenarios.

    Needs SUMO (pip install 'pd-editor[synth]').
    """
    began = time.monotonic()
    choice, real_roots = options.choice, _real_roots(options.report)
    plan = DatasetPlan(
        num=options.num,
        seed=options.seed,
        families=tuple(dict.fromkeys(options.families)),
        maps=folders(options.maps),
        networks=folders(options.networks),
        as_shards=options.shards,
        with_noise=options.noise,
    )
    with choice.engine() as runner:
        folder = DatasetFolder(Path(options.out), plan.settings, resume=options.resume)
        record = build_dataset(plan, folder, runner, on_progress=work_shown("networks"))
    if not record.num_windows:
        reason = next(iter(record.failures.values()), "no network has traffic")
        raise SynthesisError(f"No scenario was made: {reason}")
    return Synthesis(
        folder=folder.path,
        record=record,
        num_requested=options.num,
        elapsed_s=time.monotonic() - began,
        files=(folder.path / MANIFEST_NAME, *_reported(folder, real_roots)),
    )


def _real_roots(value: str | Path | tuple[str | Path, ...]) -> tuple[Path, ...]:
    """Validate the folders of real scenes to compare with, before the work begins."""
    roots = folders(value)
    if len(roots) > 2:
        raise InputError("--report takes one folder of real scenes, or two.")
    for root in roots:
        scenario_folders((root,))
    return roots


def _reported(folder: DatasetFolder, roots: tuple[Path, ...]) -> tuple[Path, ...]:
    """Write the realism report of the dataset; nothing without roots."""
    if not roots:
        return ()
    real, *others = map(real_scenes, roots)
    report = realism_report(dataset_scenes(folder.path), real, *others)
    return (
        *report.report().write(folder.path, "realism"),
        folder.write("realism.json", json.dumps(report.json(), indent=1).encode()),
    )
