"""What a training has led to."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True, eq=False)
class Training:
    """Result of a training, and its files."""

    folder: Path
    model: Path
    """Folder of the weights, as ``generate --model`` takes it."""
    steps: int
    minutes: float
    held_out_loss: float
    """Loss on held-out scenes; NaN without any."""
    num_scenes: int
    num_left_out: int
    """Number of scenarios and files that could not be used, or are not trained on."""
    is_stopped: bool
    """Whether it was stopped before its time; it can be resumed."""
    is_first: bool
    """Whether this is the first of all processes, which reports the result."""

    def __str__(self) -> str:
        """The model's folder, then remarks."""
        remarks = [
            f"{self.steps} steps in {self.minutes:.1f} minutes on {self.num_scenes} "
            f"scenes; held-out loss {self.held_out_loss:.4f}."
        ]
        if self.num_left_out:
            remarks.append(f"{self.num_left_out} scenarios or files were left out.")
        if self.is_stopped:
            remarks.append(f"Stopped; go on with --resume --out {self.folder}")
        return "\n".join([str(self.model), *remarks])
