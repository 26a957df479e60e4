"""The second stage: trajectories of agents from their states."""
