"""How fast both stages train on the scenarios in the folder PD_EDITOR_CORPUS.

CPU seconds of the process are counted, so that other work on the machine matters
little; with one thread they are what the clock shows on a quiet machine.
"""

import os
import statistics
import time
from pathlib import Path

import numpy as np
import torch
from lightning_fabric import Fabric

from pd_editor.experiments.training.run_config import Budget, RunConfig
from pd_editor.experiments.training.run_folder import RunFolder
from pd_editor.experiments.training.settings import PRESETS
from pd_editor.experiments.training.stage_objective import STAGES
from pd_editor.experiments.training.train_loop import TrainLoop
from pd_editor.experiments.training.training_data import (
    BatchSampler,
    default_cache,
    prepared_data,
    training_data,
)

_STEPS = 30


def main() -> None:
    torch.set_num_threads(1)
    root = Path(os.environ["PD_EDITOR_CORPUS"])
    prepared = prepared_data([root], default_cache())
    data = training_data(prepared.store, Budget(), seed=0)
    print(
        f"{len(prepared.store)} scenes, {prepared.store.num_agents.mean():.1f} agents"
    )
    print("stage  precision  CPU ms/step (median, min)   scenes/s   batch ms")
    for name, stage in STAGES.items():
        preset = PRESETS[name]["default"]
        config = stage.kind.config_type(**preset.model)
        size = preset.optimisation.batch_size
        sampler = BatchSampler(
            data.training_rows, data.size, shares=[1], batch_size=size, seed=0
        )
        began = time.thread_time()
        for step in range(_STEPS):
            data.batch(sampler.rows(step))
        batch_ms = 1000 * (time.thread_time() - began) / _STEPS
        for precision in ("32", "bf16"):
            run = RunConfig(
                stage=name,
                data=(str(root),),
                model=preset.model,
                optimisation=preset.optimisation,
                budget=Budget(steps=10**6),
                precision=precision,
            )
            loop = TrainLoop(
                run,
                stage.fresh_model(config, prepared.basis, 0),
                stage.loss({}),
                data,
                RunFolder(Path("/dev/null")),
                Fabric(
                    accelerator="cpu",
                    devices=1,
                    precision="bf16-mixed" if precision == "bf16" else "32-true",
                ),
            )
            times = _step_times(loop, data, sampler)
            middle = statistics.median(times)
            print(
                f"{name:5}  {precision:9}  {1000 * middle:7.1f} {1000 * min(times):7.1f}"
                f"              {size / np.mean(times):6.0f}   {batch_ms:6.2f}"
            )


def _step_times(loop: TrainLoop, data, sampler: BatchSampler) -> list[float]:
    times = []
    for step in range(_STEPS + 3):
        batch = data.batch(sampler.rows(step))
        began = time.process_time()
        loop._step(batch)
        times.append(time.process_time() - began)
    return times[3:]


if __name__ == "__main__":
    main()
