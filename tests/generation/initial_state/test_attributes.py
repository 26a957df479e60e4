import numpy as np
import pytest
import torch

from pd_editor.base.errors import GenerationError
from pd_editor.generation.initial_state.attributes import (
    AttributeRequest,
    with_attributes,
)
from pd_editor.generation.initial_state.network.agent_count_prior import (
    AgentCounts,
    fit_agent_counts,
)
from pd_editor.generation.initial_state.network.conditioning import (
    CONDITIONED_NO,
    CONDITIONED_YES,
    UNCONDITIONED,
    sampling_conditioning,
)
from tests.generation.initial_state.scenes import packed_scene, scene_batch

COUNTS = fit_agent_counts([packed_scene(20, seed=n) for n in range(50)])


def test_with_a_wish_all_is_told_but_where_pedestrians_are():
    scene = scene_batch(30)
    is_given = torch.zeros_like(scene.has_agent)
    is_given[:, :10] = True
    task = sampling_conditioning(scene, is_given)
    random = np.random.default_rng(0)
    assert with_attributes(task, scene, COUNTS, [random]) is task
    wishes = AttributeRequest(moving_share=0.5)
    found = with_attributes(task, scene, COUNTS, [random], wishes)
    assert ((found.moves != UNCONDITIONED) == ~is_given).all()
    drives = scene.agent_kind != 4
    assert ((found.on_road != UNCONDITIONED) == (~is_given & drives)).all()
    assert {CONDITIONED_NO, CONDITIONED_YES} <= set(found.moves.unique().tolist())


def test_wishes_are_told():
    scene = scene_batch(30)
    wishes = AttributeRequest(moving_share=1.0, only_on_road=True)
    random = np.random.default_rng(0)
    found = with_attributes(
        sampling_conditioning(scene), scene, COUNTS, [random], wishes
    )
    assert (found.moves == CONDITIONED_YES).all()
    assert (found.on_road[scene.agent_kind != 4] == CONDITIONED_YES).all()


def test_weights_without_counts_take_no_requests():
    scene, random = scene_batch(3), np.random.default_rng(0)
    task = sampling_conditioning(scene)
    assert with_attributes(task, scene, AgentCounts.none(), [random]) is task
    with pytest.raises(GenerationError, match="share that moves"):
        with_attributes(
            task,
            scene,
            AgentCounts.none(),
            [random],
            AttributeRequest(only_on_road=True),
        )
