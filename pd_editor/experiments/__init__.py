"""Trainings, evaluations, studies and simulated traffic, on one or many machines."""
