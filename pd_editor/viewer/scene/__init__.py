"""The scene in the picture: what is drawn, from where, and at which time."""
