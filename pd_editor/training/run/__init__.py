"""A training run: its settings, folder, state, curves and model card."""
