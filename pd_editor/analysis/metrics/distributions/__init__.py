"""Distances between distributions, and their noise floor between recordings."""
