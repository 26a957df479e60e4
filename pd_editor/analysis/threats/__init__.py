"""Threats between two agents: how they are planned, and what came of them."""
