"""Collisions: boxes that overlap, centres too near, paths that would meet, time to collision."""
