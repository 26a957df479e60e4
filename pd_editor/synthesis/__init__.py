"""Synthetic traffic in Argoverse 2 form, made with SUMO."""
