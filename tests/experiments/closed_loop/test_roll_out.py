"""Roll-outs: the world steps on, traffic answers, policies drive, faults end one drive."""

from dataclasses import replace
from threading import Thread
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.roll_outs import obedience, seams
from pd_editor.base.errors import GenerationError
from pd_editor.editor.commands import SampleSignals, SetLocks
from pd_editor.editor.recipe import Recipe, replay
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.editor.session import EditorSession
from pd_editor.experiments.closed_loop.policies import policy_of
from pd_editor.experiments.closed_loop.roll_out import (
    Rolling,
    RollOut,
    RollOutRequest,
    roll_out,
    route_of,
)
from pd_editor.experiments.closed_loop.scores import drive_scores
from pd_editor.experiments.closed_loop.world import World
from pd_editor.generation.generators import make_generator
from pd_editor.scene.agent_kind import Activity
from pd_editor.scene.generation import (
    GeneratedTraffic,
    GenerationRequest,
    NoiseDrift,
    run_to_end,
)
from pd_editor.scene.locks import TRAJECTORY_LOCK
from pd_editor.scene.policy import Controls, Plan
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.thresholds import MOVED_M
from pd_editor.scene.traffic_sample import TrafficSample
from tests.builders import (
    LANE_WIDTH_M,
    scenario_with,
    straight_drivers,
    straight_lane,
)

JUNCTION = "signalised-junction"


def rolled(scenario, *, model: str = "lane-follower", **options) -> RollOut:
    steps = roll_out(
        RollOutRequest(scenario=scenario, **options), make_generator(model)
    )
    while True:
        try:
            shown = next(steps)
            assert 0 <= shown.fraction <= 1
        except StopIteration as stop:
            return stop.value


@pytest.fixture(scope="module")
def junction():
    return open_scenario(JUNCTION)


def test_the_scene_goes_on_without_seams(junction):
    found = rolled(junction, duration_s=4.0, replan_s=1.0)
    one, now = found.scenario, junction.current_step
    assert one.time_axis.num_steps == now + 41
    agents, before = one.agents, junction.agents
    for name in before.ids:
        row, was = agents.row_of[name], before.row_of[name]
        for field in ("position_m", "heading_rad", "velocity_mps", "is_valid"):
            same = getattr(agents, field)[row, : now + 1]
            np.testing.assert_array_equal(same, getattr(before, field)[was, : now + 1])
    lasts = agents.is_valid[:, now:-1] & agents.is_valid[:, now + 1 :]
    moved = np.linalg.norm(np.diff(agents.position_m[:, now:], axis=1), axis=-1)
    mean = (agents.speed_mps()[:, now:-1] + agents.speed_mps()[:, now + 1 :]) / 2
    assert (np.abs(moved / 0.1 - mean)[lasts] < 1.5).all()


def test_equal_seeds_give_equal_bytes_and_the_recipe_needs_no_generator(junction):
    options = {"duration_s": 2.0, "policies": {"AV": policy_of("idm")}, "seed": 3}
    one, other = (rolled(junction, **options) for _ in range(2))
    assert one.command == other.command
    session = EditorSession(junction)
    session.apply(one.command)
    text = session.recipe().to_text()
    again = replay(Recipe.from_text(text), junction)
    for field in ("position_m", "heading_rad", "velocity_mps", "is_valid"):
        np.testing.assert_array_equal(
            getattr(again.agents, field), getattr(one.scenario.agents, field)
        )
    session.undo()
    assert session.scenario is junction


def test_windows_and_the_result_have_the_same_phases(junction):
    scene = SampleSignals(seed=1).apply(junction)
    seen = []

    class Looks(Brakes):
        def plan(self, observation):
            seen.append(observation)
            return super().plan(observation)

    found = rolled(scene, duration_s=2.0, seed=4, policies={"AV": Looks()})
    for one in seen:
        count = one.ego.position_m.shape[1]
        assert one.signals
        for own, after in zip(one.signals, found.scenario.signals, strict=True):
            np.testing.assert_array_equal(own.states, after.states[:count])
    world = World.beginning(scene, 600, seed=4)
    states = {n: one.states for one in world.scenario.signals for n in one.lane_ids}
    assert any(np.ptp(own) for own in states.values())
    for one in found.scenario.signals:
        for lane in one.lane_ids:
            np.testing.assert_array_equal(one.states, states[lane][: len(one.states)])
    later = replace(world, step=world.step + 300).window()
    for one in later.signals:
        now = one.states[later.current_step]
        assert all(states[lane][world.step + 300] == now for lane in one.lane_ids)


@pytest.mark.slow
def test_queues_wait_for_green_and_go_then(junction):
    """By the model, over changes of phase."""
    scene = SampleSignals(seed=0).apply(junction)
    found = rolled(scene, model="path-diffuser", duration_s=60.0).scenario
    against_red, crossings, started, waited = obedience(found)
    assert against_red <= 0.15 * crossings
    assert started >= 0.6 * waited > 2
    states = [one.states[scene.current_step :] for one in found.signals]
    assert sum(((own[:-1] == 1) & (own[1:] == 3)).sum() for own in states) >= 2


@pytest.mark.slow
def test_headings_do_not_leap_where_a_window_begins(junction):
    """They leapt by up to 13 degrees, as paths do."""
    found = rolled(junction, model="path-diffuser", duration_s=10.0).scenario
    _, bend = seams(found, 10)
    assert len(bend) > 100
    assert bend.max() < 0.01


class Brakes:
    """Stops as hard as is common in an emergency."""

    name = "brakes"

    def reset(self, scene, ego_id, route_m, seed):
        pass

    def plan(self, observation):
        return Controls(acceleration_mps2=np.full(30, -4.0), curvature_1pm=np.zeros(30))


def test_traffic_answers_an_agent_that_brakes(junction):
    """A follower of the log would drive into it."""
    agents, now = junction.agents, junction.current_step
    speed = agents.speed_mps()[:, now]
    row = int(np.where(agents.is_valid[:, now], speed, 0).argmax())
    name = agents.ids[row]
    found = rolled(junction, duration_s=6.0, policies={name: Brakes()})
    there = found.scenario.agents
    assert there.speed_mps()[there.row_of[name], -1] < 0.01
    assert not found.ended
    scores = drive_scores(found.scenario, name, route_of(junction, name))
    assert scores.num_collisions == 0
    # Points of a route are 2 m apart.
    assert scores.ego_progress_along_route_m == pytest.approx(
        float(speed[row] ** 2 / 8), abs=0.5
    )


def test_an_agent_that_leaves_by_the_end_of_the_road_was_never_off_it(junction):
    """Its front counted as off the drivable area."""
    policy = {"AV": policy_of("idm")}
    found = rolled(junction, duration_s=12.0, replan_s=3.0, policies=policy)
    assert found.ended["AV"] == "AV left the mapped road at 8.5 s."
    assert not found.failed
    scores = drive_scores(found.scenario, "AV", route_of(junction, "AV"))
    assert scores.drivable_area_compliance
    aside = found.scenario.agents.position_m.copy()
    row, now = found.scenario.agents.row_of["AV"], junction.current_step
    aside[row, now : now + 5] += (60.0, 60.0)
    beside = found.scenario.with_agents(
        replace(found.scenario.agents, position_m=aside)
    )
    scores = drive_scores(beside, "AV", route_of(junction, "AV"))
    assert not scores.drivable_area_compliance


def test_who_drives_on_beside_the_road_makes_no_progress():
    """It was the furthest, beside whom those that kept to the road had low scores."""
    driver = straight_drivers([(0.0, 0.0, 0.0, 10.0)])
    route = np.array([[0.0, 0.0], [100.0, 0.0]])
    now = scenario_with(driver).current_step
    there = drive_scores(scenario_with(driver), driver.ids[0], route)
    aside = driver.position_m.copy()
    aside[0, now + 20 :, 1] -= 30.0
    off = scenario_with(replace(driver, position_m=aside))
    scores = drive_scores(off, driver.ids[0], route)
    assert there.ego_progress_along_route_m > 50.0
    assert scores.ego_progress_along_route_m == pytest.approx(19.0)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (None, "returned a NoneType; expected a Plan or Controls"),
        ((np.zeros(9), np.zeros(9)), "returned a tuple; expected a Plan or Controls"),
        (Controls(acceleration_mps2=np.zeros(2), curvature_1pm=np.zeros(2)), "F = 5"),
        (
            SimpleNamespace(acceleration_mps2=np.zeros(9), curvature_1pm=np.zeros(8)),
            "the shape (8,); expected numbers [F] for F = 9 steps.",
        ),
        (
            SimpleNamespace(position_m=np.zeros((9, 3)), heading_rad=np.zeros(9)),
            "the shape (9, 3); expected numbers [F, 2] for F = 9 steps.",
        ),
        (
            Controls(acceleration_mps2=np.full(9, np.nan), curvature_1pm=np.zeros(9)),
            "The policy odd returned acceleration_mps2 with nan at step 0; expected",
        ),
        (
            Plan(position_m=np.full((9, 2), 300.0), heading_rad=np.zeros(9)),
            "changes by",
        ),
        (Plan(position_m=np.zeros((0, 2)), heading_rad=np.zeros(0)), "no further plan"),
        (
            SimpleNamespace(position_m=[[0, 0], 1], heading_rad=[0] * 5),
            "returned what is no array (ValueError",
        ),
        (ZeroDivisionError("oh"), "failed (ZeroDivisionError: oh"),
        (
            Controls(acceleration_mps2=np.full(9, 35.0), curvature_1pm=np.zeros(9)),
            "an acceleration of 35.0 m/s² over 0.5 s; expected at most 30 m/s²",
        ),
        (
            Controls(acceleration_mps2=np.zeros(9), curvature_1pm=np.full(9, 5.0)),
            "a yaw rate of",
        ),
    ],
)
def test_a_policy_that_fails_ends_its_own_drive_alone(junction, answer, message):
    class Odd(Brakes):
        name = "odd"

        def plan(self, observation):
            if observation.time_s < 1.0:
                return super().plan(observation)
            if isinstance(answer, Exception):
                raise answer
            return answer

    found = rolled(junction, duration_s=1.5, policies={"AV": Odd()})
    assert found.ended["AV"].startswith("AV at 1.0 s: The policy odd")
    assert message in found.ended["AV"]
    # Who replays a log has no plan beyond it.
    assert found.failed == (set() if "no further plan" in message else {"AV"})
    agents, now = found.scenario.agents, junction.current_step
    there = agents.is_valid[agents.row_of["AV"], now:]
    assert there[:10].all()
    assert not there[10:].any()
    assert agents.is_valid[:, -1].sum() >= agents.is_valid[:, now].sum() - 4


@pytest.mark.parametrize("hangs_in", ["reset", "plan"])
@pytest.mark.parametrize("is_main", [True, False])
def test_a_policy_that_hangs_ends_its_own_drive_alone(junction, hangs_in, is_main):
    def hang(*_):
        while True:
            pass

    odd = type("Hangs", (Brakes,), {"name": "hangs", hangs_in: hang})()
    found = []

    def run():
        policies = {"AV": odd}
        found.append(rolled(junction, duration_s=1.0, policies=policies, answer_s=0.05))

    if is_main:
        run()
    else:
        thread = Thread(target=run)
        thread.start()
        thread.join()
    (one,) = found
    told = "AV at 0.0 s: The policy hangs: It gave no answer within 0.05 s."
    assert one.ended == {"AV": told}
    agents, now = one.scenario.agents, junction.current_step
    assert not agents.is_valid[agents.row_of["AV"], now + 1 :].any()
    assert agents.is_valid[:, -1].sum() >= agents.is_valid[:, now].sum() - 4


def test_several_policies_drive_at_once(junction):
    agents, now = junction.agents, junction.current_step
    speed = np.where(agents.is_valid[:, now], agents.speed_mps()[:, now], 0)
    names = [agents.ids[row] for row in np.argsort(-speed)[:2]]
    policies = {
        names[0]: Brakes(),
        names[1]: policy_of("constant-velocity"),
    }
    found = rolled(junction, duration_s=2.0, policies=policies)
    assert dict(found.command.policies) == {
        names[0]: "brakes",
        names[1]: "constant-velocity",
    }
    end, rows = found.scenario.agents, found.scenario.agents.row_of
    braked, kept = (end.speed_mps()[rows[name], -1] for name in names)
    first, second = (speed[agents.row_of[name]] for name in names)
    assert braked == pytest.approx(max(first - 8.0, 0.0), abs=0.1)
    assert kept == pytest.approx(second, abs=0.1)


class Creeps:
    """A generator whose agents move by 5 cm a second."""

    name = "creeps"

    def generate(self, request):
        agents, now = request.scenario.agents, request.scenario.current_step
        rows = agents.rows(request.agent_ids)
        heading = np.repeat(agents.heading_rad[rows, now, None], 61, axis=1)
        way = np.stack([np.cos(heading), np.sin(heading)], axis=-1) * 0.05
        sample = TrafficSample(
            ids=request.agent_ids,
            kinds=tuple(agents.kinds[row] for row in rows),
            size_m=agents.size_m[rows],
            position_m=agents.position_m[rows, now, None]
            + way * 0.1 * np.arange(61)[:, None],
            heading_rad=heading,
            velocity_mps=way,
        )
        yield from ()
        return GeneratedTraffic(
            samples=(sample,), generator="creeps", model_sha256="", seed=0, elapsed_s=0
        )


def test_agents_that_stand_do_not_creep_into_each_other():
    """Window after window a queue closed up until its boxes overlapped."""
    scene = scenario_with(straight_drivers([(0, 0, 0, 0), (5.2, 0, 0, 0)]))
    rolling = Rolling.started(RollOutRequest(scenario=scene, duration_s=20.0), Creeps())
    while not rolling.is_over:
        list(rolling.next_steps())
    agents, now = rolling.result().scenario.agents, scene.current_step
    moved = agents.position_m[:, now:] - agents.position_m[:, now, None]
    assert np.abs(moved).max() < 1e-6


def test_who_enters_never_has_the_id_of_one_who_has_left():
    """Its track had a hole at the origin, and boxes there collided."""
    scene = scenario_with(straight_drivers([(0, 0, 0, 5), (30, 0, 0, 5)]))
    stays, gone = scene.agents.ids
    world = World.beginning(scene, 50, seed=0).without([gone])
    sample = TrafficSample(
        ids=(stays, gone),
        kinds=scene.agents.kinds,
        size_m=scene.agents.size_m,
        position_m=np.zeros((2, 61, 2)),
        heading_rad=np.zeros((2, 61)),
        velocity_mps=np.zeros((2, 61, 2)),
    )
    first, second = world.with_fresh_ids(sample).ids
    assert first == stays
    assert second not in scene.agents.ids


def test_modules_of_a_policys_folder_are_its_own(tmp_path):
    """They could not be imported at all."""
    for number in (1, 2):
        folder = tmp_path / str(number) / "v1.5"
        folder.mkdir(parents=True)
        (folder / "inner.py").write_text(f"NAME = 'number {number}'\n")
        (folder / "policy.py").write_text(
            "from pd_editor.experiments.closed_loop.policies import IdmOnRoute\n"
            "from .inner import NAME\n"
            "class Mine(IdmOnRoute):\n    name = NAME\n"
            "def make_policy(folder):\n    return Mine()\n"
        )
        assert policy_of(str(folder)).name == f"number {number}"


def test_a_folder_is_a_policy(tmp_path):
    (tmp_path / "policy.py").write_text(
        "from pd_editor.experiments.closed_loop.policies import IdmOnRoute\n"
        "def make_policy(folder):\n    return IdmOnRoute()\n"
    )
    assert policy_of(str(tmp_path)).name == "idm"
    (tmp_path / "policy.py").write_text("def make_policy(folder):\n    1 / 0\n")
    with pytest.raises(GenerationError, match=r"making the policy failed \(Zero"):
        policy_of(str(tmp_path))
    (tmp_path / "policy.py").write_text("")
    with pytest.raises(GenerationError, match=r"has no function make_policy\(folder\)"):
        policy_of(str(tmp_path))


def test_a_scene_without_a_road_is_refused():
    bare = scenario_with(straight_drivers([(0, 0, 0, 5)]), RoadMap(lanes=()))
    with pytest.raises(GenerationError, match="The scene has no lanes"):
        RollOutRequest(scenario=bare)


@pytest.mark.parametrize("place", [(0, 300, 1, 5), (0, 60, 0, 0), (195, 0, 0, 0)])
def test_an_agent_without_a_lane_gets_a_route_of_its_own(place):
    scene = scenario_with(straight_drivers([place, (30, 0, 0, 5)]))
    ego = scene.agents.ids[0]
    route = route_of(scene, ego)
    assert len(route) > 1
    for name in ("idm", "constant-velocity"):
        found = rolled(scene, duration_s=1.0, policies={ego: policy_of(name)})
        assert not found.failed
        assert drive_scores(found.scenario, ego, route).driven_s > 0


@pytest.mark.parametrize(
    "name",
    [
        "constant-velocity",
        "examples.policies.fiss_plus:FissPlus",
        "examples.policies.idm_on_route:Idm",
        "examples.policies.model_as_planner:ModelPlanner",
        "examples.policies.torch_policy:TorchPolicy",
    ],
)
def test_policies_by_name_drive(junction, name):
    if "fiss_plus" in name:
        pytest.importorskip("fiss_planner", reason="needs the extra policies")
    found = rolled(junction, duration_s=2.0, policies={"AV": policy_of(name)})
    agents, now = found.scenario.agents, junction.current_step
    assert not found.ended
    assert agents.is_valid[agents.row_of["AV"], now:].all()


def test_a_policy_sees_nothing_of_the_future(junction):
    class Looks(Brakes):
        def plan(self, observation):
            now = junction.current_step + round(observation.time_s / 0.1)
            for one in (observation.ego, observation.others):
                assert one.position_m.shape[1] == now + 1
                assert not one.position_m.flags.writeable
                assert one.is_valid[:, -1].all()
            assert observation.ego.ids == ("AV",)
            assert "AV" not in observation.others.ids
            return super().plan(observation)

    assert not rolled(junction, duration_s=2.0, policies={"AV": Looks()}).ended


def test_parked_agents_stay_where_they_are(junction):
    """The model lets them drift, window by window, until they collide."""
    now = junction.current_step
    names = [name for name in junction.agents.ids if name.startswith("parked")]
    parked = junction.agents.rows(names)
    assert len(parked) > 3
    found = rolled(junction, duration_s=6.0, replan_s=1.0, model="path-diffuser")
    agents = found.scenario.agents
    rows = agents.rows(names)
    assert agents.is_valid[rows, now:].all()
    place = junction.agents.position_m[parked, now, None]
    assert (agents.position_m[rows, now:] == place).all()
    moves = agents.speed_mps()[:, now:].max(axis=1) > 1
    assert moves.any()


def test_who_is_not_parked_waits_or_drives(junction):
    """Recordings do not tell it; the model keeps more of those that may be parked."""
    unknown = np.zeros(len(junction.agents), np.int8)
    recorded = junction.with_agents(replace(junction.agents, activity=unknown))
    window = World.beginning(recorded, 10, seed=0).window()
    parked = [name.startswith("parked") for name in window.agents.ids]
    assert (window.activity()[parked] == Activity.PARKED).all()
    others = set(window.activity()[~np.array(parked)].tolist())
    assert others == {Activity.WAITING, Activity.DRIVING}


def test_who_waits_on_free_road_starts():
    """Queues stood for good: at exactly 0 m/s the network starts hardly anyone."""
    along, beside = (-80.0, -20.0, 40.0, 100.0), (0.0, LANE_WIDTH_M)
    places = [(x, y, 0.0, 0.0) for x in along for y in beside]
    world = World.beginning(scenario_with(straight_drivers(places)), 1, seed=0)
    ids = world.generated_ids(())
    asked = GenerationRequest(
        scenario=world.window(), agent_ids=ids, num_samples=32, back_casts=False
    )

    def share(request: GenerationRequest) -> float:
        traffic = run_to_end(make_generator("path-diffuser").generate(request))
        ways = [one.position_m[:, -1] - one.position_m[:, 0] for one in traffic.samples]
        return (np.linalg.norm(ways, axis=-1) > MOVED_M).mean()

    in_roll_out = share(replace(asked, drift=NoiseDrift(ids=ids, place=0.0)))
    assert in_roll_out > 1.2 * share(asked)


def test_traffic_of_a_motorway_keeps_its_speed():
    """Windows slowed it down one after the other, to the speeds of a city."""
    starts = np.arange(-100.0, 600.0, 50.0).tolist()
    road = RoadMap(
        lanes=tuple(
            straight_lane(
                3 * part + side,
                (x, side * LANE_WIDTH_M),
                (x + 50.0, side * LANE_WIDTH_M),
                successors=(3 * part + 3 + side,) * (x < starts[-1]),
            )
            for part, x in enumerate(starts)
            for side in range(3)
        )
    )
    places = [(35.0 * n - 80.0, n % 3 * LANE_WIDTH_M, 0.0, 20.0) for n in range(8)]
    scene = scenario_with(straight_drivers(places), road)
    found = rolled(scene, model="path-diffuser", duration_s=15.0, keeps_density=False)
    agents, last = found.scenario.agents, scene.current_step + 150
    assert agents.speed_mps()[agents.is_valid[:, last], last].mean() > 18.5


def test_locked_tracks_are_replayed(junction):
    agents, now = junction.agents, junction.current_step
    whole = agents.is_valid[:, now:].all(axis=1)
    name = agents.ids[int(np.flatnonzero(whole)[0])]
    scenario = SetLocks(agent_ids=(name,), lock=TRAJECTORY_LOCK).apply(junction)
    found = rolled(scenario, duration_s=5.0).scenario
    row, was = found.agents.row_of[name], agents.row_of[name]
    np.testing.assert_allclose(
        found.agents.position_m[row, now : now + 50],
        agents.position_m[was, now : now + 50],
        atol=1e-3,
    )


def test_log_replay_drives_as_recorded_until_the_log_ends(junction):
    found = rolled(junction, duration_s=6.5, policies={"AV": policy_of("log-replay")})
    now = junction.current_step
    row, was = found.scenario.agents.row_of["AV"], junction.agents.row_of["AV"]
    there = found.scenario.agents.is_valid[row, now:]
    count = int(there.sum())
    assert 50 <= count <= 61
    np.testing.assert_allclose(
        found.scenario.agents.position_m[row, now : now + count],
        junction.agents.position_m[was, now : now + count],
        atol=1e-3,
    )
    assert "no further plan" in found.ended["AV"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"duration_s": 0.0}, "The duration is 0 s; expected 0.5 to 90 s."),
        ({"replan_s": 9.0}, "generations is 9 s; expected 0.5 to 3 s."),
        ({"duration_s": float("nan")}, "The duration is nan s"),
    ],
)
def test_what_cannot_be_rolled_out_is_refused(junction, options, message):
    with pytest.raises(GenerationError, match=message):
        RollOutRequest(scenario=junction, **options)


def test_an_agent_that_is_not_there_cannot_be_driven(junction):
    agents, now = junction.agents, junction.current_step
    is_valid = agents.is_valid.copy()
    is_valid[agents.row_of["AV"], now] = False
    scenario = replace(junction, agents=replace(agents, is_valid=is_valid))
    with pytest.raises(GenerationError, match="AV is not there"):
        RollOutRequest(scenario=scenario, policies={"AV": Brakes()})


@pytest.mark.slow
def test_the_model_keeps_the_road_as_full_as_it_was(av2_root):
    folder = sorted((av2_root / "val").iterdir())[3]
    scenario = open_scenario(folder)
    found = rolled(scenario, model="path-diffuser", duration_s=20.0)
    agents, now = found.scenario.agents, scenario.current_step
    assert found.num_entered >= 5
    count = agents.is_valid[:, now::10].sum(axis=0)
    assert (count > 0.5 * count[0]).all()
    new = [row for row, name in enumerate(agents.ids) if name.startswith("new-")]
    assert (agents.is_valid[new, now:].sum(axis=1) > 0).all()
    assert not agents.is_valid[new, : now + 1].any()
    lasts = agents.is_valid[:, now:-1] & agents.is_valid[:, now + 1 :]
    moved = np.linalg.norm(np.diff(agents.position_m[:, now:], axis=1), axis=-1)
    assert moved[lasts].max() < 5.0
