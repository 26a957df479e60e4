"""Sizes that are drawn by kind."""

import numpy as np

from pd_editor.scene.agent_kind import AgentKind, default_sizes_m, sampled_sizes_m


def test_drawn_sizes_lie_about_the_defaults_and_static_ones_are_the_defaults():
    for kind in AgentKind:
        kinds = (kind,) * 4001
        drawn = sampled_sizes_m(kinds, np.random.default_rng(1))
        default = default_sizes_m((kind,))[0]
        assert np.array_equal(drawn, drawn.round(2))
        assert np.allclose(np.median(drawn, axis=0), default, rtol=0.15)
        assert (drawn > 0.3 * default).all()
        assert (drawn < 3 * default).all()
        order = np.lexsort(drawn.T[::-1])
        assert (np.diff(drawn[order, 1]) >= 0).all()
    assert sampled_sizes_m((), np.random.default_rng(1)).shape == (0, 2)
