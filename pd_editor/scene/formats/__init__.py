"""Formats of scenes: each reads files, writes scenes, or both; Argoverse 2 is one of them."""
