"""Plane geometry on plain arrays; knows nothing of traffic."""
