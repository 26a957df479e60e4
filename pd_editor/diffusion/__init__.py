"""The two-stage diffusion model; torch only here and in training."""
