import gc
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import pytest
import torch
from torch import Tensor

from pd_editor.generation.core.traced_step import TracedStep
from pd_editor.generation.initial_state.network.conditioning import (
    sampling_conditioning,
)
from tests.generation.initial_state import scenes as initial_states
from tests.generation.trajectory import scenes as trajectories

ENOUGH = 20
"""Calls after which inputs of a form are traced."""


class Counted:
    """A step that counts how often it runs in Python."""

    def __init__(self, step: Callable[..., Tensor]) -> None:
        self.step, self.count = step, 0

    def __call__(self, *inputs: Any) -> Tensor:
        self.count += 1
        return self.step(*inputs)


class Factors(NamedTuple):
    scale: Tensor
    offset: Tensor | None


@dataclass(frozen=True, eq=False)
class Form:
    factors: Factors
    all_of: tuple[Tensor, ...]
    is_doubled: bool = False


def plain_step(values: Tensor, form: Form) -> Tensor:
    found = values * form.factors.scale
    if form.factors.offset is not None:
        found = found + form.factors.offset
    if form.is_doubled:
        found = 2 * found
    if values.shape[-1] < 16:
        found = torch.nn.functional.pad(found, (0, 16 - values.shape[-1]))
    return found.cumsum(-1) + sum(one.sum() for one in form.all_of)


def of_sizes(*sizes: int, offset: bool = False, doubled: bool = False) -> list[Any]:
    values = torch.linspace(-1, 1, sizes[0] * 3).view(3, -1)
    plus = torch.full((sizes[0],), 0.5) if offset else None
    each = tuple(torch.linspace(0, 1, size) for size in sizes[1:])
    return [values, Form(Factors(values.square() + 1, plus), each, doubled)]


def run(step: Callable[..., Tensor], inputs: Sequence[Any], count: int = 1) -> Tensor:
    found = torch.empty(0)
    with torch.inference_mode():
        for _ in range(count):
            found = step(*inputs)
    return found


def test_every_form_has_operations_of_its_own() -> None:
    forms = [
        of_sizes(5, 3),
        of_sizes(7, 3),
        of_sizes(40, 3),
        of_sizes(40, 3, offset=True),
        of_sizes(40, 3, doubled=True),
        of_sizes(40, 3, 4),
    ]
    step = Counted(plain_step)
    traced = TracedStep(step)
    for inputs in forms:
        run(traced, inputs, ENOUGH)
    ran = step.count
    assert ran < ENOUGH * len(forms)
    for inputs in (*forms, of_sizes(41, 3), of_sizes(100, 3)):
        assert torch.equal(run(traced, inputs), plain_step(*inputs))
    assert step.count == ran


def test_inputs_are_not_kept() -> None:
    traced = TracedStep(plain_step)
    inputs = of_sizes(20, 3)
    run(traced, inputs, ENOUGH)
    known = weakref.ref(inputs[-1])
    del inputs
    gc.collect()
    assert known() is None


def test_what_is_differentiated_is_not_traced() -> None:
    step = Counted(plain_step)
    traced = TracedStep(step)
    values, form = of_sizes(20, 3)
    values.requires_grad_()
    for _ in range(ENOUGH):
        traced(values, form).sum().backward()
    assert step.count == ENOUGH
    assert values.grad is not None


@pytest.mark.parametrize("has_given", [False, True])
@pytest.mark.parametrize("counts", [(18, 40), (30, 17), (64, 21)])
def test_steps_of_initial_states_are_equal_for_other_scenes_of_the_form(
    counts: tuple[int, int], has_given: bool
) -> None:
    model = initial_states.trained_a_little(initial_states.small_model())
    model.requires_grad_(requires_grad=False)
    step = Counted(model.denoise)
    traced = TracedStep(step)

    def inputs(*numbers: int) -> list[Any]:
        scene = initial_states.scene_batch(*numbers)
        task = sampling_conditioning(scene)
        if has_given:
            given = scene.has_agent.clone()
            given[:, ::2] = False
            task = replace(task, is_given=given)
        parts = model.config.num_state_parts
        noisy = torch.randn((3, *scene.has_agent.shape, parts))
        context = model.encode_context(scene, task)
        return [noisy, model.encode_level(torch.full((3, 2), 0.4), context), context]

    with torch.inference_mode():
        run(traced, inputs(20, 25), ENOUGH)
        ran, others = step.count, inputs(*counts)
        assert torch.equal(run(traced, others), model.denoise(*others))
    assert step.count == ran


@pytest.mark.parametrize("counts", [(18, 40), (30, 17), (64, 21)])
def test_steps_of_trajectories_are_equal_for_other_scenes_of_the_form(
    counts: tuple[int, int],
) -> None:
    model = trajectories.small_model().requires_grad_(requires_grad=False)
    step = Counted(model.denoise)
    traced = TracedStep(step)

    def inputs(*numbers: int) -> list[Any]:
        scene = trajectories.scene_batch(*numbers)
        noisy = torch.randn((3, *scene.has_agent.shape, 10))
        levels = model.encode_level(torch.full(noisy.shape[:-1], 0.6))
        return [noisy, levels, model.encode_context(scene)]

    with torch.inference_mode():
        run(traced, inputs(20, 25), ENOUGH)
        ran, others = step.count, inputs(*counts)
        assert torch.equal(run(traced, others), model.denoise(*others))
    assert step.count == ran
