"""Agents and the road: lane deviation, off-lane and off-road, what surrounds an agent."""
