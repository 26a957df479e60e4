"""Motion of trajectories: displacement errors, diversity, speed, acceleration, jerk."""
