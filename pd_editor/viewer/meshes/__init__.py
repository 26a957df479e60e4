"""Geometry and colours of the picture: pure functions from arrays to meshes."""
