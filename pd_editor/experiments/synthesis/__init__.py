"""Synthetic traffic in Argoverse 2 form, simulated with SUMO."""
