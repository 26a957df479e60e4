"""The training loop: steps, checkpoints, weight average, losses."""
