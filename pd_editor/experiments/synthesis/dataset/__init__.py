"""Synthetic datasets: simulation of many networks, and writing of their clips."""
