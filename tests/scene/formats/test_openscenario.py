"""Agents of OpenSCENARIO files on OpenDRIVE roads."""

import re
import zipfile
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from pd_editor.base.errors import FormatError
from pd_editor.editor.scenario_store import (
    foreign_scenes,
    open_scenario,
    scenario_and_recipe,
)
from pd_editor.scene.agent_kind import ROAD_USER_KINDS, AgentKind
from pd_editor.scene.formats.dataset import DatasetIndex
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import states_at
from tests.scene.formats.test_opendrive_writer import with_signals, written

ROAD = """<OpenDRIVE><header revMajor="1" revMinor="4"/>
<road id="7" length="100" junction="-1">
<planView><geometry s="0" x="10" y="0" hdg="0" length="100"><line/></geometry></planView>
<lanes><laneSection s="0"><left><lane id="1" type="driving"><width sOffset="0" a="4" b="0"
c="0" d="0"/></lane></left><right><lane id="-1" type="driving"><width sOffset="0" a="4"
b="0" c="0" d="0"/></lane></right></laneSection></lanes></road></OpenDRIVE>"""
BOX = """<BoundingBox><Center x="1.5" y="0" z="1"/><Dimensions length="4" width="2"
height="1.5"/></BoundingBox>"""


def entity(name: str, category: str = "car", box: str = BOX) -> str:
    vehicle = f'<Vehicle name="v" vehicleCategory="{category}">{box}</Vehicle>'
    return f'<ScenarioObject name="{name}">{vehicle}</ScenarioObject>'


def lane(lane_id: int, s: float, more: str = "") -> str:
    place = f'<LanePosition roadId="7" laneId="{lane_id}" s="{s}" offset="0.5">'
    return f"<Position>{place}{more}</LanePosition></Position>"


def private(name: str, position: str, more: str = "") -> str:
    move = f"<PrivateAction><TeleportAction>{position}</TeleportAction></PrivateAction>"
    return f'<Private entityRef="{name}">{move}{more}</Private>'


def speed(value: float) -> str:
    target = f'<SpeedActionTarget><AbsoluteTargetSpeed value="{value}"/>'
    action = f"<SpeedAction>{target}</SpeedActionTarget></SpeedAction>"
    return f"<PrivateAction><LongitudinalAction>{action}</LongitudinalAction></PrivateAction>"


def event(name: str, action: str, at_s: float) -> str:
    """A group with one event of an entity."""
    time = f'<SimulationTimeCondition value="{at_s}" rule="greaterThan"/>'
    trigger = (
        f'<Condition delay="0"><ByValueCondition>{time}</ByValueCondition></Condition>'
    )
    return f"""<ManeuverGroup><Actors><EntityRef entityRef="{name}"/></Actors><Maneuver>
    <Event><Action><PrivateAction>{action}</PrivateAction></Action><StartTrigger>
    <ConditionGroup>{trigger}</ConditionGroup></StartTrigger></Event></Maneuver>
    </ManeuverGroup>"""


def trajectory(*vertices: tuple[float, float, float]) -> str:
    points = "".join(
        f'<Vertex time="{t}"><Position><WorldPosition x="{x}" y="{y}"/></Position></Vertex>'
        for t, x, y in vertices
    )
    return f"""<RoutingAction><FollowTrajectoryAction><TrajectoryRef><Trajectory><Shape>
    <Polyline>{points}</Polyline></Shape></Trajectory></TrajectoryRef><TimeReference>
    <Timing domainAbsoluteRelative="relative" scale="1" offset="0"/></TimeReference>
    </FollowTrajectoryAction></RoutingAction>"""


def story(folder: Path, entities: str, init: str, groups: str = "") -> Path:
    """A file whose roads lie in a folder of their own."""
    (folder / "roads").mkdir()
    (folder / "roads" / "street.xodr").write_text(ROAD)
    path = folder / "play.xosc"
    path.write_text(
        f"""<OpenSCENARIO><FileHeader revMajor="1" revMinor="1"/><ParameterDeclarations>
        <ParameterDeclaration name="far" value="60"/></ParameterDeclarations>
        <RoadNetwork><LogicFile filepath="roads/street.xodr"/></RoadNetwork>
        <Entities>{entities}</Entities><Storyboard><Init><Actions>{init}</Actions></Init>
        <Story><Act>{groups}</Act></Story></Storyboard></OpenSCENARIO>"""
    )
    return path


def at(scene: Scenario, name: str, step: int) -> np.ndarray:
    row = scene.agents.row_of[name]
    assert scene.agents.is_valid[row, step]
    return scene.agents.position_m[row, step] + scene.origin_city_m


def check_same(scenario: Scenario, back: Scenario) -> None:
    one, two = scenario.agents, back.agents
    rows = two.rows(one.ids)
    assert back.current_step == scenario.current_step
    np.testing.assert_array_equal(two.is_valid[rows], one.is_valid)
    gap = two.position_m[rows] + back.origin_city_m
    gap = (gap - one.position_m - scenario.origin_city_m)[one.is_valid]
    assert np.abs(gap).max() <= 1e-3
    turn = (two.heading_rad[rows] - one.heading_rad)[one.is_valid]
    assert np.abs(np.angle(np.exp(1j * turn))).max() <= np.radians(0.1)
    np.testing.assert_allclose(two.size_m[rows], one.size_m, atol=1e-6)
    users = [n for n, kind in enumerate(one.kinds) if kind in ROAD_USER_KINDS]
    assert [two.kinds[rows[n]] for n in users] == [one.kinds[n] for n in users]


def test_the_agents_and_signals_of_an_export_come_back(tmp_path: Path):
    """Our own files came back without them."""
    scenario = with_signals(open_scenario("crosswalk"))
    path = written(scenario, tmp_path)
    for one in (path.with_suffix(".xosc"), tmp_path):
        back = open_scenario(one)
        check_same(scenario, back)
        for step in (0, 20, 60, 109):
            theirs = sorted(states_at(back.signals, step).values())
            assert theirs == sorted(states_at(scenario.signals, step).values())
        assert [one.signal_id for one in back.signals] == ['"a" <b>', "c"]


@pytest.mark.real_data
def test_real_scenes_come_back(av2_scenario_folders: list[Path], tmp_path: Path):
    scenario = open_scenario(av2_scenario_folders[3])
    check_same(scenario, open_scenario(written(scenario, tmp_path)))


def test_roads_and_the_traffic_on_them_are_one_scene(tmp_path: Path):
    """In a folder, a zip and a data set."""
    folder = tmp_path / "scene"
    folder.mkdir()
    path = written(open_scenario("queue"), folder)
    index = DatasetIndex(tmp_path)
    assert index.scan() == 1
    assert foreign_scenes(tmp_path) == [path]
    with zipfile.ZipFile(tmp_path / "scene.zip", "w") as file:
        for one in folder.iterdir():
            file.write(one, one.name)
    scene, _ = scenario_and_recipe({"a.zip": (tmp_path / "scene.zip").read_bytes()})
    assert len(scene.agents) == len(open_scenario("queue").agents)


def test_entities_are_on_their_lanes_with_their_boxes(tmp_path: Path):
    """The file tells a point of reference, here 1.5 m behind the middle."""
    absolute = '<Orientation type="absolute" h="1.5707963"/>'
    init = private("hero", lane(-1, 20), speed(8.0)) + private("other", lane(1, 20))
    init += private("across", lane(-1, "$far", absolute))
    names = entity("hero"), entity("other", "bus"), entity("across", "bicycle", "")
    scene = open_scenario(story(tmp_path, "".join(names), init))
    now = scene.current_step
    np.testing.assert_allclose(at(scene, "AV", now), (31.5, -1.5), atol=1e-6)
    np.testing.assert_allclose(at(scene, "other", now), (28.5, 2.5), atol=1e-6)
    np.testing.assert_allclose(at(scene, "across", now), (70.0, -1.5), atol=1e-6)
    agents = scene.agents
    rows = agents.rows(("AV", "other", "across"))
    np.testing.assert_allclose(
        agents.velocity_mps[rows, now], [(8, 0), (0, 0), (0, 0)], atol=1e-9
    )
    turns = np.exp(1j * agents.heading_rad[rows, now])
    np.testing.assert_allclose(turns, [1, -1, 1j], atol=1e-6)
    kinds = [agents.kinds[row] for row in rows]
    assert kinds == [AgentKind.VEHICLE, AgentKind.BUS, AgentKind.CYCLIST]
    assert "1 entities without a box" in " ".join(scene.provenance.notes)


def test_trajectories_begin_with_their_events_and_parked_cars_stay(tmp_path: Path):
    """Vertices may be seconds apart."""
    init = private("ego", lane(-1, 20)) + private("parked", lane(1, 90))
    way = trajectory((0, 30, -2), (4, 50, -2), (8, 90, -2))
    path = story(
        tmp_path, entity("ego") + entity("parked"), init, event("ego", way, 1.0)
    )
    scene = open_scenario(path)
    agents, origin_s = scene.agents, scene.time_axis.times_s()[0]
    assert origin_s < 0
    row = agents.row_of["AV"]
    steps = np.flatnonzero(agents.is_valid[row])
    assert steps[-1] - steps[0] in (80, 90)
    np.testing.assert_allclose(at(scene, "AV", steps[-1]), (91.5, -2), atol=1e-6)
    np.testing.assert_allclose(at(scene, "AV", steps[-1] - 60), (41.5, -2), atol=1e-6)
    assert agents.is_valid[agents.row_of["parked"], steps].all()


def test_entities_keep_lane_and_speed_until_their_trajectories_begin(tmp_path: Path):
    """They were gone in between, and trajectories that begin where they are unread."""
    place = '<RelativeObjectPosition entityRef="ego" dx="0" dy="0"/>'
    curve = f"""<RoutingAction><FollowTrajectoryAction><Trajectory><Shape><Clothoid
    curvature="0.1" curvatureDot="0" length="10"><Position>{place}</Position></Clothoid>
    </Shape></Trajectory><TimeReference><None/></TimeReference></FollowTrajectoryAction>
    </RoutingAction>"""
    box = BOX.replace('x="1.5"', 'x="0"')
    init = private("ego", lane(1, 70), speed(5.0))
    path = story(tmp_path, entity("ego", "car", box), init, event("ego", curve, 2.0))
    scene = open_scenario(path)
    row = scene.agents.row_of["AV"]
    steps = np.flatnonzero(scene.agents.is_valid[row])
    np.testing.assert_array_equal(steps, steps[0] + np.arange(41))
    np.testing.assert_allclose(at(scene, "AV", steps[10]), (75.0, 2.5), atol=1e-6)
    np.testing.assert_allclose(at(scene, "AV", steps[20]), (70.0, 2.5), atol=1e-6)
    end = (70 - 10 * np.sin(1.0), 2.5 - 10 * (1 - np.cos(1.0)))
    np.testing.assert_allclose(at(scene, "AV", steps[40]), end, atol=0.01)
    assert "keep lane and speed" in " ".join(scene.provenance.notes)


def test_what_is_not_read_is_told_in_one_sentence(tmp_path: Path):
    behind = '<Position><GeoPosition latitude="0" longitude="0"/></Position>'
    init = private("ego", lane(-1, 20)) + private("late", behind)
    change = "<LateralAction><LaneChangeAction/></LateralAction>"
    path = story(
        tmp_path, entity("ego") + entity("late"), init, event("ego", change, 2)
    )
    told = " ".join(open_scenario(path).provenance.notes)
    assert (
        "Not read of play.xosc: GeoPosition in an unknown projection, LaneChangeAction."
        in told
    )
    assert "Entities without a place are left out: late." in told


@pytest.mark.parametrize(
    ("position", "place", "heading"),
    [
        ('RoadPosition roadId="7" s="30" t="-1"', (40.0, -1.0), 0.0),
        ('RoadPosition roadId="7" s="100.02" t="-1"', (110.0, -1.0), 0.0),
        ('RelativeLanePosition entityRef="ego" dLane="0" ds="9"', (39.0, -2.0), 0.0),
        ('RelativeLanePosition entityRef="ego" dLane="1" ds="9"', (39.0, 2.0), np.pi),
        ('RelativeRoadPosition entityRef="ego" ds="9" dt="1"', (39.0, -0.5), 0.0),
        ('RelativeWorldPosition entityRef="ego" dx="9" dy="1"', (39.0, -0.5), 0.0),
        ('RelativeObjectPosition entityRef="back" dx="9" dy="1"', (21.0, 1.5), np.pi),
        ('LanePosition roadId="7" laneId="-1" s="${2 * $far / 4}"', (40.0, -2.0), 0.0),
    ],
)
def test_places_are_found_by_road_lane_or_another_entity(
    position: str, place: tuple[float, float], heading: float, tmp_path: Path
):
    """Such entities were left out, also of those that are placed later in the file."""
    box = BOX.replace('x="1.5"', 'x="0"')
    init = private("late", f"<Position><{position}/></Position>")
    init += private("ego", lane(-1, 20)) + private("back", lane(1, 20))
    names = "".join(entity(one, "car", box) for one in ("ego", "back", "late"))
    scene = open_scenario(story(tmp_path, names, init))
    now = scene.current_step
    np.testing.assert_allclose(at(scene, "late", now), place, atol=1e-6)
    told = scene.agents.heading_rad[scene.agents.row_of["late"], now]
    assert np.abs(np.angle(np.exp(1j * (told - heading)))) < 1e-6


def test_entities_that_are_placed_by_each_other_are_left_out(tmp_path: Path):
    """Also in a long row, of which the last alone has a place."""
    names = [f"e{n}" for n in range(400)]
    near = '<Position><RelativeWorldPosition entityRef="{}" dx="1" dy="0"/></Position>'
    init = "".join(private(one, near.format(other)) for one, other in pairwise(names))
    init += private("e399", lane(-1, 20)) + private("a", near.format("a"))
    path = story(tmp_path, "".join(map(entity, [*names, "a"])), init)
    scene = open_scenario(path)
    assert {"e399", "e398"} <= set(scene.agents.ids)
    told = " ".join(scene.provenance.notes)
    assert "RelativeWorldPosition to an entity whose place then is unknown" in told
    assert "a" not in scene.agents.ids


def test_values_are_computed_and_entities_come_from_catalogs(tmp_path: Path):
    """Cars had the usual size, and speeds that are computed ended in an error."""
    init = private("Ego", lane(-1, 20), speed(8.0).replace("8.0", "${$far / 3.6}"))
    refer = """<ScenarioObject name="Ego"><CatalogReference catalogName="Vehicles"
    entryName="$kind"><ParameterAssignments><ParameterAssignment parameterRef="$long"
    value="7.5"/></ParameterAssignments></CatalogReference></ScenarioObject>"""
    path = story(tmp_path, refer, init)
    path.write_text(
        path.read_text()
        .replace(
            'revMinor="1"/>',
            'author="A"><License name="MPL-2.0"/></FileHeader>',
        )
        .replace(
            "<RoadNetwork>",
            """<CatalogLocations><VehicleCatalog><Directory
        path="../all/cars"/></VehicleCatalog></CatalogLocations><RoadNetwork>""",
        )
        .replace(
            'value="60"/>',
            'value="60"/><ParameterDeclaration name="$kind" value="van"/>',
        )
    )
    (tmp_path / "cars").mkdir()
    (tmp_path / "cars" / "all.xosc").write_text(f"""<OpenSCENARIO><FileHeader/><Catalog
    name="Vehicles"><Vehicle name="van" vehicleCategory="tram"><ParameterDeclarations>
    <ParameterDeclaration name="long" value="6"/></ParameterDeclarations>
    {BOX.replace('length="4"', 'length="$long"')}</Vehicle></Catalog></OpenSCENARIO>""")
    scene = open_scenario(path)
    assert scene.provenance.attribution == "author: A; License: MPL-2.0"
    agents = scene.agents
    np.testing.assert_allclose(agents.size_m, [(7.5, 2.0)])
    assert agents.kinds == (AgentKind.BUS,)
    speeds = np.hypot(*agents.velocity_mps[agents.is_valid].T)
    np.testing.assert_allclose(speeds, 60 / 3.6)


SPLINE = """<Nurbs order="3">{}<Knot value="0"/><Knot value="0"/><Knot value="0"/>
<Knot value="1"/><Knot value="1"/><Knot value="1"/></Nurbs>"""


@pytest.mark.parametrize("is_event", [True, False])
@pytest.mark.parametrize(
    ("shape", "length_m", "end"),
    [
        ("<Polyline>{}</Polyline>", 24.0, (42.0, 10.5)),
        (SPLINE, 19.4769, (42.0, 10.5)),
        (
            '<Clothoid curvature="0" curvaturePrime="0.02" length="10"><Position>'
            '<WorldPosition x="30" y="-1.5" h="0"/></Position></Clothoid>',
            10.0,
            (39.0452, 1.5965),
        ),
        (
            '<ClothoidSpline><ClothoidSplineSegment curvatureStart="0.1" curvatureEnd="0.1" '
            'length="10"><PositionStart><WorldPosition x="30" y="-1.5" h="0"/>'
            "</PositionStart></ClothoidSplineSegment><ClothoidSplineSegment "
            'curvatureStart="0" curvatureEnd="0" length="2"/></ClothoidSpline>',
            12.0,
            (30 + 10 * np.sin(1) + 2 * np.cos(1), 8.5 - 10 * np.cos(1) + 2 * np.sin(1)),
        ),
    ],
)
def test_trajectories_without_times_are_followed_at_the_first_speed(
    shape: str,
    length_m: float,
    end: tuple[float, float],
    is_event: bool,
    tmp_path: Path,
):
    """They were not read, as were all but polylines."""
    corners = [(30, -1.5), (42, -1.5), (42, 10.5)]
    word = "ControlPoint" if "Nurbs" in shape else "Vertex"
    points = "".join(
        f'<{word}><Position><WorldPosition x="{x}" y="{y}"/></Position></{word}>'
        for x, y in corners
    )
    way = f"""<RoutingAction><FollowTrajectoryAction><TrajectoryRef><Trajectory><Shape>
    {shape.format(points)}</Shape></Trajectory></TrajectoryRef><TimeReference><None/>
    </TimeReference></FollowTrajectoryAction></RoutingAction>"""
    box = BOX.replace('x="1.5"', 'x="0"')
    start = f"<PrivateAction>{way}</PrivateAction>{speed(4.0)}"
    init, groups = private("Ego", lane(-1, 20), start), ""
    if is_event:
        init = private("Ego", lane(-1, 20), speed(4.0))
        groups = event("Ego", way, 0)
    path = story(tmp_path, entity("Ego", "car", box), init, groups)
    scene = open_scenario(path)
    steps = np.flatnonzero(scene.agents.is_valid[0])
    assert len(steps) - 1 == int(length_m / 0.4)
    rest = length_m - 0.4 * (len(steps) - 1)
    gap = np.hypot(*(at(scene, "AV", steps[-1]) - end))
    assert abs(gap - rest) < 0.02
    assert "followed at the entity's first speed" in " ".join(scene.provenance.notes)


@pytest.mark.parametrize("unit", ["Deg", ""])
def test_places_on_earth_are_in_the_projection_of_the_roads(tmp_path: Path, unit: str):
    """They were not read."""
    across_m = 6_378_137 / np.sqrt(1 - 0.00669438 * np.sin(np.radians(48)) ** 2)
    lon = 9 + np.degrees(20 / (across_m * np.cos(np.radians(48))))
    lat, lon = (float(one if unit else np.radians(one)) for one in (48.0, lon))
    position = f'GeoPosition latitude{unit}="{lat!r}" longitude{unit}="{lon!r}"'
    init = private("ego", f"<Position><{position}/></Position>")
    path = story(tmp_path, entity("ego", "car", BOX.replace("1.5", "0")), init)
    roads = tmp_path / "roads" / "street.xodr"
    header = """<header revMajor="1" revMinor="4"><geoReference>
    +proj=tmerc +lat_0=48 +lon_0=9 +x_0=7</geoReference></header>"""
    roads.write_text(re.sub("<header.*?/>", header, ROAD))
    scene = open_scenario(path)
    np.testing.assert_allclose(at(scene, "AV", scene.current_step), (27, 0), atol=0.01)


def test_events_begin_when_others_end(tmp_path: Path):
    """Their trajectories were not read."""
    first = event("ego", trajectory((0, 20, -2), (3, 32, -2)), 1.0)
    then = event("other", trajectory((0, 60, 2), (2, 50, 2)), 1.0)
    ends = '<StoryboardElementStateCondition storyboardElementRef="a" state="completeState"/>'
    then = re.sub("<SimulationTimeCondition.*?/>", ends, then)
    init = private("ego", lane(-1, 10)) + private("other", lane(1, 50))
    groups = first.replace("<Event>", '<Event name="a">') + then
    entities = "".join(
        entity(n, "car", BOX.replace("1.5", "0")) for n in ("ego", "other")
    )
    scene = open_scenario(story(tmp_path, entities, init, groups))
    steps = np.flatnonzero(scene.agents.is_valid[scene.agents.row_of["other"]])
    assert len(steps) == 61
    np.testing.assert_allclose(at(scene, "other", steps[50]), (55, 2), atol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('laneId="-1"', 'laneId="-4"', "<LanePosition> names no lane of the road"),
        ('s="20"', 's="200"', "<LanePosition> names no road of the network"),
        ('s="20"', 's="far"', "<LanePosition> needs a finite number for s"),
        ("street.xodr", "lost.xodr", "<LogicFile> names 'roads/lost.xodr', which is"),
        ('revMajor="1"', 'revMajor="2"', "<FileHeader> is of version 2; expected 1"),
        ("<Dimensions", "<Size", "<BoundingBox> has no <Dimensions>"),
    ],
)
def test_damaged_files_are_refused_by_element_and_line(
    old: str, new: str, expected: str, tmp_path: Path
):
    path = story(tmp_path, entity("ego"), private("ego", lane(-1, 20)))
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(FormatError, match=rf"play.xosc, line \d+: {expected}"):
        open_scenario(path)


FORK = """<OpenDRIVE><header revMajor="1" revMinor="4"/>
<road id="7" length="100" junction="-1"><link><successor elementType="junction" elementId="9"/>
</link><planView><geometry s="0" x="0" y="0" hdg="0" length="100"><line/></geometry></planView>
<lanes><laneSection s="0"><left>{1}</left><right>{-1}{-2}</right></laneSection></lanes></road>
<road id="8" length="60" junction="9"><link><predecessor elementType="road" elementId="7"
contactPoint="end"/></link><planView><geometry s="0" x="100" y="0" hdg="0" length="60"><line/>
</geometry></planView><lanes><laneSection s="0"><right>{-1}{-2}</right></laneSection></lanes>
</road><road id="6" length="60" junction="9"><link><predecessor elementType="road"
elementId="7" contactPoint="end"/></link><planView><geometry s="0" x="100" y="0" hdg="0"
length="60"><arc curvature="0.02"/></geometry></planView><lanes><laneSection s="0"><right>{-1}
</right></laneSection></lanes></road><junction id="9"><connection id="0" incomingRoad="7"
connectingRoad="8" contactPoint="start"><laneLink from="-1" to="-1"/><laneLink from="-2"
to="-2"/></connection><connection id="1" incomingRoad="7" connectingRoad="6"
contactPoint="start"><laneLink from="-1" to="-1"/></connection></junction></OpenDRIVE>"""


def drive(
    folder: Path, actions: dict[str, str], groups: str, stop_s: float = 10
) -> Scenario:
    """Cars named by their first place, ``ROAD:LANE:S:SPEED``, on a road that forks."""
    init = entities = ""
    for name, more in actions.items():
        road, lane_id, s, value = name.split(":")
        place = f'<LanePosition roadId="{road}" laneId="{lane_id}" s="{s}"/>'
        init += private(
            name, f"<Position>{place}</Position>", speed(float(value)) + more
        )
        entities += entity(name, "car", BOX.replace('x="1.5"', 'x="0"'))
    path = story(folder, entities, init, groups)
    stop = f'<SimulationTimeCondition value="{stop_s}" rule="greaterThan"/>'
    stop = f"<ConditionGroup><Condition><ByValueCondition>{stop}</ByValueCondition>"
    stop = (
        f"<StopTrigger>{stop}</Condition></ConditionGroup></StopTrigger></Storyboard>"
    )
    path.write_text(path.read_text().replace("</Storyboard>", stop))
    width = '<width sOffset="0" a="4" b="0" c="0" d="0"/>'
    lanes = {
        f"{{{n}}}": f'<lane id="{n}" type="driving">{width}</lane>' for n in (1, -1, -2)
    }
    roads = FORK
    for word, text in lanes.items():
        roads = roads.replace(word, text)
    (folder / "roads" / "street.xodr").write_text(roads)
    return open_scenario(path)


def where(scene: Scenario, name: str, time_s: float) -> np.ndarray:
    return at(scene, name, scene.current_step + round(time_s * 10))


def slower(value: float, dynamics: str) -> str:
    found = speed(value).replace(
        "<SpeedActionTarget>", f"{dynamics}<SpeedActionTarget>"
    )
    return found.replace("PrivateAction>", "X>").replace("<X>", "").replace("</X>", "")


def change(target: str, shape: str = "linear") -> str:
    dynamics = f'dynamicsShape="{shape}" value="2" dynamicsDimension="time"'
    return f"""<LateralAction><LaneChangeAction><LaneChangeActionDynamics {dynamics}/>
    <LaneChangeTarget>{target}</LaneChangeTarget></LaneChangeAction></LateralAction>"""


def test_entities_drive_on_along_lanes_until_the_road_ends(tmp_path: Path):
    """They had their first state alone."""
    east, west = "7:-1:80:10", "7:1:35:5"
    scene = drive(tmp_path, {east: "", west: "", "7:-2:10:0": ""}, "")
    np.testing.assert_allclose(where(scene, east, 5), (130, -2), atol=1e-6)
    np.testing.assert_allclose(where(scene, west, 6), (5, 2), atol=1e-6)
    np.testing.assert_allclose(where(scene, "7:-2:10:0", 8), (10, -6), atol=1e-6)
    agents = scene.agents
    there = agents.is_valid[:, scene.current_step :].sum(axis=1)
    assert there[agents.rows((east, west, "7:-2:10:0"))].tolist() == [81, 71, 81]
    heading = agents.heading_rad[agents.row_of[west], scene.current_step + 3]
    assert abs(heading) == pytest.approx(np.pi)


def test_speeds_and_lanes_change_as_events_tell(tmp_path: Path):
    """Such events were told as not read."""
    car = "7:-1:10:10"
    rate = '<SpeedActionDynamics dynamicsShape="linear" value="2" dynamicsDimension="rate"/>'
    groups = event(car, slower(4, rate), 2.0)
    groups += event(
        car, change(f'<RelativeTargetLane entityRef="{car}" value="-1"/>'), 6
    )
    scene = drive(tmp_path, {car: ""}, groups)
    np.testing.assert_allclose(where(scene, car, 2), (30, -2), atol=1e-6)
    np.testing.assert_allclose(where(scene, car, 5), (51, -2), atol=1e-6)
    np.testing.assert_allclose(where(scene, car, 7), (59, -4), atol=1e-6)
    np.testing.assert_allclose(where(scene, car, 10), (71, -6), atol=1e-6)
    row, step = scene.agents.row_of[car], scene.current_step + 70
    assert scene.agents.heading_rad[row, step] == pytest.approx(-np.arctan2(2, 4))
    assert "Not read" not in " ".join(scene.provenance.notes)


@pytest.mark.parametrize(
    ("condition", "time_s"),
    [
        ('<TraveledDistanceCondition value="20"/>', 2.0),
        ('<SpeedCondition value="9" rule="greaterThan"/>', 0.0),
        (
            '<TimeHeadwayCondition entityRef="7:-1:60:5" value="2" rule="lessThan"/>',
            6.1,
        ),
        (
            '<RelativeDistanceCondition entityRef="7:-1:60:5" value="30" rule="lessOrEqual"'
            ' relativeDistanceType="longitudinal" freespace="false"/>',
            4.0,
        ),
        (
            '<ReachPositionCondition tolerance="1"><Position><LanePosition roadId="7" '
            'laneId="-1" s="31"/></Position></ReachPositionCondition>',
            2.0,
        ),
    ],
)
def test_events_begin_when_entities_are_so(
    tmp_path: Path, condition: str, time_s: float
):
    """They never began."""
    car, ahead = "7:-1:10:10", "7:-1:60:5"
    actors = f'<TriggeringEntities triggeringEntitiesRule="any"><EntityRef entityRef="{car}"/>'
    rule = f"""<ByEntityCondition>{actors}</TriggeringEntities><EntityCondition>{condition}
    </EntityCondition></ByEntityCondition>"""
    step = (
        '<SpeedActionDynamics dynamicsShape="step" value="0" dynamicsDimension="time"/>'
    )
    stops = re.sub(
        "<ByValue.*?</ByValueCondition>", rule, event(car, slower(0, step), 0)
    )
    scene = drive(tmp_path, {car: "", ahead: ""}, stops)
    place = where(scene, car, 9)[0]
    assert place == pytest.approx(10 + 10 * time_s, abs=1.01)


def test_who_is_to_stand_for_some_time_has_stood_so_long(tmp_path: Path):
    """A car that stood was enough at once."""
    car, stands = "7:-1:10:10", "7:-2:60:0"
    rule = f"""<ByEntityCondition><TriggeringEntities triggeringEntitiesRule="any">
    <EntityRef entityRef="{stands}"/></TriggeringEntities><EntityCondition>
    <StandStillCondition duration="3"/></EntityCondition></ByEntityCondition>"""
    stops = re.sub("<ByValue.*?</ByValueCondition>", rule, event(car, slower(0, ""), 0))
    scene = drive(tmp_path, {car: "", stands: ""}, stops)
    assert where(scene, car, 9)[0] == pytest.approx(40, abs=1.01)


def test_routes_lead_through_forks(tmp_path: Path):
    """All went straight on; who is on another lane changes to one that leads there."""
    car = "7:-1:80:10"
    position = '<Position><LanePosition roadId="6" laneId="-1" s="50"/></Position>'
    way = f"""<PrivateAction><RoutingAction><AssignRouteAction><Route name="r">
    <Waypoint>{position}</Waypoint></Route></AssignRouteAction></RoutingAction></PrivateAction>"""
    other, against = "7:-2:50:10", "7:1:50:5"
    scene = drive(tmp_path, {car: way, other: way, against: way}, "")
    assert where(scene, car, 6)[1] > 10
    np.testing.assert_allclose(where(scene, other, 2), (70, -4), atol=1e-6)
    np.testing.assert_allclose(where(scene, other, 5), (100, -2), atol=1e-6)
    assert where(scene, other, 8)[1] > 5
    np.testing.assert_allclose(where(scene, against, 6), (20, 2), atol=1e-6)
    assert "AssignRouteAction" in " ".join(scene.provenance.notes)


def in_lane(s: float, lane_id: int = -1) -> str:
    return f'<LanePosition roadId="7" laneId="{lane_id}" s="{s}"/>'


@pytest.mark.parametrize(
    ("final", "there"),
    [("", 11.0), ('<FinalSpeed><AbsoluteSpeed value="8"/></FinalSpeed>', 8.0)],
)
def test_entities_meet_at_places(tmp_path: Path, final: str, there: float):
    """They kept their speed."""
    car, master = "7:-2:10:5", "7:-1:40:10"
    action = f"""<SynchronizeAction masterEntityRef="{master}"><TargetPositionMaster>
    {in_lane(90)}</TargetPositionMaster><TargetPosition>{in_lane(50, -2)}</TargetPosition>
    {final}</SynchronizeAction>"""
    scene = drive(tmp_path, {car: "", master: ""}, event(car, action, 0.0))
    np.testing.assert_allclose(where(scene, car, 5), (50, -6), atol=0.3)
    assert where(scene, car, 8)[0] == pytest.approx(50 + 3 * there, abs=0.6)
    (folder := tmp_path / "late").mkdir()
    late = drive(
        folder, {car: "", master: ""},
        event(car, action.replace(in_lane(90), in_lane(10)), 0.0),
    )  # fmt: skip
    np.testing.assert_allclose(where(late, car, 5), (35, -6), atol=1e-6)
    assert "SynchronizeAction" in " ".join(late.provenance.notes)
    broken = action.replace("TargetPositionMaster", "Master")
    (folder := tmp_path / "broken").mkdir()
    with pytest.raises(FormatError, match="has no <TargetPositionMaster>"):
        drive(folder, {car: "", master: ""}, event(car, broken, 0.0))


@pytest.mark.parametrize(
    ("told", "gap_m"),
    [
        ('distance="20" freespace="false" continuous="true"', 20.0),
        ('distance="10" freespace="true" continuous="true"', 14.2),
        ('timeGap="3" freespace="false" continuous="true"', 30.0),
        ('distance="5" freespace="false" displacement="leadingReferencedEntity"', -5.0),
    ],
)  # fmt: skip
def test_entities_keep_distances(tmp_path: Path, told: str, gap_m: float):
    """They kept their speed."""
    car, other = "7:-1:5:12", "7:-1:40:10"
    action = f'<LongitudinalDistanceAction entityRef="{other}" {told}/>'
    scene = drive(tmp_path, {car: "", other: ""}, event(car, action, 0.0), 12)
    gaps = [where(scene, other, s)[0] - where(scene, car, s)[0] for s in (10, 11)]
    np.testing.assert_allclose(gaps, gap_m, atol=0.6)
    speeds = np.linalg.norm(scene.agents.velocity_mps[scene.agents.row_of[car]], axis=1)
    assert np.diff(speeds[scene.current_step :][:110]).max() < 0.5


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ('<FromLaneCoordinates pathS="9" laneId="-1" laneOffset="1"/>', (19, -1)),
        ('<FromLaneCoordinates pathS="9" laneId="-2"/>', (19, -6)),
        ('<FromRoadCoordinates pathS="9" t="0"/>', (19, -2)),
    ],
)
def test_places_may_be_along_routes(tmp_path: Path, place: str, expected: tuple):
    """They were told as not read."""
    way = "".join(
        f"<Waypoint><Position>{one}</Position></Waypoint>"
        for one in (in_lane(10), '<LanePosition roadId="6" laneId="-1" s="50"/>')
    )
    position = f"""<RoutePosition><RouteRef><Route name="r">{way}</Route></RouteRef>
    <InRoutePosition>{place}</InRoutePosition></RoutePosition>"""
    car = "7:-1:10:0"
    teleport = f"<TeleportAction><Position>{position}</Position></TeleportAction>"
    scene = drive(tmp_path, {car: ""}, event(car, teleport, 1.0))
    np.testing.assert_allclose(where(scene, car, 5), expected, atol=0.05)


def test_places_of_conditions_may_be_beyond_the_roads(tmp_path: Path):
    car = "7:-1:10:10"
    far = '<Position><LanePosition roadId="7" laneId="-1" s="900"/></Position>'
    reach = f'<ReachPositionCondition tolerance="1">{far}</ReachPositionCondition>'
    rule = f"<ByEntityCondition><EntityCondition>{reach}</EntityCondition></ByEntityCondition>"
    stops = re.sub("<ByValue.*?</ByValueCondition>", rule, event(car, slower(0, ""), 0))
    scene = drive(tmp_path, {car: ""}, stops)
    np.testing.assert_allclose(where(scene, car, 9), (100, -2), atol=1e-6)
    assert "SpeedAction on a condition" in " ".join(scene.provenance.notes)
