"""From a SUMO net file to an Argoverse 2 map."""
