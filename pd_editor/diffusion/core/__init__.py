"""Diffusion itself: noise, sampling, attention; knows neither stage."""
