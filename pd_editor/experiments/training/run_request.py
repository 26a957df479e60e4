"""Requested settings of a run, and the resulting configuration."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, TypeVar

import torch

from pd_editor.base.errors import TrainingError
from pd_editor.experiments.training.run_config import (
    Augmentation,
    Budget,
    Optimisation,
    OwnSamplesConfig,
    Precision,
    RunConfig,
)
from pd_editor.experiments.training.settings import (
    LOSSES,
    NETWORKS,
    PRESETS,
    SAMPLING,
    Preset,
    PresetName,
    Settings,
    StageName,
    with_settings,
)
from pd_editor.generation.checkpoints.tensor_file import config_from_json

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

    def given(self, part: type[Any]) -> dict[str, Any]:
        """What is asked for of the fields of a part of the configuration."""
        asked = {one.name: getattr(self, one.name, None) for one in fields(part)}
        return {name: value for name, value in asked.items() if value is not None}

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
    usual = {"precision": fast_precision(is_gpu=is_gpu), "windows": preset.windows}
    return RunConfig(
        **{**usual, **request.given(RunConfig)},
        model=_model_of(request, preset),
        loss=asdict(request.with_settings(LOSSES[request.stage](), "loss")),
        own_samples=asdict(request.with_settings(OwnSamplesConfig(), "own_samples"))
        if request.settings.of("own_samples")
        else {},
        augmentation=asdict(request.with_settings(Augmentation(), "augmentation")),
        sampling=_sampling_of(request),
        optimisation=with_settings(
            request.with_settings(preset.optimisation, "optimisation"),
            request.given(Optimisation),
            "optimisation",
        ),
        budget=_requested_budget(Budget(minutes=preset.minutes), request),
    )


def continued_config(earlier: RunConfig, request: RunRequest) -> RunConfig:
    """Configuration of a resumed run: the earlier one, possibly with another budget.

    Raises:
        TrainingError: other settings are requested.
    """
    other = [
        "from" if name == "start" else name.replace("_", "-")
        for part in (earlier, earlier.optimisation)
        for name, value in request.given(type(part)).items()
        if value != getattr(part, name)
    ]
    if request.preset is not None:
        model = _model_of(request, PRESETS[request.stage][request.preset])
        other += ["preset"] * (model != earlier.model)
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
    given = request.given(Budget)
    if "minutes" in given:
        budget = replace(budget, steps=None)
    return replace(budget, **given)


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
