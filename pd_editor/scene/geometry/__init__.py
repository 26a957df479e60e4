"""Plane geometry on NumPy arrays, independent of traffic."""
