"""What both stages are fed: scenes as tensors, trajectories as latents."""
