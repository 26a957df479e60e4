"""Requested settings of a run, and the resulting configuration."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, TypeVar

import torch

from pd_editor.base.errors import TrainingError
from pd_editor.experiments.training.config.presets import (
    LOSSES,
    NETWORKS,
    PRESETS,
    SAMPLING,
    Preset,
    PresetName,
)
from pd_editor.experiments.training.config.run_config import (
    Augmentation,
    Budget,
    Precision,
    RunConfig,
)
from pd_editor.experiments.training.config.settings import Settings, with_settings
from pd_editor.experiments.training.own_samples.settings import OwnSamplesConfig
from pd_editor.generation.checkpoints.tensor_file import config_from_json

StageName = Literal["init", "traj"]
_Value = TypeVar("_Value")


@dataclass(frozen=True, kw_only=True)
class RunRequest:
    """Requested settings of a run; None selects the default."""

    stage: StageName
    data: tuple[str, ...] | None = None
    """Absolute paths of the data roots."""
    weights: tuple[float, ...] | None = None
    preset: PresetName | None = None
    minutes: float | None = None
    steps: int | None = None
    batch_size: int | None = None
    learning_rate: float | None = None
    precision: Precision | None = None
    seed: int | None = None
    start: str | None = None
    """Absolute path of a model."""
    validate: tuple[str, ...] | None = None
    """Absolute paths of roots."""
    windows: int | None = None
    copies: int | None = None
    settings: Settings = field(default_factory=Settings)
    """Values of single fields, by section; they count before the preset."""

    def with_settings(self, value: _Value, section: str) -> _Value:
        """A dataclass with the values that are given for a section.

        Raises:
            TrainingError: they cannot be; the message has their files and the stage.
        """
        place = self.settings.place(section, self.stage)
        return with_settings(value, self.settings.of(section), place)


def new_config(request: RunRequest, *, is_gpu: bool) -> RunConfig:
    """Configuration of a new run.

    Raises:
        TrainingError: the settings are invalid, or there is no data.
    """
    if not request.data:
        raise TrainingError(
            "No data was given; expected --data with the root of an Argoverse 2 "
            "dataset or a folder of synthetic shards."
        )
    preset = PRESETS[request.stage][request.preset or ("gpu" if is_gpu else "default")]
    own = {"batch_size": request.batch_size, "learning_rate": request.learning_rate}
    asked = {name: one for name, one in own.items() if one is not None}
    given = request.settings
    return RunConfig(
        stage=request.stage,
        data=request.data,
        weights=request.weights or (),
        seed=request.seed or 0,
        precision=request.precision or fast_precision(is_gpu=is_gpu),
        model=_model_of(request, preset),
        loss=asdict(request.with_settings(LOSSES[request.stage](), "loss")),
        own_samples=asdict(request.with_settings(OwnSamplesConfig(), "own_samples"))
        if given.of("own_samples")
        else {},
        augmentation=asdict(request.with_settings(Augmentation(), "augmentation")),
        sampling=_sampling_of(request),
        start=request.start or "",
        validate=request.validate or (),
        windows=request.windows or preset.windows,
        copies=request.copies or 1,
        optimisation=with_settings(
            request.with_settings(preset.optimisation, "optimisation"),
            asked,
            "optimisation",
        ),
        budget=_requested_budget(Budget(minutes=preset.minutes), request),
    )


def continued_config(earlier: RunConfig, request: RunRequest) -> RunConfig:
    """Configuration of a resumed run: the earlier one, possibly with another budget.

    Raises:
        TrainingError: other settings are requested.
    """
    same: dict[str, tuple[Any, Any]] = {
        "stage": (request.stage, earlier.stage),
        "data": (request.data, earlier.data),
        "weights": (request.weights, earlier.weights),
        "preset": (
            None
            if request.preset is None
            else _model_of(request, PRESETS[request.stage][request.preset]),
            earlier.model,
        ),
        "batch-size": (request.batch_size, earlier.optimisation.batch_size),
        "learning-rate": (request.learning_rate, earlier.optimisation.learning_rate),
        "precision": (request.precision, earlier.precision),
        "seed": (request.seed, earlier.seed),
        "from": (request.start, earlier.start),
        "validate": (request.validate, earlier.validate),
        "windows": (request.windows, earlier.windows),
        "copies": (request.copies, earlier.copies),
    }
    other = [name for name, (new, old) in same.items() if new not in (None, old)]
    other += [
        f"{section}.{name}"
        for section, fields in request.settings.values.items()
        for name, value in fields.items()
        if section_of(earlier, section).get(name) != value
    ]
    if other:
        raise TrainingError(
            f"The run was begun with another {' and '.join(other)}; leave that out to "
            "go on with it, or begin a new run."
        )
    return replace(earlier, budget=_requested_budget(earlier.budget, request))


def fast_precision(*, is_gpu: bool) -> Precision:
    """Choose bf16 where it makes matrix products much faster."""
    # Older versions of torch do not provide this.
    capabilities = getattr(torch.cpu, "get_capabilities", dict)()
    return "bf16" if is_gpu or capabilities.get("amx_tile", False) else "32"


def _requested_budget(budget: Budget, request: RunRequest) -> Budget:
    if request.minutes is not None:
        budget = replace(budget, minutes=request.minutes, steps=None)
    if request.steps is not None:
        budget = replace(budget, steps=request.steps)
    return budget


def _model_of(request: RunRequest, preset: Preset) -> Mapping[str, Any]:
    network = config_from_json(NETWORKS[request.stage], preset.model, "the preset")
    return asdict(request.with_settings(network, "model"))


def _sampling_of(request: RunRequest) -> Mapping[str, Mapping[str, Any]]:
    """Settings of the sampling that were given, checked."""
    found: dict[str, Mapping[str, Any]] = {}
    for name, kind in SAMPLING[request.stage].items():
        if given := request.settings.of(name):
            request.with_settings(kind(), name)
            found[name] = dict(given)
    return found


def section_of(config: RunConfig, section: str) -> Mapping[str, Any]:
    """Fields of a section of a configuration, as in a file."""
    if section in SAMPLING[config.stage]:
        return config.sampling.get(section, {})
    found = asdict(config)[section]
    # Values of a file are lists where a config has tuples.
    return {
        name: list(one) if isinstance(one, tuple) else one
        for name, one in found.items()
    }
