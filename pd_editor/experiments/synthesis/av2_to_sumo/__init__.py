"""Conversion of Argoverse 2 maps to SUMO net files."""
