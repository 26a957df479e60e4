"""Traffic scenes as immutable values.

All coordinates are in the *scene frame*: metres, x east, y north, origin at
``Scenario.origin_city_m`` of the Argoverse 2 city frame; angles in radians,
counter-clockwise from +x, in (-pi, pi].
"""
