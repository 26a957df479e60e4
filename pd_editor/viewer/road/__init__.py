"""The road: its warp and where it bends."""
