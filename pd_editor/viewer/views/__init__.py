"""Scene nodes that show a scenario: map, agents, trajectories, marks."""
