"""Training of both stages of the model."""
