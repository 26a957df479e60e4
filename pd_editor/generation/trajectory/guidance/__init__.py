"""Guidance of predicted clean trajectories: to candidates, and by terms of the user."""
