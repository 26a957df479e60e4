"""Replays ScenarioNet data sets in MetaDrive without a picture; runs in an environment of
its own.

Reads folders of data sets from standard input. Each scene passes MetaDrive's own check.
Writes for each ``arrives``, whether the ego came to its destination, and ``ego_m``, its
places step by step.
"""

import json
import pickle
import sys
from pathlib import Path

import metadrive
from metadrive.envs.scenario_env import ScenarioEnv
from metadrive.policy.replay_policy import ReplayEgoCarPolicy
from metadrive.scenario.scenario_description import ScenarioDescription
from metadrive.scenario.utils import read_dataset_summary
from metadrive.version import VERSION
from PIL import Image

GRASS = "textures/grass1/GroundGrassGreen002_COL_1K.jpg"


def without_download() -> None:
    """Pretend that pictures, which only a window needs, are there already."""
    assets = Path(metadrive.__file__).parent / "assets"
    (assets / GRASS).parent.mkdir(parents=True, exist_ok=True)
    (assets / "version.txt").write_text(VERSION)
    Image.new("RGB", (4, 4)).save(assets / GRASS)


def replay(folder: str) -> dict:
    """One data set of one scene."""
    _, (name,), _ = read_dataset_summary(folder)
    ScenarioDescription.sanity_check(pickle.loads((Path(folder) / name).read_bytes()))
    env = ScenarioEnv(
        {
            "data_directory": folder,
            "num_scenarios": 1,
            "agent_policy": ReplayEgoCarPolicy,
            "log_level": 50,
        }
    )
    env.reset(seed=0)
    places, is_over, about = [], False, {}
    while not is_over:
        _, _, ended, cut, about = env.step([0, 0])
        places.append([float(one) for one in env.agent.position])
        is_over = ended or cut
    env.close()
    return {"arrives": bool(about["arrive_dest"]), "ego_m": places}


if __name__ == "__main__":
    without_download()
    answer = [replay(folder) for folder in json.load(sys.stdin)]
    sys.stdout.write("\n" + json.dumps(answer))
