"""Comparison of synthetic scenes with recorded ones."""
