"""What docs/own_generators.md says of fields and variants is so."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from pd_editor.experiments.training.settings import (
    RunRequest,
    StageName,
    new_config,
    settings_of,
)
from pd_editor.scene import (
    agent_tracks,
    generation,
    prediction,
    road_map,
    scenario,
    time_axis,
)
from tests.builders import scenario_with, straight_drivers

TEXT = (Path(__file__).parents[1] / "docs" / "own_generators.md").read_text()
MODULES = (generation, prediction, agent_tracks, road_map, scenario, time_axis)


def test_every_field_of_the_tables_exists():
    named = set(re.findall(r"`([A-Z]\w+)\.(\w+)`", TEXT))
    assert len(named) > 40
    for class_name, field in sorted(named):
        (kind,) = {
            getattr(module, class_name)
            for module in MODULES
            if hasattr(module, class_name)
        }
        known = {*dir(kind), *getattr(kind, "__dataclass_fields__", ())}
        assert field in known, f"{class_name}.{field}"


def test_every_field_of_a_request_stands_in_the_table():
    for kind in (
        prediction.PredictionRequest,
        prediction.AgentHistory,
        prediction.Prediction,
        road_map.Lane,
    ):
        for field in kind.__dataclass_fields__:
            if field != "source_fields":
                assert f"`{kind.__name__}.{field}`" in TEXT


def test_the_shapes_are_those_of_a_request():
    drivers = scenario_with(straight_drivers([(0, 0, 0, 10), (30, 0, 0, 5)]))
    asked = prediction.prediction_request(
        drivers, drivers.agents.ids[:1], num_modes=6, seed=0
    )
    sizes = {"A": 1, "H": drivers.current_step + 1, "F": asked.num_steps}
    for name in ("size_m", "position_m", "heading_rad", "velocity_mps", "is_valid"):
        (told,) = re.findall(rf"`AgentHistory\.{name}` \| \[([^\]]+)\]", TEXT)
        shape = tuple(sizes.get(one) or int(one) for one in told.split(", "))
        values = getattr(asked.agents, name)
        assert np.shape(values) == shape
        assert not values.flags.writeable


@pytest.mark.parametrize("stage", ["init", "traj"])
def test_the_file_of_the_example_is_a_variant(stage: StageName, tmp_path: Path):
    (block,) = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
    file = tmp_path / "my.toml"
    file.write_text(block)
    given = settings_of([file], (), stage)
    config = new_config(
        RunRequest(stage=stage, data=("/data",), settings=given), is_gpu=False
    )
    asked = tomllib.loads(block)
    assert config.model["width"] == asked["model"]["width"]
    if stage == "traj":
        assert config.model["num_blocks"] == asked["traj"]["model"]["num_blocks"]
