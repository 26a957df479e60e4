"""Lanes as a graph: links, routes, the nearest lane of a point."""
