"""Roles of agents in a scenario: focal, entering late, replaceable."""
