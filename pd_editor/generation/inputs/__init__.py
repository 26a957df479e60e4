"""Inputs of both stages: scenes as tensors, trajectories as latents."""
