"""Post-processing of scenes: snap to lanes, separate overlaps, limit speeds, smooth motion, yield."""
