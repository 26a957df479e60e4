"""Perturbation studies on many scenes."""
