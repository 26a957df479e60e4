"""The only door to Argoverse 2 files."""
