"""Metrics of agents and scenes, and distances between distributions."""
