"""Perturbation studies: methods on many scenes, warps, powers and seeds."""
