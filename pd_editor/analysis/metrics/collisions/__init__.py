"""Collision metrics: box overlap, centre distance, path collisions, time to collision."""
