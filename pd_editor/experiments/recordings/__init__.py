"""Recordings of simulated traffic, the clips taken from them, and their files."""
