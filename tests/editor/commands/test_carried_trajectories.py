"""Which trajectories were carried along by an edit and not made anew since."""

import numpy as np

from pd_editor.editor.commands import (
    AdoptTrajectory,
    SetAgentHeading,
    SetAgentSpeed,
    SnapToLane,
    TransformAgents,
)
from pd_editor.editor.edit_findings import carried_agent_ids


def test_moving_carries_a_trajectory_and_adopting_one_makes_it_anew():
    moved = TransformAgents(agent_ids=("a", "b"), dx_m=3.0)
    adopted = AdoptTrajectory.of_arrays(
        agent_id="a",
        position_m=np.zeros((2, 2)),
        heading_rad=np.zeros(2),
        velocity_mps=np.zeros((2, 2)),
    )
    speed = SetAgentSpeed(agent_ids=("c",), speed_mps=2.0)
    assert carried_agent_ids([speed, moved]) == {"a", "b"}
    assert carried_agent_ids([moved, adopted]) == {"b"}
    again = (
        SetAgentHeading(agent_ids=("a",), heading_rad=1.0),
        SnapToLane(agent_ids=("d",)),
    )
    assert carried_agent_ids([moved, adopted, *again]) == {"a", "b", "d"}
