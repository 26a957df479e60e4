"""Which device a model draws on."""

import torch

from pd_editor.diffusion.defaults import DeviceName
from pd_editor.errors import GenerationError


def sampling_device(name: DeviceName) -> torch.device:
    """The device of a name.

    Raises:
        GenerationError: a GPU is asked for, and there is none.
    """
    has_gpu = torch.cuda.is_available()
    if name == "cuda" and not has_gpu:
        raise GenerationError(
            "A GPU was asked for, but none can be used here; take the device cpu or "
            "auto, or check the driver and that torch is built for CUDA."
        )
    return torch.device("cuda" if has_gpu and name != "cpu" else "cpu")
