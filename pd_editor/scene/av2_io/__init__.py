"""Reading, writing and browsing Argoverse 2 files; no other package touches them."""
