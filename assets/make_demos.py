"""Makes the demo scenarios: ``python -m assets.make_demos [FOLDER]``.

Needs SUMO (the extra ``synth``). The same versions of SUMO and of this repository make
the same bytes.
"""

import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool

from assets.stories import STORIES
from assets.story import Story
from pd_editor.analysis.metrics.road import is_off_road
from pd_editor.base.installed_files import SENTENCES_NAME
from pd_editor.experiments.recordings.clip import cropped_map, cut_scenario
from pd_editor.experiments.recordings.recording import Recording, Window
from pd_editor.experiments.synthesis.road_network.generator import generate_network
from pd_editor.experiments.synthesis.traffic.simulation import simulate
from pd_editor.scene.agent_kind import LANE_FOLLOWER_KINDS
from pd_editor.scene.agent_tracks import AgentTracks
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.road_map import RoadMap
from pd_editor.scene.scenario import Scenario

CITY: Final = "synthetic"
_PATH_STRIDE: Final = 5
_MAP_M: Final = 0.01
_MOTION_UNIT: Final = 2.0**-11
"""Metres, radians and metres per second are multiples of it: they pack well."""


def made_demo(story: Story) -> Scenario:
    """The scenario of a story.

    Raises:
        SynthesisError: SUMO is missing.
    """
    with tempfile.TemporaryDirectory() as name:
        # The windows of the stories were found on streets without bays.
        network = generate_network(story.family, story.seed, Path(name), bay_share=0.0)
        # They were found when fewer pedestrians stood, too.
        demand = replace(story.demand, standing_share=0.15, standing_s=(5.0, 120.0))
        recording = simulate(
            network, story.seed, duration_s=story.duration_s, demand=demand
        )
    return told(story, recording)


def told(story: Story, recording: Recording) -> Scenario:
    """The window of a recording that a story is about.

    Only agents that are there all the time are in it, and all roads that they use.
    """
    row = recording.ids.index(story.focal_id)
    at = recording.first_row[row] + story.current_step - recording.first_step[row]
    x, y = recording.position_m[at].tolist()
    window = Window(
        current_step=story.current_step,
        center_m=(x, y),
        focal_id=story.focal_id,
        seed=story.cast_seed,
    )
    scenario = cut_scenario(recording, window, side_m=story.side_m)
    is_wanted = np.array([name not in story.without for name in scenario.agents.ids])
    stays = np.flatnonzero(scenario.agents.is_valid.all(axis=1) & is_wanted)
    agents = scenario.agents.taken(stays)
    paths = agents.position_m[:, ::_PATH_STRIDE]
    shown = replace(
        scenario,
        scenario_id=story.name,
        city=CITY,
        agents=_rounded_agents(agents),
        signals=(),
        road_map=_rounded_map(cropped_map(recording.road_map, paths)),
    )
    stays = np.flatnonzero(~_is_parked_off_road(shown))
    return replace(shown, agents=shown.agents.taken(stays))


def _is_parked_off_road(scenario: Scenario) -> Bool[np.ndarray, "A"]:
    """Who stands for good, and not with all corners on paved ground."""
    agents = scenario.agents
    stands = (agents.position_m == agents.position_m[:, :1]).all(axis=(1, 2))
    stands &= agents.kind_mask(LANE_FOLLOWER_KINDS)
    boxes = agents.at(slice(None), scenario.current_step)
    return stands & is_off_road(scenario, boxes.corners_m()).any(axis=1)


def _rounded_agents(agents: AgentTracks) -> AgentTracks:
    names = ("size_m", "position_m", "heading_rad", "velocity_mps")
    arrays = {name: _rounded(getattr(agents, name), _MOTION_UNIT) for name in names}
    # Demos are opened as recordings are, which do not tell the activity of an agent.
    return replace(agents, **arrays, activity=np.zeros(len(agents), np.int8))


def _rounded_map(road_map: RoadMap) -> RoadMap:
    lines = (_rounded(line, _MAP_M) for line in road_map.polylines)
    return road_map.with_polylines(tuple(lines))


def _rounded(values: np.ndarray, unit: float) -> np.ndarray:
    return np.round(values / unit) * unit


def make_demos(folder: Path) -> None:
    """Write every demo as an Argoverse 2 scenario folder."""
    for story in STORIES:
        (folder / story.name).mkdir(parents=True, exist_ok=True)
        for name, content in scenario_files(made_demo(story)).items():
            (folder / story.name / name).write_bytes(content)
    write_sentences(folder)


def write_sentences(folder: Path) -> None:
    """Write what each demo shows, for the editor to tell."""
    sentences = {story.name: story.sentence for story in STORIES}
    text = json.dumps(sentences, indent=1) + "\n"
    (folder / SENTENCES_NAME).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    make_demos(
        Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "demos"
    )
