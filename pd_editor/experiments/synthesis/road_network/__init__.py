"""Procedural road networks: streets, junctions and footways for SUMO."""
