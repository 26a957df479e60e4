"""Synthetic datasets: many networks simulated, cut into windows, and written."""
