"""Which device a model samples on, with how many threads, and in which memory."""

import contextlib
import functools
from collections.abc import Iterator, Sequence

import torch
from jaxtyping import Bool
from torch import Tensor, nn

from pd_editor.base.errors import GenerationError
from pd_editor.generation.defaults import DeviceName


def sampling_device(name: DeviceName) -> torch.device:
    """The device of a name.

    Raises:
        GenerationError: a GPU is requested, and there is none.
    """
    has_gpu = torch.cuda.is_available()
    if name == "cuda" and not has_gpu:
        raise GenerationError(
            "A GPU was asked for, but none can be used here; take the device cpu or "
            "auto, or check the driver and that torch is built for CUDA."
        )
    return torch.device("cuda" if has_gpu and name != "cpu" else "cpu")


def constant(values: Sequence[object], like: Tensor) -> Tensor:
    """Numbers in the type and on the device of a tensor; nothing waits for a GPU."""
    here = torch.tensor(values, dtype=like.dtype, device="cpu")
    return here.to(like.device, non_blocking=True)


def is_known(fact: Bool[Tensor, ""]) -> bool:
    """Whether something holds, and asking does not wait for a GPU.

    Nothing is known while operations are traced, which are for other values as well.
    """
    is_traced = torch.jit.is_tracing()  # pyright: ignore[reportPrivateImportUsage]
    return fact.is_cpu and not is_traced and bool(fact)


def keep_freed_memory() -> None:
    """Let the C library keep memory that tensors leave, for the next ones.

    glibc keeps as much as twice the largest block that was freed so far, and gives the
    rest back page by page: of the context of 32 agents that took a third of the time.
    """
    # Numbers of four bytes; larger tensors are rare.
    torch.empty(4_000_000, device="cpu")


def lay_out_weights(model: nn.Module) -> None:
    """Store the weights of linear layers input by input; values do not change.

    Products of few rows with weights that are not in the fastest cache then take 0.8 of
    the time.
    """
    for layer in model.modules():
        if isinstance(layer, nn.Linear):
            layer.weight.data = layer.weight.data.T.contiguous().T


@contextlib.contextmanager
def threads_for(num_rows: int) -> Iterator[None]:
    """Context with few threads for operations on few rows, one for 0.

    They are so short that waiting for other threads would dominate.
    """
    usual = _usual_threads()
    torch.set_num_threads(min(usual, 1 + num_rows // 256))
    try:
        yield
    finally:
        torch.set_num_threads(usual)


@functools.cache
def _usual_threads() -> int:
    """Number of torch's threads when the process first sampled.

    A later value may be the one that a concurrent step in another thread has set.
    """
    return torch.get_num_threads()
