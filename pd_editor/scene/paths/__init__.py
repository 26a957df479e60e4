"""Lane graph, routes, and Frenet candidates of trajectories."""
