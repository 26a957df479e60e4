"""Agents: choose, place, drag and edit them."""
