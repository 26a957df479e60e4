"""A model on disk: a folder with the weights of its stages and ``config.json``."""

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import torch
from torch import Tensor, nn
from torch.overrides import TorchFunctionMode

from pd_editor.base.errors import ModelError
from pd_editor.base.regular_file import read_regular, write_whole
from pd_editor.generation.checkpoints.tensor_file import (
    check_fit,
    config_from_json,
    in_half_precision,
    load_into,
    read_tensors,
    write_tensors,
)
from pd_editor.generation.defaults import MAX_CONFIG_BYTES

CONFIG_NAME: Final = "config.json"
FORMAT: Final = "pd-editor-model"
FORMAT_VERSION: Final = 2


@dataclass(frozen=True, kw_only=True)
class StageKind:
    """Kind of a stage: name, file and network."""

    name: str
    file_name: str
    config_type: type[Any]
    """Flat dataclass of plain values that ``make_model`` takes."""
    make_model: Callable[[Any], nn.Module]
    earlier: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the configuration that older models lack, with what they mean there."""
    make_for: Callable[[Any, Mapping[str, Tensor]], nn.Module] | None = None
    """Makes a network for tensors of a file, if these determine some of its sizes."""
    sampling_types: Mapping[str, type[Any]] = field(default_factory=dict)
    """Flat dataclasses of sampling settings by name, with defaults."""
    earlier_sampling: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Sampling settings that models trained before lack, with what they did."""
    former_sampling: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Settings that older models hold, with the only value that had a use, by part."""
    former_switches: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """Switches that older models hold, each with the number that is 0 where it is off. One
    that is among ``former_sampling``, too, may be off where the number is 0 already."""
    statistics: frozenset[str] = frozenset()
    """Names of tensors that describe the training data and the network's errors. They may
    be missing, and differ between networks whose weights are averaged."""

    def default_sampling(self) -> dict[str, Any]:
        """Default sampling settings."""
        return {name: made() for name, made in self.sampling_types.items()}


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainedStage:
    """A stage with its weights and settings."""

    kind: StageKind
    config: Any
    model: nn.Module
    sampling: Mapping[str, Any] = field(default_factory=dict)
    """Sampling settings: an instance of each of the kind's ``sampling_types``."""
    about: Mapping[str, Any] = field(default_factory=dict)
    """Training record, as JSON values."""
    sha256: str = ""
    """Hash of the weights' file."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainedModel:
    """Contents of a model folder; a stage may be absent."""

    name: str
    stages: Mapping[str, TrainedStage]

    @property
    def sha256(self) -> str:
        """Hash of all weights."""
        digests = "".join(self.stages[name].sha256 for name in sorted(self.stages))
        return hashlib.sha256(digests.encode()).hexdigest()

    def stage(self, name: str) -> TrainedStage:
        """A required stage.

        Raises:
            ModelError: the folder has no weights of the stage.
        """
        if name not in self.stages:
            raise ModelError(
                f"The model {self.name} has no weights of the stage {name!r}, only "
                f"of {', '.join(sorted(self.stages)) or 'none'}."
            )
        return self.stages[name]

    def with_networks(self, networks: Mapping[str, nn.Module]) -> "TrainedModel":
        """The model with other networks in stages that it has, which the hash tells."""
        stages = dict(self.stages)
        for name, other in networks.items():
            sha256 = _sha256(other)
            stages[name] = replace(self.stage(name), model=other.eval(), sha256=sha256)
        return replace(self, stages=stages)


def _sha256(network: nn.Module) -> str:
    """Hash of the class and weights of a network."""
    kind = type(network)
    digest = hashlib.sha256(f"{kind.__module__}.{kind.__qualname__}".encode())
    for name, values in network.state_dict().items():
        plain = values.detach().cpu().contiguous().flatten().view(torch.uint8)
        digest.update(name.encode() + plain.numpy().tobytes())
    return digest.hexdigest()


def save_model(
    folder: Path, stages: Mapping[str, TrainedStage], *, half: bool = False
) -> None:
    """Write a model folder, in which stages of the same names are replaced.

    The list of files with hashes is written last, so that an incomplete folder is
    detected when it is read. With ``half`` weights are float16, for shipping.

    Raises:
        ModelError: the folder cannot be written.
    """
    listed: dict[str, Any] = {}
    for name, stage in sorted(stages.items()):
        tensors = in_half_precision(stage.model) if half else stage.model.state_dict()
        digest = write_tensors(folder / stage.kind.file_name, name, tensors, {})
        listed[name] = {
            "file": stage.kind.file_name,
            "sha256": digest,
            "precision": "float16" if half else "float32",
            "parameters": sum(one.numel() for one in stage.model.parameters()),
            "config": asdict(stage.config),
            "sampling": {
                part: asdict(one)
                for part, one in (
                    stage.kind.default_sampling() | dict(stage.sampling)
                ).items()
            },
            "training": dict(stage.about),
        }
    content = {"format": FORMAT, "version": FORMAT_VERSION, "stages": listed}
    text = json.dumps(content, indent=2, sort_keys=True) + "\n"
    write_whole(folder / CONFIG_NAME, text.encode(), ModelError)


def load_model(folder: Path, kinds: Mapping[str, StageKind]) -> TrainedModel:
    """Read all stages of a model folder, on the CPU, in evaluation mode.

    Raises:
        ModelError: files are missing, damaged, foreign, or do not fit each other.
    """
    path = folder / CONFIG_NAME
    try:
        content = json.loads(
            read_regular(path, max_bytes=MAX_CONFIG_BYTES, error=ModelError)
        )
    except ModelError as error:
        raise ModelError(f"{folder}: is no model; {error}") from error
    except (ValueError, RecursionError) as error:
        raise ModelError(f"{path}: is not valid JSON ({error}).") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ModelError(f"{path}: does not describe a model of this program.")
    version = content.get("version")
    if version != FORMAT_VERSION:
        raise ModelError(
            f"{path}: has the format version {version!r}; expected {FORMAT_VERSION}."
        )
    listed = content.get("stages")
    if not isinstance(listed, dict) or not listed:
        raise ModelError(f"{path}: lists no stage.")
    stages = {
        name: _loaded_stage(folder, name, entry, kinds)
        for name, entry in listed.items()
    }
    name = os.path.basename(os.path.realpath(folder))
    return TrainedModel(name=name, stages=stages)


def _loaded_stage(
    folder: Path,
    name: str,
    entry: Any,
    kinds: Mapping[str, StageKind],
) -> TrainedStage:
    path = folder / CONFIG_NAME
    if name not in kinds:
        raise ModelError(
            f"{path}: lists the stage {name!r}; expected {', '.join(sorted(kinds))}."
        )
    if not isinstance(entry, dict) or not isinstance(entry.get("config"), dict):
        raise ModelError(f"{path}: the stage {name!r} has no configuration.")
    about = entry.get("training", {})
    if not isinstance(about, dict):
        raise ModelError(f"{path}: the stage {name!r} does not say how it was trained.")
    kind = kinds[name]
    file = read_tensors(folder / kind.file_name, name)
    if file.sha256 != entry.get("sha256"):
        raise ModelError(
            f"{folder / kind.file_name}: differs from what {CONFIG_NAME} lists "
            "(SHA-256); the folder is damaged or mixed from several models."
        )
    if (make_for := kind.make_for) is not None:
        made = file.tensors
        kind = replace(kind, make_model=lambda config: make_for(config, made))
    source = f"{path}, {name}"
    config = config_from_json(
        kind.config_type, {**kind.earlier, **entry["config"]}, source
    )
    # On the device meta a network takes no memory, so that sizes that do not fit are
    # detected before anything is allocated.
    with torch.device("meta"), _WithoutRandomValues():
        outline = made_model(kind, config, seed=0, source=source)
    check_fit(outline, file.tensors, folder / kind.file_name, kind.statistics)
    model = made_model(kind, config, seed=0, source=source)
    load_into(model, file.tensors, folder / kind.file_name, kind.statistics)
    model.requires_grad_(requires_grad=False).eval()
    return TrainedStage(
        kind=kind,
        config=config,
        model=model,
        sampling=_sampling(kind, entry.get("sampling", {}), source),
        about=about,
        sha256=file.sha256,
    )


def _sampling(kind: StageKind, given: Any, source: str) -> dict[str, Any]:
    """Sampling settings of a stage."""
    if not isinstance(given, dict) or given.keys() != kind.sampling_types.keys():
        raise ModelError(
            f"{source}: 'sampling' must hold "
            f"{', '.join(sorted(kind.sampling_types)) or 'nothing'}."
        )
    found: dict[str, Any] = {}
    for name, values in given.items():
        if not isinstance(values, dict):
            raise ModelError(f"{source}, {name}: holds no fields; expected an object.")
        former = kind.former_sampling.get(name, {})
        switches = kind.former_switches.get(name, {})
        for setting, value in former.items():
            is_idle = values.get(switches.get(setting, "")) == 0
            if values.get(setting, value) != value and not is_idle:
                raise ModelError(
                    f"{source}, {name}: {setting} can no longer be set; expected "
                    f"{value}, as in all models that were shipped."
                )
        off = {one: 0.0 for key, one in switches.items() if values.get(key) is False}
        left = dict(kind.earlier_sampling.get(name, {})) | {
            key: off.get(key, value)
            for key, value in values.items()
            if key not in {*former, *switches}
        }
        part = kind.sampling_types[name]
        found[name] = config_from_json(part, left, f"{source}, {name}")
    return found


class _WithoutRandomValues(TorchFunctionMode):
    """Leaves weights as they are where layers would fill them with random values.

    On the device meta there is nothing to fill, but torch would import its compiler for
    it, which takes seconds.
    """

    def __torch_function__(
        self,
        func: Callable[..., Any],
        types: Iterable[type],
        args: tuple[Any, ...] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Any:
        values = dict(kwargs or {})
        if func in (nn.init.normal_, nn.init.uniform_, nn.init.kaiming_uniform_):
            return args[0] if args else values["tensor"]
        return func(*args, **values)


def made_model(
    kind: StageKind, config: Any, *, seed: int, source: object = "configuration"
) -> nn.Module:
    """Make a network with random weights that depend on the seed only.

    Raises:
        ModelError: the configuration is not valid.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        try:
            return kind.make_model(config)
        except (
            RuntimeError,
            ValueError,
            TypeError,
            AssertionError,
            ArithmeticError,
            MemoryError,
        ) as error:
            # torch's messages continue with lines of its stack.
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            raise ModelError(
                f"{source}: no network can be made of it ({reason})."
            ) from error


def averaged_stage(
    stages: Sequence[TrainedStage], sources: Sequence[object]
) -> TrainedStage:
    """Average the weights of a stage; all else is that of the first.

    The average of trainings that began with the same weights is often better than each
    of them, of others it is useless. The first stage's network is changed.

    Args:
        stages: The same stage of several models.
        sources: Where each comes from, for messages.

    Raises:
        ModelError: the networks or their trajectory bases differ, or they began with
            random weights of several seeds.

    Source: Wortsman et al., Model soups, 2022.
    """
    first = stages[0]
    if len(stages) == 1:
        return first
    tensors = [stage.model.state_dict() for stage in stages]
    weights = dict(first.model.named_parameters())
    for stage, other, source in zip(stages, tensors, sources, strict=True):
        fixed = other.keys() - weights - first.kind.statistics
        if stage.config != first.config or not all(
            torch.equal(other[name], tensors[0][name]) for name in fixed
        ):
            raise ModelError(
                f"{source}: its {first.kind.name} network or trajectory basis differs from "
                f"that of {sources[0]}; expected trainings that began with one model."
            )
        seeds = [
            one.about.get("seed")
            for one in (first, stage)
            if one.about.get("start") == ""
        ]
        if len(set(seeds)) > 1:
            raise ModelError(
                f"{source}: began with the random weights of seed {seeds[1]}, {sources[0]} "
                f"with those of seed {seeds[0]}; expected trainings that began with one "
                "model (pd-editor train --from)."
            )
    with torch.no_grad():
        for name, one in weights.items():
            one.copy_(torch.stack([other[name] for other in tensors]).mean(dim=0))
    others = [dict(stage.about) for stage in stages[1:]]
    return replace(first, about={**first.about, "averaged_with": others})
