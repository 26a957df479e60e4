"""Steering by hand: guidance terms drawn on the road, and the list of them."""
