"""Edited scenarios that were collected, to be written together."""
