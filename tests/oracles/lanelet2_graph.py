"""Lanelets that vehicles may drive on, by Lanelet2; runs in an environment of its own.

Reads JSON from standard input: the path of a map in degrees. Writes, for each lanelet and
direction (``7``, and ``7-`` against it), its centre line in metres of UTM, the lanelets
that follow it, and those beside it in the same direction.
"""

import json
import sys
import xml.etree.ElementTree as ElementTree

import lanelet2
from lanelet2.projection import UtmProjector
from lanelet2.traffic_rules import Locations, Participants


def graph_of(path: str) -> dict[str, dict]:
    """The answer."""
    node = ElementTree.parse(path).getroot().find("node").attrib
    origin = lanelet2.io.Origin(float(node["lat"]), float(node["lon"]), 0.0)
    found, errors = lanelet2.io.loadRobust(path, UtmProjector(origin, False, False))
    assert not errors, list(errors)
    answer = {}
    for participant in (Participants.Vehicle, Participants.Bicycle):
        rules = lanelet2.traffic_rules.create(Locations.Germany, participant)
        graph = lanelet2.routing.RoutingGraph(found, rules)
        for one in found.laneletLayer:
            is_walk = one.attributes["subtype"] == "shared_walkway"
            if name_of(one) in answer or is_walk or not rules.canPass(one):
                continue
            ways = [one] if rules.isOneWay(one) else [one, one.invert()]
            for lanelet in ways:
                beside = [
                    graph.left(lanelet) or graph.adjacentLeft(lanelet),
                    graph.right(lanelet) or graph.adjacentRight(lanelet),
                ]
                answer[name_of(lanelet)] = {
                    "center": [[point.x, point.y] for point in lanelet.centerline],
                    "after": [name_of(n) for n in graph.following(lanelet)],
                    "left": beside[0] and name_of(beside[0]),
                    "right": beside[1] and name_of(beside[1]),
                }
    return answer


def name_of(lanelet) -> str:
    """Id, with a dash against the direction of the file."""
    return f"{lanelet.id}{'-' if lanelet.inverted() else ''}"


if __name__ == "__main__":
    json.dump(graph_of(json.load(sys.stdin)), sys.stdout)
