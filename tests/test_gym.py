"""The Gymnasium environment keeps Gymnasium's rules."""

from pathlib import Path

import numpy as np
import pytest

from pd_editor.base.errors import PdEditorError
from pd_editor.editor.commands import SetAgentSpeed
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.editor.session import EditorSession

gymnasium = pytest.importorskip("gymnasium", reason="needs the extra gym")
OPTIONS = {"model": "lane-follower", "duration_s": 2.0, "render_mode": "rgb_array"}


@pytest.fixture
def env():
    from pd_editor.gym import DriveEnv

    return DriveEnv(**OPTIONS)


@pytest.mark.filterwarnings("ignore:.*:UserWarning")
def test_the_checker_of_gymnasium_finds_nothing(env):
    from gymnasium.utils.env_checker import check_env

    check_env(env)


def test_braking_stops_and_time_ends_an_episode(env):
    first, _ = env.reset(seed=1)
    ends, speeds = [], [first["ego"][0]]
    while not any(ends[-1:]):
        seen, reward, *over, _ = env.step(np.array([-6.0, 0.0], np.float32))
        ends.append(over[0] or over[1])
        speeds.append(seen["ego"][0])
        assert np.isfinite(reward)
    assert len(ends) == 4
    assert np.all(np.diff(speeds) <= 1e-5)
    picture = env.render()
    assert picture.shape == (400, 400, 3)
    assert len(np.unique(picture)) > 3


def test_environments_run_side_by_side():
    from pd_editor.gym import DriveEnv

    both = gymnasium.vector.SyncVectorEnv([lambda: DriveEnv(**OPTIONS)] * 2)
    seen, _ = both.reset(seed=[3, 3])
    for _ in range(2):
        seen, *_ = both.step(np.zeros((2, 2), np.float32))
    for one in seen.values():
        np.testing.assert_array_equal(one[0], one[1])


def test_a_scene_or_a_recipe_is_driven(env, tmp_path: Path):
    session = EditorSession(open_scenario("roundabout"))
    session.apply(SetAgentSpeed(agent_ids=("AV",), speed_mps=3.0))
    (tmp_path / "recipe.json").write_text(session.recipe().to_text())
    seen, _ = env.reset(seed=0, options={"recipe": tmp_path})
    assert seen["ego"][0] == pytest.approx(3.0)
    seen, _ = env.reset(seed=0, options={"scene": "roundabout"})
    assert seen["ego"][0] != pytest.approx(3.0)
    for wrong in ({"scene": "nowhere"}, {"scen": "roundabout"}):
        with pytest.raises(PdEditorError, match=r"nowhere|no option 'scen'"):
            env.reset(options=wrong)
    # What could not be opened is not remembered.
    again, _ = env.reset(seed=0)
    np.testing.assert_array_equal(again["route"], seen["route"])


def test_rewards_of_steady_driving_are_steady(env):
    """Progress was that of the nearest point of the route, and those are 2 m apart."""
    seen, _ = env.reset(seed=1)
    rewards = [env.step(np.zeros(2, np.float32))[1] for _ in range(3)]
    np.testing.assert_allclose(rewards, seen["ego"][0] / 2, rtol=0.1)


def test_an_episode_that_is_over_is_not_driven_on(env):
    from gymnasium.error import ResetNeeded

    with pytest.raises(ResetNeeded, match="call reset first"):
        type(env)().step(np.zeros(2, np.float32))
    env.reset(seed=1)
    while not any(env.step(np.zeros(2, np.float32))[2:4]):
        pass
    with pytest.raises(ResetNeeded, match="call reset first"):
        env.step(np.zeros(2, np.float32))
