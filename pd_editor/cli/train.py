"""``pd-editor train``: train a stage of the model."""

import math
import os
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NoReturn

import tyro

from pd_editor.base.errors import WorkDone
from pd_editor.base.installed_files import models_folder
from pd_editor.base.regular_file import check_path
from pd_editor.cli.options import (
    Number,
    OptionalFolder,
    OptionalFolders,
    Switch,
    several,
    shown,
    taking,
)
from pd_editor.cli.output import ProgressLine, preparation_shown
from pd_editor.experiments.training.run_folder import Training
from pd_editor.experiments.work_engine.work_engine import minutes_left
from pd_editor.generation.defaults import DeviceName
from pd_editor.generation.generators import SHIPPED_MODEL

if TYPE_CHECKING:
    from pd_editor.experiments.training.monitoring import SampleCheck
    from pd_editor.experiments.training.settings import RunRequest
    from pd_editor.experiments.training.train_loop import TrainingProgress
    from pd_editor.experiments.training.training_run import Hardware

StageName = Literal["init", "traj", "all"]
_STAGES: tuple[Literal["init", "traj"], ...] = ("init", "traj")
_OPTIONAL = "(optional)"
_OptionalCount = Annotated[int | None, shown("N", _OPTIONAL)]
_OptionalNumber = Annotated[float | None, shown("X", _OPTIONAL)]


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """Options of ``pd-editor train``.

    Args:
        stage: Stage to train: init (initial states), traj (trajectories), or all, which trains one after the other and joins them into a model.
        data: Roots of Argoverse 2 datasets, and folders of synthetic shards.
        validate: Roots like those of --data, such as argoverse2/val, that are held out and not trained on; a part of the data unless given.
        weights: Shares of the roots in the training data, one number for each.
        out: New folder of the run, runs/STAGE unless given; of the model for all, with its runs below runs/.
        preset: Size of the network and of the batches, rate and minutes: default (for a CPU), gpu (a larger network), av2 (to go on with a model on recordings), tiny (to try things out); auto chooses by device.
        minutes: Time of training, without the preparation of the data; else the preset's: init 30, traj 20 (gpu 15 and 12, av2 240, tiny 1). Of each stage, for all.
        steps: Train so many steps instead.
        batch_size: Scenes of a step; else the preset's.
        learning_rate: The highest of the run; else the preset's: init 0.002, traj 0.0015 (gpu 0.0015, av2 0.0005, tiny 0.001).
        device: Where to compute; auto takes a GPU if there is one.
        devices: GPUs to use.
        threads: CPU threads to use; all unless given.
        precision: Of the products; auto takes bf16 on GPUs, and on CPUs that are fast at it.
        cache: Folder in which prepared scenes are kept for later runs; ~/.cache/pd-editor/scenes unless given.
        seed: Random seed; 0 unless given.
        start: Start from the weights of this model, or run, instead of random ones; its trajectory basis is kept.
        windows: Number of current steps at which each scenario of Argoverse 2 is used; 1 unless given, av2 5.
        copies: Number of randomly augmented copies of each scenario; 1 unless given.
        config: TOML files with values of single fields, in the sections [model], [loss], [optimisation], [augmentation], [sampler], [guidance], [own_samples], [init.conflicts] and [traj.terms]; [init.model] or [traj.model] for one of the stages. They are read in the order given: a field that is in several files has the value of the last one. --fields lists what can be set.
        settings: Values of single fields, such as model.is_differential=false augmentation.warp_share=0; they are read after the files and replace their values.
        fields: List all fields that --config and --set can set, with defaults and meanings, and do nothing else.
        evaluate_every: Evaluate samples on scenes of --validate about every MIN minutes of training, into log.jsonl: scene test, collisions, off-drivable and askew shares of initial states; minADE6, collisions and lane deviation of trajectories. The time that it takes does not count as training.
        tensorboard: Write losses and figures of samples for TensorBoard (extra "monitor") into the folder tensorboard of the run.
        resume: Go on with the run in the folder; its settings are taken from there, but for --evaluate-every and --tensorboard.
    """

    stage: Annotated[StageName, tyro.conf.Positional] = field(kw_only=False)
    data: Annotated[
        str | Path | tuple[str | Path, ...], shown("DIR [DIR ...]", "(required)")
    ] = ()
    validate: OptionalFolders = ()
    weights: Annotated[
        tuple[float, ...], shown("W [W ...]", "(default: by scenes)")
    ] = ()
    out: OptionalFolder = None
    preset: Literal["auto", "default", "gpu", "av2", "tiny"] = "auto"
    minutes: _OptionalNumber = None
    steps: _OptionalCount = None
    batch_size: _OptionalCount = None
    learning_rate: _OptionalNumber = None
    device: Literal["auto", "cpu", "cuda"] = "auto"
    devices: Number = 1
    threads: _OptionalCount = None
    precision: Literal["auto", "32", "bf16"] = "auto"
    cache: OptionalFolder = None
    seed: _OptionalCount = None
    start: Annotated[Path | None, shown("MODEL", _OPTIONAL, name="from")] = None
    windows: _OptionalCount = None
    copies: _OptionalCount = None
    config: Annotated[
        str | Path | tuple[str | Path, ...], shown("FILE [FILE ...]", _OPTIONAL)
    ] = ()
    settings: Annotated[
        tuple[str, ...], shown("NAME=VALUE [...]", _OPTIONAL, name="set")
    ] = ()
    fields: Switch = False
    evaluate_every: Annotated[float | None, shown("MIN", "(default: never)")] = None
    tensorboard: Switch = False
    resume: Switch = False

    @property
    def stages(self) -> tuple[Literal["init", "traj"], ...]:
        """Stages to train."""
        return _STAGES if self.stage == "all" else (self.stage,)

    def request(self, stage: Literal["init", "traj"]) -> "RunRequest":
        """What is asked of the run of a stage.

        Raises:
            TrainingError: a file or a value of single fields cannot be read.
        """
        from pd_editor.experiments.training.settings import RunRequest, settings_of

        files = [Path(one) for one in several(self.config)]
        return RunRequest(
            stage=stage,
            settings=settings_of(files, self.settings, stage),
            data=_absolute(self.data) or None,
            validate=_absolute(self.validate) or None,
            weights=self.weights or None,
            preset=None if self.preset == "auto" else self.preset,
            minutes=self.minutes,
            steps=self.steps,
            batch_size=self.batch_size,
            learning_rate=self.learning_rate,
            precision=None if self.precision == "auto" else self.precision,
            seed=self.seed,
            start=None if self.start is None else _absolute(self.start)[0],
            windows=self.windows,
            copies=self.copies,
        )

    @property
    def hardware(self) -> "Hardware":
        """Devices and threads; raises as its constructor does."""
        from pd_editor.experiments.training.training_run import Hardware

        return Hardware(
            device=self.device, num_devices=self.devices, threads=self.threads
        )

    def trained(self, request: "RunRequest", run: Path, *, resume: bool) -> Training:
        """Train a stage in a folder, with progress on stderr."""
        from pd_editor.experiments.training.monitoring import Monitoring
        from pd_editor.experiments.training.training_data import default_cache
        from pd_editor.experiments.training.training_run import run_asked_for

        return run_asked_for(
            request,
            run,
            default_cache() if self.cache is None else Path(self.cache),
            self.hardware,
            resume=resume,
            monitoring=Monitoring(
                evaluate_minutes=self.evaluate_every,
                check_of=partial(_sample_check, self.device),
                has_tensorboard=self.tensorboard,
            ),
            on_preparation=preparation_shown(),
            on_progress=_progress_shown(),
        )


@taking(TrainOptions)
def train(options: TrainOptions) -> Training:
    """Train initial states (init), trajectories (traj) or both (all) on scenarios.

    For a model of your own Argoverse 2: train all --data av2/train --validate av2/val
    --from models/path-diffuser --preset av2 --out models/path-diffuser-av2. Ctrl-C stops after the step in hand; --resume goes on as if nothing had happened.
    """
    if options.fields:
        _list_fields(options.stages)
    requests = [options.request(one) for one in options.stages]
    folder = Path("runs") / options.stage if options.out is None else Path(options.out)
    trained = (
        _both_trained(options, requests, folder)
        if options.stage == "all"
        else options.trained(requests[0], folder, resume=options.resume)
    )
    if not trained.is_first:
        # The other processes of several devices report nothing.
        raise WorkDone(0)
    return trained


def _list_fields(stages: Sequence[Literal["init", "traj"]]) -> NoReturn:
    """Print the fields of stages as tables, and end."""
    from pd_editor.experiments.training.settings import fields_table

    sys.stdout.write("\n\n".join(map(fields_table, stages)) + "\n")
    raise WorkDone(0)


def _absolute(roots: str | Path | tuple[str | Path, ...]) -> tuple[str, ...]:
    several = roots if isinstance(roots, tuple) else (roots,)
    for root in several:
        check_path(root)
    return tuple(os.path.realpath(root) for root in several)


def _both_trained(
    options: TrainOptions, requests: Sequence["RunRequest"], folder: Path
) -> Training:
    """Train one stage after the other, then join them into a model."""
    from pd_editor.cli.model import model
    from pd_editor.experiments.training.training_run import config_asked_for

    runs = [folder / "runs" / one.stage for one in requests]
    # Asked before the first of several processes makes a folder.
    begun = [options.resume and run.exists() for run in runs]
    asked = list(zip(requests, runs, begun, strict=True))
    for request, run, resume in asked:
        # What is wrong with the second stage is told before the first one is trained.
        config_asked_for(request, run, options.hardware, resume=resume)
    found: list[Training] = []
    for request, run, resume in asked:
        found.append(options.trained(request, run, resume=resume))
        if found[-1].is_stopped:
            return replace(found[-1], folder=folder)
    init, traj = found
    if traj.is_first:
        model(out=folder, init=init.folder, traj=traj.folder)
    return replace(
        traj,
        folder=folder,
        model=folder,
        steps=init.steps + traj.steps,
        minutes=init.minutes + traj.minutes,
    )


def _sample_check(
    device: DeviceName, roots: Sequence[Path], stage: str
) -> "SampleCheck":
    """Evaluation of samples of a stage; initial states get the shipped trajectories."""
    from pd_editor.experiments.evaluation.report.sample_figures import figure_scenes
    from pd_editor.generation.checkpoints.model_folder import load_model, save_model
    from pd_editor.generation.path_diffuser import PathDiffuser
    from pd_editor.generation.stages import STAGE_KINDS

    places = stage == "init"
    scenes = figure_scenes(roots, samples_states=places)
    shipped = models_folder() / SHIPPED_MODEL
    others = load_model(shipped, STAGE_KINDS).stages if places else {}

    def check(folder: Path) -> Mapping[str, Mapping[str, float]]:
        stages = {**others, **load_model(folder, STAGE_KINDS).stages}
        with tempfile.TemporaryDirectory() as joined:
            save_model(Path(joined), stages)
            return scenes.figures(lambda _: PathDiffuser(Path(joined), device=device))

    return check


def _progress_shown() -> "Callable[[TrainingProgress], None]":
    line = ProgressLine()
    return lambda one: line.show(progress_line(one), is_over=one.fraction >= 1)


def progress_line(progress: "TrainingProgress") -> str:
    """Describe the progress of a training, its loss and its remaining time."""
    held_out = progress.held_out_loss
    checked = "" if math.isnan(held_out) else f" (held out {held_out:.4f})"
    return (
        f"{100 * progress.fraction:3.0f} % step {progress.train_state.step}, loss "
        f"{progress.loss:.4f}{checked}, {progress.scenes_per_s:.0f} scenes/s, "
        f"{minutes_left(progress.left_s)}"
    )
