"""Distances of distributions, and the noise floor of recordings against recordings."""
