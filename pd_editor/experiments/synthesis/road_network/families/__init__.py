"""Families of procedural networks, one module each."""
