"""Conversion of SUMO net files to Argoverse 2 maps."""
