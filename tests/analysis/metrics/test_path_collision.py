"""Collisions on trajectories that an agent could take."""

import numpy as np

from pd_editor.analysis.metrics.box_overlaps import first_collisions
from tests.builders import two_agents_that_pass


def test_the_first_agent_that_a_trajectory_meets_is_told():
    scenario = two_agents_that_pass()
    agents, now = scenario.agents, scenario.current_step
    own, other = agents.position_m[0, now:], agents.position_m[1, now:]
    count = len(own)
    across = own[0] + np.linspace(0, 1, count)[:, None] * (other[20] - own[0])
    across[20:] = other[20:]
    paths = np.stack([own, across, across])
    heading = np.repeat(agents.heading_rad[:1, now:], 3, axis=0)
    found = first_collisions(scenario, 0, paths, heading, np.array([True, True, False]))
    assert found[0] is None
    assert found[2] is None
    assert found[1] is not None
    assert found[1].agent_id == agents.ids[1]
    assert now < found[1].step <= now + 20
