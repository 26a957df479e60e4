"""SUMO networks with floating-car data, made by hand, by SUMO and real."""

import gzip
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
import sumolib

from pd_editor.base.errors import FormatError
from pd_editor.editor.scenario_store import (
    foreign_scenes,
    open_scenario,
    scenario_and_recipe,
)
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.bundle import zip_folders
from pd_editor.scene.formats.packed_file import closed_folder
from pd_editor.scene.formats.registry import format_of, read_scene
from pd_editor.scene.road_map import LaneKind
from pd_editor.scene.scenario import Scenario
from tests.scene.formats.test_sumo_net import NET

FCD = """<fcd-export>
{steps}
</fcd-export>"""
ROUTES = """<routes>
  <vTypeDistribution id="all"><vType id="van" vClass="delivery" length="6" width="2.1"/>
  </vTypeDistribution>
  <vType id="coach7" vClass="coach"/>
</routes>"""


def states(step_s: float, count: int) -> str:
    """A van that turns around the origin to the left at 5 m/s, and two that stand."""
    found = []
    for n in range(count):
        t = n * step_s
        turn = 5 * t / 50
        x, y = 50 + 50 * np.sin(turn), 50 - 50 * np.cos(turn)
        # The front is 3 m ahead of the middle.
        x, y = x + 3 * np.cos(turn), y + 3 * np.sin(turn)
        found.append(
            f'<timestep time="{t:.2f}">'
            f'<vehicle id="van.0" x="{x:.6f}" y="{y:.6f}" angle="{90 - np.rad2deg(turn):.6f}"'
            ' type="van" speed="5.00" pos="1" lane="in_1" slope="0"/>'
            '<vehicle id="bus.0" x="20" y="0" angle="90" type="coach7" speed="0"/>'
            '<person id="p" x="30" y="-4" angle="0" speed="0" edge="in" type="DEFAULT_PEDTYPE"/>'
            "</timestep>"
        )
    return FCD.format(steps="\n".join(found))


def written(folder: Path, step_s: float = 0.1, count: int = 60) -> Path:
    path = folder / "town.net.xml"
    path.write_text(NET)
    (folder / "town.fcd.xml.gz").write_bytes(
        gzip.compress(states(step_s, count).encode())
    )
    (folder / "town.rou.xml").write_text(ROUTES)
    return path


def test_a_configuration_opens_what_it_names(tmp_path: Path):
    """It was refused, with the advice to give its files other names."""
    path = written(tmp_path)
    for old, new in (("fcd.xml.gz", "moves.xml.gz"), ("rou.xml", "kinds.xml")):
        (tmp_path / f"town.{old}").rename(tmp_path / new)
    path = path.rename(tmp_path / "road.net.xml")
    config = tmp_path / "run.sumocfg"
    config.write_text("""<sumoConfiguration><input><net-file value="road.net.xml"/>
    <route-files value="lost.xml, kinds.xml"/></input><output><fcd-output
    value="moves.xml.gz"/></output></sumoConfiguration>""")
    assert foreign_scenes(tmp_path) == [path], "a folder has its networks"
    scene = open_scenario(config)
    assert scene.scenario_id == "run"
    assert sorted(scene.agents.ids) == ["bus.0", "p", "van.0"]
    assert scene.agents.size_m[scene.agents.row_of["van.0"]].tolist() == [6.0, 2.1]
    strange = tmp_path / "upload" / "run.sumocfg"
    strange.parent.mkdir()
    strange.write_text(config.read_text().replace("road.net", "../road.net"))
    open_scenario(strange)
    refusal = r"run\.sumocfg, line 1: .* no net-file that"
    with closed_folder(), pytest.raises(FormatError, match=refusal):
        read_scene(strange)
    path.unlink()
    with pytest.raises(FormatError, match=refusal):
        open_scenario(config)


def test_a_configuration_opens_in_a_zip(tmp_path: Path):
    """Of zips, only the network was opened."""
    path = written(tmp_path)
    inside = {
        "run.sumocfg": b"""<configuration><net-file value="a/town.net.xml"/>
        <fcd-output value="moves.xml"/></configuration>""",
        "moves.xml": states(0.1, 60).encode(),
        "town.net.xml": path.read_bytes(),
    }
    scene, _ = scenario_and_recipe({"city.zip": zip_folders({"city": inside})})
    assert sorted(scene.agents.ids) == ["bus.0", "p", "van.0"]


def test_times_may_be_told_in_hours_and_minutes(tmp_path: Path):
    """They were refused."""
    path = written(tmp_path, step_s=1.0, count=60)
    told = re.sub(
        r'time="(\d+)\.00"',
        lambda found: f'time="1:23:59:{int(found[1]):02d}.00"',
        states(1.0, 60),
    )
    (tmp_path / "town.fcd.xml.gz").write_bytes(gzip.compress(told.encode()))
    scene = open_scenario(path)
    assert scene.agents.is_valid[scene.agents.row_of["van.0"]].sum() == 591


def test_lanes_of_networks_without_connections_lead_on(tmp_path: Path):
    path = tmp_path / "bare.net.xml"
    path.write_text(re.sub("<connection [^>]*>", "", NET))
    scene = open_scenario(path)
    assert any(one.successors for one in scene.road_map.lanes)


def test_lanes_through_junctions_are_links(tmp_path: Path):
    path = tmp_path / "hand.net.xml.gz"
    path.write_bytes(gzip.compress(NET.encode()))
    scene = open_scenario(path)
    assert scene.scenario_id == "hand"
    assert [(one.kind, one.successors) for one in scene.road_map.lanes] == [
        (LaneKind.VEHICLE, (3,)),
        (LaneKind.VEHICLE, (1,)),
        (LaneKind.BUS, ()),
    ]
    assert foreign_scenes(tmp_path) == [path]


def test_a_network_is_known_by_its_root_where_its_name_says_nothing(tmp_path: Path):
    path = tmp_path / "map.xml"
    # As netconvert begins what it makes of OpenStreetMap.
    path.write_text(f'<!-- made of\n<osm-files value="town.osm"/> -->{NET}')
    kind = format_of(path)
    assert kind is not None
    assert kind.name == "sumo"


def test_lanes_that_meet_across_a_junction_without_lanes_get_a_curve(tmp_path: Path):
    path = tmp_path / "gap.net.xml"
    path.write_text(
        NET.replace(' via=":b_0_0"', "")
        .replace(
            '<connection from=":b_0" to="out" fromLane="0" toLane="0" dir="s" state="M"/>',
            "",
        )
        .replace("100.5,0 200,0", "108,8 108,90")
    )
    lanes = open_scenario(path).road_map.lane_of
    (turn,) = (one for one in lanes.values() if len(one.centerline_m) == 9)
    (before,) = turn.predecessors
    (after,) = turn.successors
    assert lanes[before].successors == (turn.lane_id,)
    line = turn.centerline_m
    np.testing.assert_allclose(line[0], lanes[before].centerline_m[-1])
    np.testing.assert_allclose(line[-1], lanes[after].centerline_m[0])
    steps = np.diff(line, axis=0)
    assert (steps > -1e-9).all(), "it turns to the left, and never back"
    assert abs(steps[0, 1]) < 0.3 * steps[0, 0]
    assert abs(steps[-1, 0]) < 0.3 * steps[-1, 1]


@pytest.mark.parametrize("is_left_hand", [False, True])
def test_neighbours_are_on_the_side_where_they_lie(tmp_path: Path, is_left_hand: bool):
    second = NET.replace('allow="pedestrian"', 'allow="passenger"')
    if is_left_hand:
        second = second.replace("<net ", '<net lefthand="true" ')
        second = second.replace('"0,-4 99.5,-4"', '"0,4 99.5,4"')
    path = tmp_path / "two.net.xml"
    path.write_text(second)
    kerb, inner = open_scenario(path).road_map.lanes[1:3]
    to_inner = kerb.right_neighbor if is_left_hand else kerb.left_neighbor
    assert to_inner == inner.lane_id
    beside = inner.centerline_m[0] - kerb.centerline_m[0]
    assert (beside[1] < 0) == is_left_hand


@pytest.mark.parametrize(("step_s", "count"), [(0.1, 60), (0.04, 150), (1.0, 7)])
def test_boxes_are_behind_the_front_and_follow_at_any_rate(
    tmp_path: Path, step_s: float, count: int
):
    scene = open_scenario(written(tmp_path, step_s, count))
    agents = scene.agents
    van, bus, person = (agents.row_of[name] for name in ("van.0", "bus.0", "p"))
    assert agents.kinds[bus] is AgentKind.BUS
    assert agents.kinds[person] is AgentKind.PEDESTRIAN
    np.testing.assert_allclose(agents.size_m[van], [6, 2.1])
    assert agents.has_known_size.tolist() == [True, False, False]
    place = agents.position_m + scene.origin_city_m
    there = agents.is_valid[van]
    assert there.sum() == int((count - 1) * step_s / 0.1 + 1e-6) + 1
    radius = np.hypot(*(place[van, there] - 50).T)
    np.testing.assert_allclose(radius, 50, atol=0.01)
    ahead = np.diff(place[van, there], axis=0) / 0.1
    np.testing.assert_allclose(np.hypot(*ahead.T), 5, atol=0.02)
    np.testing.assert_allclose(ahead, agents.velocity_mps[van, there][:-1], atol=0.1)
    # A coach of SUMO is 14 m long, where no file tells it; a person has no front.
    np.testing.assert_allclose(place[bus, there][0], [13, 0], atol=1e-6)
    np.testing.assert_allclose(place[person, there][0], [30, -4], atol=1e-6)


@pytest.mark.parametrize(
    "projection", ["utm +zone=32", "tmerc +lon_0=9 +k=0.9996 +x_0=500000", "merc"]
)
def test_degrees_become_the_metres_of_the_net(tmp_path: Path, projection: str):
    """As ``--fcd-output.geo`` writes them; its place is on the middle meridian."""
    path = written(tmp_path)
    location = (
        '<location netOffset="-500000,-5316300.2244" convBoundary="0,0,200,10" '
        f'origBoundary="9,48,9.003,48.001" projParameter="+proj={projection} +units=m"/>'
    )
    path.write_text(NET.replace('<net version="1.20">', f"<net>{location}"))
    (tmp_path / "town.fcd.xml.gz").unlink()
    steps = "".join(
        f'<timestep time="{n}"><vehicle id="a" x="9" y="48" angle="90" speed="0"/></timestep>'
        for n in range(3)
    )
    (tmp_path / "town.fcd.xml").write_text(FCD.format(steps=steps))
    if projection == "merc":
        with pytest.raises(FormatError, match="of a projection other than transverse"):
            open_scenario(path)
        return
    scene = open_scenario(path)
    place = scene.agents.position_m[0, scene.current_step] + scene.origin_city_m
    np.testing.assert_allclose(place, [-2.5, 0], atol=0.02)


@pytest.mark.parametrize(
    ("part", "content", "told"),
    [
        ("fcd.xml.gz", states(0.1, 60), "Start tag expected|no valid gzip"),
        ("fcd.xml", "<fcd-export>", "is no valid XML"),
        (
            "fcd.xml",
            states(0.1, 3).replace(' x="30"', ""),
            r"town\.fcd\.xml, line 2: <person> p has no attribute 'x'",
        ),
        ("fcd.xml", states(0.1, 3).replace('x="20"', 'x="nan"'), "bus.0 needs a finite"),
        ("fcd.xml", states(-0.1, 3), "times that do not increase"),
        ("fcd.xml", states(30.0, 10), "lasts 270 s; at most 100 s"),
        ("rou.xml", ROUTES.replace('"6"', '"long"'), "van needs a finite number"),
        ("rou.xml", ROUTES.replace('"6"', '"-6"'), "size outside"),
    ],
)  # fmt: skip
def test_damaged_recordings_are_refused_in_one_sentence(
    tmp_path: Path, part: str, content: str, told: str
):
    path = written(tmp_path)
    if part == "fcd.xml":
        (tmp_path / "town.fcd.xml.gz").unlink()
    if part == "fcd.xml.gz":
        content = gzip.compress(content.encode())[:-20].decode("latin1")
    (tmp_path / f"town.{part}").write_bytes(content.encode("latin1"))
    with pytest.raises(FormatError, match=told):
        open_scenario(path)


def test_a_file_that_unpacks_to_more_than_is_read_is_refused(tmp_path: Path):
    path = tmp_path / "bomb.net.xml.gz"
    path.write_bytes(gzip.compress(bytes(257 * 2**20), 9))
    with pytest.raises(FormatError, match="larger than 256 MiB when unpacked"):
        open_scenario(path)


def graph_by_sumolib(path: Path) -> dict[str, set[str]]:
    """Lanes that follow each lane, for those on which somebody drives."""
    net = sumolib.net.readNet(str(path), withInternal=True)
    drives = {
        lane.getID(): any(map(lane.allows, ("passenger", "bus", "bicycle", "truck")))
        for edge in net.getEdges()
        for lane in edge.getLanes()
    }
    return {
        lane.getID(): {
            one.getViaLaneID() or one.getToLane().getID() for one in lane.getOutgoing()
        }
        for edge in net.getEdges()
        for lane in edge.getLanes()
        if drives[lane.getID()]
    }


@pytest.mark.parametrize("name", ["2lane_circle", "lankershim"])
def test_real_networks_are_as_sumolib_has_them(format_files: Path, name: str):
    path = format_files / "sumo_net" / f"{name}.net.xml"
    scene: Scenario = open_scenario(path)
    graph = graph_by_sumolib(path)
    lanes = scene.road_map.lanes
    assert len(lanes) == len(graph)
    names = dict(zip([one.lane_id for one in lanes], graph, strict=True))
    net = sumolib.net.readNet(str(path), withInternal=True)
    for lane in lanes:
        assert {names[one] for one in lane.successors} == graph[names[lane.lane_id]]
        np.testing.assert_allclose(
            lane.centerline_m + scene.origin_city_m,
            net.getLane(names[lane.lane_id]).getShape(),
            atol=1e-6,
        )


def test_what_sumo_drives_is_where_sumo_has_it(tmp_path: Path, format_files: Path):
    """Centres in the file that SUMO writes lie on lanes; half a length behind fronts."""
    from pd_editor.experiments.synthesis.sumo.sumo_tools import sumo_tool

    net = format_files / "sumo_net" / "2lane_circle.net.xml"
    path = tmp_path / "town.net.xml"
    path.write_bytes(net.read_bytes())
    edge = next(
        one.getID()
        for one in sumolib.net.readNet(str(path)).getEdges()
        if one.allows("passenger") and one.getOutgoing()
    )
    (tmp_path / "town.rou.xml").write_text(
        f'<routes><vType id="car" length="4" width="2"/><flow id="f" type="car" begin="0" '
        f'end="20" period="4" from="{edge}" to="{edge}" departLane="random"/></routes>'
    )
    subprocess.run(
        [
            str(sumo_tool("sumo")), "-n", str(path), "-r", str(tmp_path / "town.rou.xml"),
            "--fcd-output", str(tmp_path / "town.fcd.xml"), "--step-length", "0.1",
            "--end", "20", "--no-step-log",
        ],
        check=True, capture_output=True, timeout=60,
    )  # fmt: skip
    scene = open_scenario(path)
    assert len(scene.agents) >= 3
    np.testing.assert_allclose(scene.agents.size_m, [[4, 2]] * len(scene.agents))


SIGNAL = """<tlLogic id="b" type="{kind}" programID="0" offset="2">
<phase duration="4" state="r"/><phase duration="3" state="G"/></tlLogic><connection"""


def with_signal(folder: Path, kind: str = "static", link: int = 0) -> Path:
    path = folder / "signal.net.xml"
    net = NET.replace("<connection", SIGNAL.format(kind=kind), 1)
    tied = f'via=":b_0_0" tl="b" linkIndex="{link}"'
    path.write_text(net.replace('via=":b_0_0"', tied))
    return path


def test_signals_stop_before_the_junction_and_have_their_programme(tmp_path: Path):
    scene = open_scenario(with_signal(tmp_path))
    (signal,) = scene.signals
    place = scene.stop_lines_m()[0, 1] + scene.origin_city_m
    np.testing.assert_allclose(place, [99.5, 0.0], atol=1e-6)
    # SUMO's time 0 is the current step; the cycle begins at 2 s.
    times = (np.arange(scene.time_axis.num_steps) - scene.current_step) // 10
    expected = np.where((times - 2) % 7 < 4, 1, 3)
    np.testing.assert_array_equal(signal.states, expected)


def test_signals_stop_before_lanes_that_a_junction_lacks(tmp_path: Path):
    """They were one for each lane before it, and the others were left out."""
    path = with_signal(tmp_path)
    net = re.sub('<connection from=":[^>]*>', "", path.read_text())
    path.write_text(
        net.replace(' via=":b_0_0"', "").replace("100.5,0 200,0", "108,8 108,90")
    )
    scene = open_scenario(path)
    (signal,) = scene.signals
    (inside,) = signal.lane_ids
    assert len(scene.road_map.lane_of[inside].centerline_m) == 9
    assert signal.stop_share.tolist() == [0.0]


def test_signals_that_react_are_unknown_and_bad_links_refused(tmp_path: Path):
    scene = open_scenario(with_signal(tmp_path, "actuated"))
    assert not scene.signals[0].states.any()
    assert "react to traffic" in scene.provenance.notes[-1]
    with pytest.raises(FormatError, match="has link 1, which a phase of 'b' has not"):
        open_scenario(with_signal(tmp_path, link=1))


def test_headings_and_speeds_are_those_of_the_motion_where_none_are_told(
    tmp_path: Path,
):
    """Floating-car data without an angle was refused."""
    told = open_scenario(written(tmp_path))
    data = re.sub(r' (angle|speed)="[^"]*"', "", states(0.1, 60))
    (tmp_path / "town.fcd.xml.gz").write_bytes(gzip.compress(data.encode()))
    scene = open_scenario(tmp_path / "town.net.xml")
    row, its_row = scene.agents.row_of["van.0"], told.agents.row_of["van.0"]
    there = scene.agents.is_valid[row]
    off = scene.agents.heading_rad[row] - told.agents.heading_rad[its_row]
    assert np.abs(np.rad2deg(off[there])).max() < 4.0  # The front leads the middle.
    slip = scene.agents.speed_mps()[row] - told.agents.speed_mps()[its_row]
    assert np.abs(slip[there]).max() < 0.1
    assert "Headings that the file does not tell" in " ".join(scene.provenance.notes)
