"""From an Argoverse 2 map to a SUMO net file."""
