"""Windows of traffic: what a model is trained on, and what it sees of a scene."""
