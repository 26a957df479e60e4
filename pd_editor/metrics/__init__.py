"""Judging a scenario."""
