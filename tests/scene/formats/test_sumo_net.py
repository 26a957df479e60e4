from pathlib import Path

import numpy as np
import pytest

from pd_editor.base.errors import FormatError
from pd_editor.experiments.synthesis.traffic.demand import read_traffic_graph
from pd_editor.scene.formats.sumo_net import read_sumo_net
from pd_editor.scene.road_map import LaneKind

NET = """<net version="1.20">
    <edge id=":b_0" function="internal">
        <lane id=":b_0_0" index="0" speed="9" length="1" shape="99.5,0 100.5,0"/>
    </edge>
    <edge id="in" from="a" to="b" priority="1">
        <lane id="in_0" index="0" allow="pedestrian" speed="2" length="99.5"
            width="2.00" shape="0,-4 99.5,-4"/>
        <lane id="in_1" index="1" disallow="pedestrian" speed="13" length="99.5"
            shape="0,0 50.25,0.125 99.5,0"/>
    </edge>
    <edge id="out" from="b" to="c" priority="1">
        <lane id="out_0" index="0" allow="bus" speed="13" length="99" shape="100.5,0 200,0"/>
    </edge>
    <junction id="a" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,0 0,3"/>
    <junction id="b" type="priority" x="100" y="0" incLanes="in_1" intLanes=":b_0_0"
        shape="99.5,2 100.5,2 100.5,-2 99.5,-2"/>
    <junction id="c" type="dead_end" x="200" y="0" incLanes="out_0" intLanes=""/>
    <connection from="in" to="out" fromLane="1" toLane="0" via=":b_0_0" dir="s" state="M"/>
    <connection from=":b_0" to="out" fromLane="0" toLane="0" dir="s" state="M"/>
</net>
"""


def test_a_net_by_hand(tmp_path: Path):
    file = tmp_path / "hand.net.xml"
    file.write_text(NET)
    net = read_sumo_net(file)
    assert list(net.lanes) == [":b_0_0", "in_0", "in_1", "out_0"]
    car, walk = net.lanes["in_1"], net.lanes["in_0"]
    np.testing.assert_array_equal(car.shape_m, [[0, 0], [50.25, 0.125], [99.5, 0]])
    assert (car.kind, car.width_m, walk.width_m) == (LaneKind.VEHICLE, 3.2, 2.0)
    assert (walk.kind, net.lanes["out_0"].kind) == (None, LaneKind.BUS)
    assert net.lanes[":b_0_0"].is_internal
    assert not any(lane.is_parking for lane in net.lanes.values())
    assert net.links == (("in_1", ":b_0_0"), (":b_0_0", "out_0"))
    assert net.junction_of == {"in": ("a", "b"), "out": ("b", "c")}
    assert net.num_legs == {"a": 1, "b": 2, "c": 1}
    assert not net.has_signals
    graph = read_traffic_graph(file)
    assert list(graph.edges) == ["in", "out"]
    assert [edge.edge_id for edge in graph.sidewalk_edges] == ["in"]
    assert graph.turns_for("bus") == {"in": {"out": "s"}, "out": {}}
    assert graph.turns_for("passenger") == {"in": {}}


def test_junctions_of_footways_are_not_paved(tmp_path: Path):
    """Maps made of OpenStreetMap had spots of road in parks."""
    path = """<edge id="path" from="p" to="q"><lane id="path_0" index="0" allow="pedestrian"
    speed="2" length="9" shape="0,50 9,50"/></edge><junction id="p" shape="0,49 0,51 1,50"/>
    """
    file = tmp_path / "hand.net.xml"
    file.write_text(NET.replace("</net>", f"{path}</net>"))
    (junction,) = read_sumo_net(file).paved_beside_lanes()
    assert junction.bounds == (99.5, -2.0, 100.5, 2.0)


def test_lanes_of_a_junction_that_lead_in_a_circle_are_read(tmp_path: Path):
    file = tmp_path / "circle.net.xml"
    again = '<connection from=":b_0" to="in" via=":b_0_0"'
    file.write_text(NET.replace('<connection from=":b_0" to="out"', again))
    assert read_sumo_net(file).crossed_junctions == set()


@pytest.mark.parametrize("read", [read_sumo_net, read_traffic_graph])
@pytest.mark.parametrize(
    "text",
    [
        None,
        "",
        "<net>",
        "<net/>",
        "words",
        "<net><edge/></net>",
        NET.replace('length="1"', ""),
        NET.replace('speed="9"', 'speed="fast"'),
        NET.replace("0,-4 99.5,-4", "0 99.5"),
        NET.replace('id="in_1"', 'id="in_0"'),
        NET.replace('from="a"', ""),
        NET.replace("99.5,0", "1e300,0"),
        NET.replace('to="out" fromLane="1"', 'to="nowhere" fromLane="1"'),
        NET.replace(':b_0"', 'b_0"'),
    ],
)
def test_what_is_no_net_is_refused_in_one_sentence(tmp_path: Path, read, text):
    file = tmp_path / "bad.net.xml"
    if text is not None:
        file.write_text(text)
    with pytest.raises(FormatError, match=r"bad\.net\.xml"):
        read(file)
