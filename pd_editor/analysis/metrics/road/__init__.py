"""Metrics of agents relative to the road: lane deviation, off-lane, off-road."""
