"""Settings of the loss of a network's own samples."""

from dataclasses import dataclass

from pd_editor.generation.core.config_limits import check_settings


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
