"""Configuration of a training run: everything that determines its result."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Final, Literal

import msgspec

from pd_editor.base.errors import TrainingError
from pd_editor.generation.defaults import check_settings

MAX_STEPS: Final = 1_000_000_000
MAX_MINUTES: Final = 1e6
Precision = Literal["32", "bf16"]


@dataclass(frozen=True, kw_only=True)
class Optimisation:
    """Optimisation by AdamW; the rate has a warm-up, a plateau and a cosine decay."""

    batch_size: int = 24
    """Number of scenes of a step over all devices."""
    learning_rate: float = 1e-3
    """Highest learning rate, reached at the end of the warm-up."""
    weight_decay: float = 0.01
    """Weight decay of matrices; biases and gains have none."""
    warmup_steps: int = 100
    """Steps in which the learning rate rises to its highest value."""
    constant_share: float = 0.4
    """Share of the budget before the learning rate decays."""
    max_gradient_norm: float = 1.0
    """Longer gradients are shortened to this norm."""
    ema_decay: float = 0.999
    """Decay of the moving average of the weights, which is the trained model."""

    def __post_init__(self) -> None:
        _check_range(self, 1, 65_536, "batch_size")
        _check_range(self, 0, MAX_STEPS, "warmup_steps")
        _check_range(self, 0, 1e3, "weight_decay")
        for name in ("ema_decay", "constant_share"):
            if not 0 <= getattr(self, name) < 1:
                raise TrainingError(
                    f"{name} is {getattr(self, name)}; expected at least 0 and below 1."
                )
        for name in ("learning_rate", "max_gradient_norm"):
            if not 0 < getattr(self, name) <= 1e3:
                raise TrainingError(
                    f"{name} is {getattr(self, name)}; expected more than 0 and at most "
                    "1000."
                )


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Duration of a run and frequency of validations; ``steps`` overrides ``minutes``."""

    minutes: float = 20.0
    """Training time, without the preparation of the data."""
    steps: int | None = None
    checkpoint_minutes: float = 3.0
    held_out_share: float = 0.04
    """Share of the networks or cities for validation."""
    held_out_scenes: int = 160
    """Limit of validation scenes."""

    def __post_init__(self) -> None:
        if self.steps is not None:
            _check_range(self, 1, MAX_STEPS, "steps")
        for name in ("minutes", "checkpoint_minutes"):
            if not 0 < getattr(self, name) <= MAX_MINUTES:
                raise TrainingError(
                    f"{name} is {getattr(self, name)}; expected more than 0 and at most "
                    f"{MAX_MINUTES:g}."
                )
        _check_range(self, 0, MAX_STEPS, "held_out_scenes")
        if not 0 <= self.held_out_share < 1:
            raise TrainingError(
                f"held_out_share is {self.held_out_share}; expected at least 0 and "
                "below 1."
            )


@dataclass(frozen=True, kw_only=True)
class Augmentation:
    """How often and how much scenarios are changed; shares are of scenarios."""

    warp_share: float = 0.3
    """Share of roads that are warped ahead of the focal agent, as in Scene-Attack."""
    jitter_m: float = 0.1
    """Standard deviation of the random displacement of a map under its agents."""
    jitter_wave_m: tuple[float, float] = (40.0, 160.0)
    """Shortest and longest wave length of that displacement."""
    lanes_dropped_share: float = 0.15
    """Share of scenarios from whose maps lanes are left out."""
    lane_dropped: float = 0.12
    """Chance of each lane in such scenarios."""
    agents_dropped_share: float = 0.15
    """Share of scenarios from which agents are left out."""
    agent_dropped: float = 0.4
    """Greatest chance of each agent in such scenarios."""
    parked_seen: float = 0.85
    """Chance of each simulated parked agent on the drivable area. Inside the square that
    the first stage fills, Argoverse 2 has 8.5 standing vehicles on it and 0.9 off it;
    without this the corpus has 10.7 and 2.2 (``train``)."""
    parked_off_road_seen: float = 0.4
    """The same off the drivable area, on yards and forecourts."""
    far_parked_seen: float = 0.4
    """Factor of both further than 60 m from the ego: rows hide each other."""
    most_crawling: float = 1.0
    """Greatest share of the moving vehicles that crawl (below 3 m/s); simulated scenes with
    more are left out. Of the corpus 28 % crawl, with 0.5 18, in recordings 19
    (``train``)."""
    signals_dropped_share: float = 0.4
    """Share of scenarios whose traffic signals are left out, as most maps have none."""
    center_m: float = 12.0
    """Standard deviation of the middle of a scene about its focal agent."""

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if name in ("jitter_m", "center_m"):
                _check_range(self, 0, 1_000.0, name)
            elif not isinstance(value, tuple):
                _check_range(self, 0, 1, name)


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """Configuration of a run; equal values and data give equal weights."""

    stage: str
    data: tuple[str, ...]
    """Roots of Argoverse 2 datasets or of shards."""
    weights: tuple[float, ...] = ()
    """Share of each root in a batch; empty: proportional to the number of scenes."""
    seed: int = 0
    precision: Precision = "32"
    model: Mapping[str, Any]
    """Configuration of the stage's network."""
    loss: Mapping[str, Any] = field(default_factory=dict)
    """Settings of the stage's loss; missing ones have their defaults."""
    own_samples: Mapping[str, Any] = field(default_factory=dict)
    """Settings of the loss of the network's own samples; empty: there is none."""
    augmentation: Mapping[str, Any] = field(default_factory=dict)
    """Settings of the augmentation; those that are missing are as usual."""
    sampling: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Settings of the stage's sampler and guidance that differ from those of the model
    to start from, or from the defaults."""
    start: str = ""
    """Folder of the model whose weights initialise the network; empty: random weights."""
    validate: tuple[str, ...] = ()
    """Roots for validation; empty: a part of the data."""
    windows: int = 1
    """Number of current steps at which each scenario of Argoverse 2 is used."""
    copies: int = 1
    """Number of independently augmented copies of each scenario."""
    optimisation: Optimisation
    budget: Budget

    def __post_init__(self) -> None:
        _check_range(self, 0, 2**63 - 1, "seed")
        _check_range(self, 1, 64, "copies")
        _check_range(self, 1, 40, "windows")
        if self.weights and len(self.weights) != len(self.data):
            raise TrainingError(
                f"{len(self.weights)} weights were given for {len(self.data)} data "
                "roots; expected one for each."
            )
        if any(not 0 < one < float("inf") for one in self.weights):
            raise TrainingError("The weights of data roots must be greater than 0.")

    def to_json(self) -> str:
        """Configuration as JSON text."""
        return json.dumps(asdict(self), indent=2, sort_keys=True) + "\n"

    @classmethod
    def from_json(cls, text: str | bytes) -> "RunConfig":
        """Read a configuration that ``to_json`` wrote.

        Raises:
            TrainingError: the text is no configuration, or of another version.
        """
        try:
            config = msgspec.json.decode(text, type=cls)
            values = msgspec.json.decode(text)
        except msgspec.ValidationError as error:
            reason = str(error).replace("`$.", "`")
            raise TrainingError(
                f"The run's configuration is impossible or of another version: {reason}."
            ) from error
        except (msgspec.DecodeError, RecursionError) as error:
            raise TrainingError(f"The run's configuration is no JSON ({error}).") from (
                error
            )
        known = asdict(config)
        for part, names in (
            (values, known),
            *((values[name], known[name]) for name in ("optimisation", "budget")),
        ):
            if unknown := sorted(part.keys() - names.keys()):
                raise TrainingError(
                    "The run's configuration is of another version (unknown field "
                    f"{unknown[0]!r})."
                )
        return config


def _check_range(part: Any, least: float, most: float, name: str) -> None:
    if not least <= getattr(part, name) <= most:
        raise TrainingError(
            f"{name} is {getattr(part, name)}; expected {least} to {most}."
        )


@dataclass(frozen=True, kw_only=True)
class OwnSamplesConfig:
    """What is wrong with the samples of a network, as a loss beside that of denoising.

    The gradient flows through the last steps of the sampler only (DRaFT-K: Clark et al.,
    Directly fine-tuning diffusion models on differentiable rewards, 2024).
    """

    weight: float = 0.0
    """Weight relative to the loss of denoising; 0: nothing is sampled."""
    num_samples: int = 2
    """Samples of each scene; the distance of two of them counts against ``truth``."""
    num_gradient_steps: int = 2
    """Number K of the last denoising steps that are differentiated."""
    collision: float = 1.0
    """Weight of the depth of collisions, in metres."""
    road: float = 0.0
    """Weight of the distance off the drivable area, in metres (trajectories)."""
    truth: float = 0.0
    """Weight of the energy score against the true trajectories, in metres. It is least
    for samples of the true distribution: narrow and wide ones are both worse."""
    margin_m: float = 0.1
    """Gap between boxes below which they count as colliding."""

    def __post_init__(self) -> None:
        check_settings(self)
