"""Geometry and colours of what is drawn: pure functions from arrays to meshes."""
