"""Weights of model folders in format version 1, converted when they are read."""
