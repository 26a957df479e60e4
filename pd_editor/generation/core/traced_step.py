"""Denoising steps whose operations are recorded once, then run without Python."""

import dataclasses
import itertools
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, Final
from weakref import WeakKeyDictionary

import torch
from torch import Tensor, nn
from torch.jit import optimized_execution  # pyright: ignore[reportPrivateImportUsage]

_SIMPLER: Final = (
    "erase_shape_information",
    "constant_propagation",
    "cse",
    "constant_pooling",
    "dce",
)
"""Passes of torch over traced operations that leave their results as they are."""


class TracedStep:
    """A function of tensors, and of tuples and dataclasses of them, that gives a tensor.

    Steps of few agents are short, and most of their time is that of Python. After some
    calls with inputs of one form the operations are traced; results stay equal bit by bit.
    Only calls on a processor and without gradients count. The function may branch on what
    is None, on numbers that are no tensors, and on sizes below 16, but not on values.
    """

    def __init__(self, step: Callable[..., Tensor]) -> None:
        self._step = step
        self._calls: Counter[object] = Counter()
        self._traced: dict[object, Callable[..., Tensor]] = {}
        self._contexts = WeakKeyDictionary[Any, tuple[object, list[Tensor]]]()

    def __call__(self, *inputs: Any) -> Tensor:
        """Run the function, or what is known of this form; many calls share the last input."""
        # Torch's tracer ends with Python 3.13.
        if sys.version_info >= (3, 14) or not torch.is_inference_mode_enabled():
            return self._step(*inputs)
        *steps, context = inputs
        if context not in self._contexts:
            self._contexts[context] = _form(context)
        step_form, of_step = _form(tuple(steps))
        context_form, of_context = self._contexts[context]
        form, tensors = (step_form, context_form), of_step + of_context
        if not tensors[0].is_cpu:
            return self._step(*inputs)
        traced = self._traced.get(form)
        if traced is None:
            self._calls[form] += 1
            # Calls with inputs of one form before it is traced, which takes as long as
            # 30 save.
            if self._calls[form] <= 16:
                return self._step(*inputs)
            traced = self._traced[form] = self._trace(inputs, tensors)
        # The plain executor: the other one takes a tenth of a second for each function.
        with optimized_execution(should_optimize=False):
            return traced(*tensors)

    def _trace(self, inputs: Any, tensors: list[Tensor]) -> Callable[..., Tensor]:
        form = [inputs]

        def of_tensors(*tensors: Tensor) -> Tensor:
            return self._step(*_filled(form[0], iter(tensors)))

        with warnings.catch_warnings():
            # That it may go, and what it cannot know of branches: see above.
            warnings.simplefilter("ignore")
            traced: Any = torch.jit.trace(of_tensors, tuple(tensors), check_trace=False)
        form.clear()  # Torch keeps the function.
        # Sizes are of this call; what is left is found once rather than in each call.
        for name in _SIMPLER:
            # Not every version of torch has each of them.
            simplify = getattr(torch._C, f"_jit_pass_{name}", None)
            if simplify is not None:
                simplify(traced.graph)
        return traced


def trace_steps(model: nn.Module) -> None:
    """Let a model's ``denoise`` be traced, where the model has it."""
    step = getattr(model, "denoise", None)
    if step is not None:
        vars(model)["denoise"] = TracedStep(step)


def _form(value: Any) -> tuple[object, list[Tensor]]:
    """What traced operations depend on, and the tensors."""
    if isinstance(value, Tensor):
        # Sizes from here on are of one form: no operation depends on which one it is.
        return (value.dtype, *(min(size, 16) for size in value.shape)), [value]
    if dataclasses.is_dataclass(value):
        parts = vars(value).values()
    elif isinstance(value, tuple):
        parts = value
    else:
        return value, []
    forms = [_form(one) for one in parts]
    tensors = list(itertools.chain.from_iterable(found for _, found in forms))
    return (type(value), *(form for form, _ in forms)), tensors


def _filled(value: Any, tensors: Iterator[Tensor]) -> Any:
    """The same value with other tensors."""
    if isinstance(value, Tensor):
        return next(tensors)
    if isinstance(value, tuple):
        parts = [_filled(one, tensors) for one in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {key: _filled(one, tensors) for key, one in vars(value).items()}
        return dataclasses.replace(value, **fields)
    return value
