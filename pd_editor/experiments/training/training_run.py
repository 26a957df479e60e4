"""Training run, from data roots to a model folder."""

import atexit
import contextlib
import copy
import importlib.metadata
import logging
import math
import os
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path
from typing import Any, Final

import torch
from lightning_fabric import Fabric
from lightning_fabric.strategies.ddp import DDPStrategy

from pd_editor.base.errors import PdEditorError, TrainingError, WorkDone
from pd_editor.experiments.training.feature_preparation import is_recorded
from pd_editor.experiments.training.monitoring import (
    Monitoring,
    SampleWatch,
    check_installed,
    loss_curves_png,
    tensorboard_log,
)
from pd_editor.experiments.training.run_config import (
    Augmentation,
    Precision,
    RunConfig,
)
from pd_editor.experiments.training.run_folder import (
    CURVES_NAME,
    RunFolder,
    Training,
)
from pd_editor.experiments.training.settings import (
    RunRequest,
    continued_config,
    new_config,
    with_settings,
)
from pd_editor.experiments.training.stage_objective import (
    STAGES,
    basis_of,
    start_from,
    starting_model,
)
from pd_editor.experiments.training.train_loop import (
    TrainingProgress,
    TrainLoop,
    spent,
)
from pd_editor.experiments.training.training_data import (
    PreparedData,
    prepared_data,
    read_basis,
    training_data,
    write_basis,
)
from pd_editor.experiments.work_engine.work_engine import WorkProgress
from pd_editor.generation.checkpoints.model_folder import TrainedStage, save_model
from pd_editor.generation.checkpoints.tensor_file import config_from_json
from pd_editor.generation.defaults import DeviceName
from pd_editor.generation.generators import saw_warps
from pd_editor.generation.inputs import TrajectoryBasis

MAX_DEVICES: Final = 64
MAX_THREADS: Final = 1_024
NO_MONITORING: Final = Monitoring()
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@dataclass(frozen=True, kw_only=True)
class Hardware:
    """Devices and threads of a run."""

    device: DeviceName = "auto"
    num_devices: int = 1
    """Number of GPUs, or of processes on a CPU, among which a batch is divided."""
    threads: int | None = None
    """Number of CPU threads of one process; None: all cores."""

    def __post_init__(self) -> None:
        for name, value, most in (
            ("devices", self.num_devices, MAX_DEVICES),
            ("threads", self.threads, MAX_THREADS),
        ):
            if value is not None and not 1 <= value <= most:
                raise TrainingError(f"--{name} is {value}; expected 1 to {most}.")


def has_gpu(hardware: Hardware) -> bool:
    """Whether to train on GPUs.

    Raises:
        TrainingError: more GPUs are requested than there are.
    """
    count = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if hardware.device == "cuda" and not count:
        raise TrainingError(
            "A GPU was asked for, but none can be used here; train with --device cpu, "
            "or check the driver and that torch is built for CUDA."
        )
    if hardware.device == "cpu" or not count:
        return False
    if hardware.num_devices > count:
        raise TrainingError(
            f"{hardware.num_devices} GPUs were asked for; there are {count}."
        )
    return True


def _fabric(hardware: Hardware, precision: Precision, *, is_gpu: bool) -> Fabric:
    """Launch one process per device."""
    if hardware.threads is not None:
        torch.set_num_threads(hardware.threads)
    # Fabric prints the precision at each start.
    logging.getLogger("lightning_fabric").setLevel(logging.WARNING)
    fabric = Fabric(
        accelerator="cuda" if is_gpu else "cpu",
        devices=hardware.num_devices,
        precision="bf16-mixed" if precision == "bf16" else "32-true",
        # The first process may prepare data for hours while the others wait.
        strategy=DDPStrategy(timeout=timedelta(days=2))
        if hardware.num_devices > 1
        else "auto",
    )
    fabric.launch()
    if hardware.num_devices > 1:
        # Fabric does so for NCCL only. Threads of gloo that outlive the interpreter abort
        # the process now and then.
        atexit.register(_leave_process_group)
    return fabric


def _leave_process_group() -> None:
    if torch.distributed.is_initialized():
        torch.distributed.destroy_process_group()


def config_asked_for(
    request: RunRequest, folder: Path, hardware: Hardware, *, resume: bool
) -> RunConfig:
    """Configuration of a run, new or resumed; nothing is written.

    Raises:
        PdEditorError: the settings are invalid, or the folder cannot be used.
    """
    run = RunFolder(folder)
    if resume:
        return continued_config(run.config(), request)
    config = new_config(request, is_gpu=has_gpu(hardware))
    if not torch.distributed.is_initialized():
        # Later runs of several processes: the first of them checks it.
        run.check_free()
    return config


def run_asked_for(
    request: RunRequest,
    folder: Path,
    cache: Path,
    hardware: Hardware,
    *,
    resume: bool = False,
    monitoring: Monitoring = NO_MONITORING,
    on_preparation: Callable[[WorkProgress], None] | None = None,
    on_progress: Callable[[TrainingProgress], None] = lambda _: None,
) -> Training:
    """Prepare the data, train, and write a model to the run's folder.

    Raises:
        PdEditorError: data, folder or hardware cannot be used, or training failed.
    """
    run = RunFolder(folder)
    is_gpu = has_gpu(hardware)
    config = config_asked_for(request, folder, hardware, resume=resume)
    if monitoring.has_tensorboard:
        check_installed()
    watch = monitoring.watch(_roots(config.validate), config.stage, run)
    fabric = _fabric(hardware, config.precision, is_gpu=is_gpu)
    # The first process prepares the data and the folder; the others use them.
    failure: PdEditorError | None = None
    if fabric.is_global_zero:
        try:
            _begin(config, run, cache, resume=resume, on_preparation=on_preparation)
        except PdEditorError as error:
            failure = error
    if fabric.broadcast(failure is not None):
        if failure is not None:
            raise failure
        # The first process says what is wrong.
        raise WorkDone(0)
    prepared = _prepared(config, cache, _kept_basis(run))
    return _train(config, run, prepared, fabric, watch, monitoring, on_progress)


def _begun(
    config: RunConfig,
    run: RunFolder,
    prepared: PreparedData,
    fabric: Fabric,
    watch: SampleWatch | None,
) -> tuple[TrainLoop, Callable[[], None]]:
    """The loop of a run, new or where an earlier one was, and what writes its results."""
    stage = STAGES[config.stage]
    model_config = config_from_json(stage.kind.config_type, config.model, run.path)
    model = stage.fresh_model(model_config, prepared.basis, config.seed)
    sampling: Mapping[str, Any] = stage.kind.default_sampling()
    sees_warps = config.augmentation["warp_share"] > 0
    if config.start:
        earlier = starting_model(Path(config.start)).stage(config.stage)
        sampling = earlier.sampling
        sees_warps |= saw_warps(earlier.about)
        if not os.path.exists(run.state_path):
            start_from(model, earlier.model.state_dict(), config.start)
    stage.fit_statistics(model, prepared.store)
    loop = TrainLoop(
        config if watch is None else _with_checkpoints(config, watch.minutes),
        model,
        stage.loss(config.loss, config.own_samples),
        training_data(prepared.store, config.budget, config.seed, prepared.validation),
        run,
        fabric,
    )
    if os.path.exists(run.state_path):
        loop.resume(stage.kind.statistics)
    own = _sampling_of_data(config)

    def write_results() -> None:
        stage.measure(loop.averaged_model, prepared.store)
        trained = TrainedStage(
            kind=stage.kind,
            config=model_config,
            model=loop.averaged_model,
            sampling={
                part: with_settings(
                    value, {**own.get(part, {}), **config.sampling.get(part, {})}, part
                )
                for part, value in sampling.items()
            },
            about={**_about(config, prepared, loop), "saw_warps": bool(sees_warps)},
        )
        save_model(run.model_path, {stage.kind.name: trained})
        write_curves(run, config)

    return loop, write_results


def _train(
    config: RunConfig,
    run: RunFolder,
    prepared: PreparedData,
    fabric: Fabric,
    watch: SampleWatch | None,
    monitoring: Monitoring,
    on_progress: Callable[[TrainingProgress], None],
) -> Training:
    loop, write_results = _begun(config, run, prepared, fabric, watch)
    first_step = loop.train_state.step + 1
    is_charted = monitoring.has_tensorboard and fabric.is_global_zero
    charts = tensorboard_log(run, first_step) if is_charted else nullcontext()
    with charts, stop_requests() as is_stopped:

        def keep() -> None:
            write_results()
            if watch is not None and not is_stopped():
                is_over = spent(config.budget, loop.train_state) >= 1
                watch.look(loop.train_state, is_over=is_over)

        for progress in loop.run(is_stopped=is_stopped, on_checkpoint=keep):
            if fabric.is_global_zero:
                on_progress(progress)
        if loop.train_state.step < first_step:
            # A run may have been killed between its last state and its model.
            if fabric.is_global_zero:
                write_results()
            fabric.barrier()
        return Training(
            folder=run.path,
            model=run.model_path,
            steps=loop.train_state.step,
            minutes=loop.train_state.trained_s / 60,
            held_out_loss=loop.held_out_loss,
            num_scenes=len(prepared.store),
            num_left_out=prepared.num_left_out,
            is_stopped=fabric.broadcast(is_stopped()),
            is_first=fabric.is_global_zero,
        )


def _sampling_of_data(config: RunConfig) -> Mapping[str, Mapping[str, Any]]:
    """Settings of the sampling that depend on the data.

    Squares of recordings are as dense as recorded ones.
    """
    if config.stage != "init" or not all(map(is_recorded, _roots(config.data))):
        return {}
    return {"sampler": {"fit_density": 1.0}}


def _with_checkpoints(config: RunConfig, minutes: float) -> RunConfig:
    """The configuration with checkpoints at least so often."""
    most = min(config.budget.checkpoint_minutes, minutes)
    return replace(config, budget=replace(config.budget, checkpoint_minutes=most))


def write_curves(run: RunFolder, config: RunConfig) -> None:
    """Plot the losses of a run that has logged some."""
    entries = [entry for entry in run.logged() if "loss" in entry]
    if entries:
        title = f"{config.stage}: {run.path.name}"
        run.write(CURVES_NAME, loss_curves_png(entries, title))


def _begin(
    config: RunConfig,
    run: RunFolder,
    cache: Path,
    *,
    resume: bool,
    on_preparation: Callable[[WorkProgress], None] | None,
) -> None:
    """Prepare the data, and create the run's folder or check it against the data."""
    basis = _kept_basis(run)
    if config.start and not resume:
        basis = basis_of(starting_model(Path(config.start)))
    prepared = _prepared(config, cache, basis, on_preparation)
    data = {
        "fingerprint": prepared.store.index.fingerprint,
        "scenes": len(prepared.store),
        "left_out": prepared.num_left_out,
        "networks": len(set(prepared.store.group.tolist())),
        "version": importlib.metadata.version("pd-editor"),
    }
    if resume:
        run.go_on(config, data)
    else:
        run.begin(config, data)
        if basis is not None:
            write_basis(run.basis_path, basis)


def measured(
    stage: TrainedStage,
    roots: Sequence[Path],
    cache: Path,
    on_progress: Callable[[WorkProgress], None] | None = None,
) -> TrainedStage:
    """Measure on data what the sampler of a stage needs to know.

    Trainings do so themselves, since this was added. The data is augmented as in the
    stage's training.

    Raises:
        PdEditorError: the data cannot be used.
    """
    augmentation = with_settings(
        Augmentation(), stage.about.get("augmentation", {}), "augmentation"
    )
    data = prepared_data(
        roots, cache, augmentation=augmentation, on_progress=on_progress
    )
    model = copy.deepcopy(stage.model)
    STAGES[stage.kind.name].measure(model, data.store)
    return replace(stage, model=model)


def _prepared(
    config: RunConfig,
    cache: Path,
    basis: TrajectoryBasis | None,
    on_progress: Callable[[WorkProgress], None] | None = None,
) -> PreparedData:
    """Training and validation data on one basis."""
    data = prepared_data(
        _roots(config.data),
        cache,
        basis=basis,
        copies=config.copies,
        windows=config.windows,
        augmentation=with_settings(Augmentation(), config.augmentation, "augmentation"),
        on_progress=on_progress,
    )
    if not config.validate:
        return data
    # Validation scenes are not augmented, and used at their own current step.
    held_out = prepared_data(
        _roots(config.validate), cache, basis=data.basis, augmentation=None
    )
    return replace(data, validation=held_out.store)


def _kept_basis(run: RunFolder) -> TrajectoryBasis | None:
    return read_basis(run.basis_path) if os.path.exists(run.basis_path) else None


def _commit() -> str:
    """Commit of the code, if it runs from a checkout."""
    try:
        found = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            timeout=10,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return found.stdout.strip()


def _roots(roots: Sequence[str]) -> list[Path]:
    return [Path(root) for root in roots]


def _about(
    config: RunConfig,
    prepared: PreparedData,
    loop: TrainLoop,
) -> Mapping[str, Any]:
    """Training record that is stored with the weights."""
    held_out = loop.held_out_loss
    return {
        "steps": loop.train_state.step,
        "minutes": round(loop.train_state.trained_s / 60, 2),
        "held_out_loss": None if math.isnan(held_out) else round(held_out, 6),
        "scenes": len(prepared.store),
        "roots": [Path(root).name for root in config.data],
        "validate": [Path(root).name for root in config.validate],
        "windows": config.windows,
        "is_recorded": any(map(is_recorded, _roots(config.data))),
        "data_fingerprint": prepared.store.index.fingerprint,
        "batch_size": config.optimisation.batch_size,
        "loss": dict(config.loss),
        "own_samples": dict(config.own_samples),
        "augmentation": dict(config.augmentation),
        "precision": config.precision,
        "seed": config.seed,
        "start": Path(config.start).name,
        "copies": config.copies,
        "commit": _commit(),
        "version": importlib.metadata.version("pd-editor"),
    }


@contextlib.contextmanager
def stop_requests() -> Iterator[Callable[[], bool]]:
    """Context with a function that tells whether Ctrl-C was pressed.

    The second Ctrl-C interrupts at once. Outside the main thread there are no requests.
    """
    asked = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield asked.is_set
        return
    earlier: dict[signal.Signals, Any] = {
        one: signal.getsignal(one) for one in _SIGNALS
    }

    def restore() -> None:
        for one, handler in earlier.items():
            signal.signal(one, handler)

    def ask(*_: object) -> None:
        asked.set()
        restore()

    for one in _SIGNALS:
        signal.signal(one, ask)
    try:
        yield asked.is_set
    finally:
        restore()
